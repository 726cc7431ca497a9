"""Printed summary of a run's result."""

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
from rich.table import Table

from acrc_testbed.results.result import RobotResult, RunResult, optional_value
from actors.console import create_console, print_table
from actors.installation.usage import command_line
from actors.processes import monitor
from actors.runtime.errors import printable
from actors.task.task import Metric, Value

_ORIGINAL: Final = "; this preset is the original navigation, in which robots get stuck at corners and doors"

_NOT_LOST: Final = ("sent", "handed")
"""Counters of frames that were not lost before transmission."""


def print_result(result: RunResult, *, json: bool) -> None:
    """Print the result on standard output, as tables and sentences or as JSON."""
    if json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
        return
    console = create_console()
    print_table(console, _result_table(result))
    for sentence in result_sentences(result):
        console.print(sentence)
    if not result.is_simulated:
        for note in result.notes:
            console.print(printable(note), style="yellow")
        if result.out is not None:
            console.print(f"Result: {result.out}")
        return
    for sentence in result.refused_orders:
        console.print(f"order refused: {printable(sentence)}", style="bold red")
    for sentence in result.refused_reports:
        console.print(printable(sentence), style="bold red")
    if result.unread:
        console.print(f"messages delivered but not read: {result.unread}", style="bold red")
    console.print(f"Digest: {result.digest}\nRecordings: {result.out}")


def result_sentences(result: RunResult) -> Iterator[str]:
    """Yield the result as sentences, the most important first."""
    if not result.is_simulated:
        yield f"Duration: {result.duration_s:.1f} s, from the first step of any robot to the last."
        yield f"{_robots_text(result)} {printable(result.task_summary)}."
        yield from map(printable, result.task_notes)
        if result.contacts is not None:
            yield f"Ground truth: {result.contacts} contacts."
        yield from _radio_sentences(result)
        return
    yield f"{_robots_text(result)} {printable(result.task_summary)}."
    yield from map(printable, result.task_notes)
    yield (
        f"Wall time: {result.wall_s:.1f} s ({result.real_time_factor:.3g} times faster than real time), "
        f"after {result.startup_s:.1f} s of start-up."
    )
    yield from monitor.delay_sentences(result.held_up)
    yield from _radio_sentences(result)
    yield from _driving_sentences(result)


def print_next_commands(out: Path, baseline: Sequence[str] = (), modules: Iterable[Path] = ()) -> None:
    """Print commands that show the run, and one that repeats it without adaptation.

    `baseline`: arguments of the last command; empty: none; `modules`: folders of the strategy's code.
    """
    console = create_console()
    console.print(f"Draw the run: {command_line('view', out, '--png')}")
    console.print(f"Open the run in the viewer: {command_line('view', out)}")
    console.print(f"Show where the robots' time went: {command_line('causes', out)}")
    console.print(f"List the decisions of r1: {command_line('explain', out, 'r1', modules=modules)}")
    if baseline:
        console.print(f"For comparison, run it without adaptation: {command_line(*baseline)}")


LIVE_VIEW: Final = "To watch the run live"
"""Beginning of the sentence that is omitted once the run has ended."""
VIEW_LOG: Final = "view.log"
ROS2_LOG: Final = "ros2.log"


def print_live_view_address(out: Path) -> None:
    """Print the address of the live view on standard error."""
    _print_lines(_log_lines(out / VIEW_LOG))


def print_observer_messages(out: Path) -> None:
    """Print the observers' final messages on standard error."""
    lines = [*_log_lines(out / VIEW_LOG), *_log_lines(out / ROS2_LOG)]
    _print_lines([line for line in lines if not line.startswith(LIVE_VIEW)])


def _log_lines(log: Path) -> list[str]:
    return printable(log.read_text(errors="replace")).splitlines() if log.is_file() else []


def _print_lines(lines: Sequence[str]) -> None:
    for line in lines:
        create_console(stderr=True).print(line)


def _result_table(result: RunResult) -> Table:
    """Return a row per robot and one for all; columns without values are left out."""
    cells: dict[str, Callable[[RobotResult | RunResult], str]] = {}
    metrics = {metric.column: metric for metric in result.declaration.metrics}
    for title, names in result.declaration.cells.items():
        columns = {name: metrics.get(name) for name in names}
        is_known = result.task.get(names[0]) is not None and any(map(result.task.get, names))
        if is_known or any(metric and metric.event for metric in columns.values()):
            cells[printable(title)] = partial(_task_cell, columns)
    if not result.is_simulated:
        cells["sent"] = lambda result: str(result.frames["frames_sent"])
        cells["heard"] = lambda result: str(result.frames["copies_heard"])
        if any(map(_lateness, result.per_robot.values())):
            cells["late p50, p99"] = _lateness
        cells[f"clock against {result.reference}"] = _clock
    table = Table("robot", *cells)
    table.columns[-1].no_wrap = True
    for robot, part in result.per_robot.items():
        own = [cell(part) for cell in cells.values()]
        if not result.is_simulated and robot == result.reference and len(part.clock) == 1:
            own[-1] = "reference"
        table.add_row(robot, *own)
    table.add_section()
    table.add_row("all", *(cell(result) for cell in cells.values()))
    return table


