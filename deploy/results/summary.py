"""A run's result for people, or as JSON for programs."""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from actors.observer.viewer import WHILE_IT_GOES_ON
from actors.runtime.errors import printable
from deploy.results.result import RobotResult, RunResult


def print_result(result: RunResult, *, json: bool) -> None:
    """Print the result on standard output; as JSON, it is the only thing there."""
    if json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
        return
    console = Console()
    console.print(_table(result))
    console.print(
        f"{result.simulated_s:g} s simulated in {result.wall_s:.1f} s"
        f" ({result.real_time_factor:g} x real time, {result.startup_s:.1f} s to start)",
        highlight=False,
    )
    for sentence in _sentences(result):
        console.print(sentence, highlight=False)
    frames = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in result.frames.items() if count)
    console.print(f"radio: {frames or 'silence'}", highlight=False)
    if result.direct_reach is not None:
        console.print(f"pairs of robots in direct reach: {result.direct_reach:.0%}", highlight=False)
    console.print(f"contacts: {result.contacts}", highlight=False)
    for sentence in _navigation(result):
        console.print(sentence, highlight=False)
    for sentence in result.refused_orders:
        console.print(f"order refused {printable(sentence)}", style="bold red", highlight=False, markup=False)
    if result.unread:
        console.print(f"messages delivered and not read: {result.unread}", style="bold red")
    console.print(f"digest {result.digest}\nrecorded in {result.out}", highlight=False, soft_wrap=True)


def print_viewer(out: Path) -> None:
    """Say on standard error, while the run goes on, where its observer shows it."""
    _print_lines(_view_log(out))


def print_view(out: Path) -> None:
    """Say on standard error what the observer had to say, and how to see the run again."""
    told = [line for line in _view_log(out) if not line.startswith(WHILE_IT_GOES_ON)]
    _print_lines([*told, f"To see it again, and what each robot perceived: acrc view {out}"])


def _view_log(out: Path) -> list[str]:
    log = out / "view.log"
    return printable(log.read_text(errors="replace")).splitlines() if log.is_file() else []


def _print_lines(lines: Sequence[str]) -> None:
    for line in lines:
        Console(stderr=True, soft_wrap=True, highlight=False).print(line, markup=False)


def _table(result: RunResult) -> Table:
    """A row per robot and one for all; a column for places given up only where there are any."""
    gave_up = ("given up",) if result.places_given_up else ()
    table = Table("robot", "places done", *gave_up, "all done at")

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
        yield f"every place was reported or given up by {result.settled_s:.1f} s"
    if result.places_claimed > result.places_done:
        untrue = result.places_claimed - result.places_done
        yield f"{_places(untrue)} reported although no robot had been there"
        if result.settled_s is not None:
            yield "the run ended on false claims"
    if result.places_lost:
        yield f"{_places(result.places_lost)} lost: neither reported nor given up, and in nobody's route"


def _navigation(result: RunResult) -> Iterator[str]:
    """How well the robots knew where they were, and what became of their goals."""
    errors = [part.pose_error for part in result.per_robot.values() if part.pose_error.samples]
    if errors:
        samples = sum(error.samples for error in errors)
        rmse = math.sqrt(sum(error.rmse**2 * error.samples for error in errors) / samples)
        lost = sum(error.times_lost for error in errors)
        yield (
            f"localisation: {rmse:.2f} m from the truth (rmse), at most "
            f"{max(error.greatest for error in errors):.2f} m; lost {_times(lost)}"
        )
    goals = result.navigation
    if goals.goals:
        gave_up = ", ".join(f"{count} for {reason}" for reason, count in goals.aborted.items() if count)
        yield f"goals: {goals.goals} given, {goals.succeeded} reached, aborted {gave_up or 'none'}"


def _times(count: int) -> str:
    return "never" if count == 0 else "once" if count == 1 else f"{count} times"


def _places(count: int) -> str:
    return "1 place was" if count == 1 else f"{count} places were"


def _instant(completion_s: float | None) -> str:
    return "not all" if completion_s is None else f"{completion_s:.1f} s"
