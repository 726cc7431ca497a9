"""A run's result for people, or as JSON for programs."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec
from rich.table import Table

from acrc_testbed.results.result import RobotResult, RunResult
from actors.console import print_table, screen
from actors.installation.usage import typed
from actors.observer.viewer import WHILE_IT_GOES_ON
from actors.processes import silence
from actors.runtime.errors import printable

_ORIGINAL: Final = "; that preset is the original's navigation: robots may get stuck at corners and doors"


def print_result(result: RunResult, *, json: bool) -> None:
    """Print the result on standard output; as JSON, it is the only thing there."""
    if json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
        return
    console = screen()
    print_table(console, _table(result))
    for sentence in sentences(result):
        console.print(sentence)
    for sentence in result.refused_orders:
        console.print(f"order refused {printable(sentence)}", style="bold red")
    for sentence in result.refused_reports:
        console.print(printable(sentence), style="bold red")
    if result.unread:
        console.print(f"messages delivered and not read: {result.unread}", style="bold red")
    console.print(f"digest {result.digest}\nrecorded in {result.out}")


def sentences(result: RunResult) -> Iterator[str]:
    """The result in words, the most important first."""
    yield from _places_done(result)
    yield from _sentences(result)
    yield from _effort(result)
    yield from silence.sentences(result.held_up)
    yield from _radio(result)
    yield from _driving(result)


def print_next(out: Path, modules: Sequence[Path] = (), baseline: Sequence[str] = ()) -> None:
    """Print commands that show the run, and one that runs the same without adaptation.

    `modules`: folders with the run's own strategy. `baseline`: words of the last command; empty: none.
    """
    console = screen()
    console.print(f"See it on one page: {typed('view', out, '--png')}")
    console.print(f"See it with all that robots perceived: {typed('view', out, modules=modules)}")
    if baseline:
        console.print(f"The same without adaptation: {typed(*baseline)}")


def print_viewer(out: Path) -> None:
    """Say on standard error, while the run goes on, where its observer shows it."""
    _print_lines(_view_log(out))


def print_view(out: Path) -> None:
    """Say on standard error what the observer had to say at its end."""
    _print_lines([line for line in _view_log(out) if not line.startswith(WHILE_IT_GOES_ON)])


def _view_log(out: Path) -> list[str]:
    log = out / "view.log"
    return printable(log.read_text(errors="replace")).splitlines() if log.is_file() else []


def _print_lines(lines: Sequence[str]) -> None:
    for line in lines:
        screen(stderr=True).print(line)


def _table(result: RunResult) -> Table:
    """A row per robot and one for all; a column for places given up only where there are any."""
    gave_up = ("given up",) if result.places_given_up else ()
    table = Table("robot", "its places done", *gave_up, "all done at")

    def add(name: str, of: RobotResult | RunResult) -> None:
        given_up = (str(of.places_given_up),) if gave_up else ()
        done = f"{of.places_done} of {of.places_total}"
        table.add_row(name, done, *given_up, _instant(of.completion_s))

    for robot, part in result.per_robot.items():
        add(robot, part)
    table.add_section()
    add("all", result)
    return table


def _sentences(result: RunResult) -> Iterator[str]:
    """What else there is to say about the places."""
    if result.completion_s is None and result.settled_s is not None:
        yield f"Every place was reported or given up by {_s(result.settled_s)} s."
    if result.places_done is not None and result.places_claimed > result.places_done:
        untrue = result.places_claimed - result.places_done
        yield f"{_places(untrue)} reported although no robot had been there."
        if result.settled_s is not None:
            yield "The run ended on false claims."
    if result.places_lost:
        yield f"{_places(result.places_lost)} lost: neither reported nor given up, and in nobody's route."


def _places_done(result: RunResult) -> Iterator[str]:
    """The chapter's first two metrics, and whose doing they are."""
    if not result.places_total:
        yield "There was no place to clean."
        return
    robots = "1 robot" if result.robots == 1 else f"{result.robots} robots"
    by = f" with strategy {printable(result.origin.strategy)}" if result.origin.strategy else ""
    if by and result.origin.navigation:
        by += f" and navigation {printable(result.origin.navigation)}"
    if result.completion_s is not None:
        lasted = _s(result.completion_s)
        yield f"{robots}{by} cleaned all {result.places_total} places in {lasted} simulated s."
        return
    left = result.places_total - (result.places_done or 0)
    yield (
        f"{robots}{by} cleaned {result.places_done} of {result.places_total} places in "
        f"{_s(result.simulated_s)} simulated s; {left} {'is' if left == 1 else 'are'} left."
    )