def _task_cell(columns: Mapping[str, Metric | None], part: RobotResult | RunResult) -> str:
    return " of ".join(_value_text(part.task.get(name), metric) for name, metric in columns.items())


def _value_text(value: Value, metric: Metric | None) -> str:
    if value is None:
        return "not finished" if metric and metric.event else "-"
    if isinstance(value, float):
        return f"{value:.1f} s" if metric and metric.unit == "s" else f"{value:g}"
    return printable(str(value))


def _lateness(part: RobotResult | RunResult) -> str:
    if isinstance(part, RunResult) or part.lateness_p50_ms is None:
        return ""
    return f"{part.lateness_p50_ms} ms, {part.lateness_p99_ms} ms"


def _clock(part: RobotResult | RunResult) -> str:
    """Return a line for each interval of the clock."""
    if isinstance(part, RunResult):
        return ""
    return "\n".join(
        "unknown" if one.error_s is None else f"{one.offset_s:+.4f} s ± {one.error_s * 1000:.2f} ms"
        for one in part.clock
    )


def _robots_text(result: RunResult) -> str:
    """Return the subject of a sentence: the robots, with strategy and navigation."""
    robots = "1 robot" if result.robots == 1 else f"{result.robots} robots"
    if not result.is_simulated:
        return robots
    by = f" with strategy {printable(result.origin.strategy)}" if result.origin.strategy else ""
    if by and result.origin.navigation:
        by += f" and navigation {printable(result.origin.navigation)}"
    return robots + by


def _radio_sentences(result: RunResult) -> Iterator[str]:
    """Yield sentences on the outcomes of frames."""
    counts = result.frames
    sent = counts.get("frames_sent", 0)
    if not sent:
        yield "Radio: no frames sent."
    else:
        lost = _named_counts(counts, "copies_lost_")
        known = f", {sum(lost.values())} lost{_causes(lost)}" if lost or result.is_simulated else ""
        heard = counts.get("copies_heard", 0)
        yield f"Radio: {_frames(sent)} sent; at other robots: {heard} received{known}."
    not_sent = {
        name: count for name, count in _named_counts(counts, "frames_").items() if name not in _NOT_LOST
    }
    if not_sent:
        yield f"Radio: {_frames(sum(not_sent.values()))} not sent{_causes(not_sent)}."
    if missed := _named_counts(counts, "events_"):
        yield f"Radio: events missed by robots: {sum(missed.values())}{_causes(missed)}."
    if result.is_simulated and result.direct_reach is not None:
        yield f"Pairs of robots in direct radio range: {result.direct_reach:.0%} of the time."


def _driving_sentences(result: RunResult) -> Iterator[str]:
    """Yield sentences on bumper contacts, localisation errors and navigation goals."""
    contacts = result.contacts or 0
    yield f"Bumper contacts: {contacts or 'none'}."
    if optional_value(result.people_contacts) is not None:
        lasted = f", {result.people_contact_s:.1f} s in total" if result.people_contacts else ""
        yield f"Contacts with people: {result.people_contacts or 'none'}{lasted}."
    errors = [part.pose_error for part in result.per_robot.values() if part.pose_error.samples]
    if errors:
        samples = sum(error.samples for error in errors)
        rmse = math.sqrt(sum(error.rmse**2 * error.samples for error in errors) / samples)
        lost = sum(error.times_lost for error in errors)
        yield (
            f"Localisation error{_in_brackets(result.origin.localisation)}: RMSE {rmse:.2f} m, "
            f"maximum {max(error.greatest for error in errors):.2f} m; "
            f"{f'robots lost their position {_times_text(lost)}' if lost else 'no robot lost its position'}."
        )
    goals = result.navigation
    if goals.goals:
        why = {name: count for name, count in goals.aborted.items() if count}
        yield (
            f"Navigation{_in_brackets(result.origin.navigation)}: {goals.goals} "
            f"{'goal' if goals.goals == 1 else 'goals'}, {sum(why.values()) or 'none'} aborted{_causes(why)}"
            f"{_ORIGINAL if result.origin.navigation == 'chapter' else ''}."
        )


def _named_counts(counts: Mapping[str, int], prefix: str) -> dict[str, int]:
    """Return the non-zero counters with this prefix, named in words."""
    return {
        name.removeprefix(prefix).replace("_", " "): count
        for name, count in counts.items()
        if name.startswith(prefix) and count
    }


def _in_brackets(preset: str) -> str:
    """Return a preset's name in brackets; empty for results without it."""
    return f" (preset {printable(preset)})" if preset else ""


def _causes(counts: Mapping[str, int]) -> str:
    """Return causes in brackets, the most frequent first; empty if there are none."""
    ordered = sorted(counts.items(), key=lambda one: -one[1])
    return f" ({', '.join(f'{count} {name}' for name, count in ordered)})" if ordered else ""


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _times_text(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