def _effort(result: RunResult) -> Iterator[str]:
    """What it took here."""
    yield (
        f"Wall time: {result.wall_s:.1f} s, {result.real_time_factor:.3g} times as fast as real time; "
        f"{result.startup_s:.1f} s before that to start."
    )


def _radio(result: RunResult) -> Iterator[str]:
    """What became of frames, as far as robots know: heard, or lost and why."""
    counts = result.frames
    sent = counts.get("frames_sent", 0)
    if not sent:
        yield "Radio: nobody sent anything."
    else:
        lost = _worded(counts, "copies_lost_")
        yield (
            f"Radio: {_frames(sent)} sent; other robots heard {counts.get('copies_heard', 0)} copies of them "
            f"and lost {sum(lost.values())}{_because(lost)}."
        )
    never = {name: count for name, count in _worded(counts, "frames_").items() if name != "sent"}
    if never:
        yield f"Radio: {_frames(sum(never.values()))} never sent{_because(never)}."
    if missed := _worded(counts, "events_"):
        yield f"Radio: robots missed {sum(missed.values())} of its events{_because(missed)}."
    if result.direct_reach is not None:
        yield f"Two robots were in direct radio range {result.direct_reach:.0%} of the time."


def _driving(result: RunResult) -> Iterator[str]:
    """Contacts, how well robots knew where they were, and what became of their goals."""
    touched = result.contacts or 0
    yield f"Robots touched something {_times(touched)}." if touched else "No robot touched anything."
    errors = [part.pose_error for part in result.per_robot.values() if part.pose_error.samples]
    if errors:
        samples = sum(error.samples for error in errors)
        rmse = math.sqrt(sum(error.rmse**2 * error.samples for error in errors) / samples)
        lost = sum(error.times_lost for error in errors)
        yield (
            f"Localisation error{_in_brackets(result.origin.localisation)}: {rmse:.2f} m (RMSE), "
            f"{max(error.greatest for error in errors):.2f} m at most; "
            f"{f'robots were lost {_times(lost)}' if lost else 'no robot was lost'}."
        )
    goals = result.navigation
    if goals.goals:
        why = {name: count for name, count in goals.aborted.items() if count}
        yield (
            f"Navigation{_in_brackets(result.origin.navigation)}: {goals.goals} "
            f"{'goal' if goals.goals == 1 else 'goals'}, {sum(why.values()) or 'none'} aborted{_because(why)}"
            f"{_ORIGINAL if result.origin.navigation == 'chapter' else ''}."
        )


def _worded(counts: Mapping[str, int], prefix: str) -> dict[str, int]:
    """What is not nought of the counters that begin so, in words."""
    return {
        name.removeprefix(prefix).replace("_", " "): count
        for name, count in counts.items()
        if name.startswith(prefix) and count
    }


def _in_brackets(preset: str) -> str:
    """Return a preset's name in brackets; nothing for results that do not name it."""
    return f" ({printable(preset)})" if preset else ""


def _because(counts: Mapping[str, int]) -> str:
    """Causes, the most frequent first, behind a colon; empty if there are none."""
    ordered = sorted(counts.items(), key=lambda one: -one[1])
    return f" ({', '.join(f'{count} {name}' for name, count in ordered)})" if ordered else ""


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _s(seconds: float) -> str:
    """Seconds to the tenth."""
    return f"{seconds:.1f}".removesuffix(".0")


def _times(count: int) -> str:
    return "never" if count == 0 else "once" if count == 1 else f"{count} times"


def _places(count: int) -> str:
    return "1 place was" if count == 1 else f"{count} places were"


def _instant(completion_s: float | None) -> str:
    return "not all" if completion_s is None else f"{completion_s:.1f} s"
