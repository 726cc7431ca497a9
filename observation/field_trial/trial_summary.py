"""A field trial's result for people, or as JSON for programs."""

import sys
from collections.abc import Iterator

import msgspec
from rich.table import Table

from actors.console import print_table, screen
from actors.runtime.errors import printable
from observation.field_trial.aligned_clocks import ClockReport
from observation.field_trial.trial_result import RobotTrial, TrialResult


def print_field_trial(result: TrialResult, *, json: bool) -> None:
    """Print the result on standard output; as JSON, it is the only thing there."""
    if json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
        return
    console = screen()
    print_table(console, _table(result))
    for sentence in _sentences(result):
        console.print(sentence)
    for note in result.notes:
        console.print(printable(note), style="yellow")
    if result.out is not None:
        console.print(f"written to {result.out}")


def _table(result: TrialResult) -> Table:
    """A row per robot and one for all; columns for what nobody has only where somebody has it."""
    gave_up, late = result.places_given_up > 0, any(map(_lateness, result.per_robot.values()))
    table = Table("robot", "reported", *(("given up",) if gave_up else ()), "all at")
    for name in ("sent", "heard", *(("late p50, p99",) if late else ())):
        table.add_column(name)
    table.add_column(f"clock against {result.reference}", no_wrap=True)

    def add(name: str, of: RobotTrial | TrialResult, lateness: str, clock: str) -> None:
        table.add_row(
            *(name, f"{of.places_claimed} of {of.places_total}"),
            *((str(of.places_given_up),) if gave_up else ()),
            "not all" if of.completion_s is None else f"{of.completion_s:.1f} s",
            *(str(of.frames["frames_sent"]), str(of.frames["copies_heard"])),
            *((lateness,) if late else ()),
            clock,
        )

    for robot, part in result.per_robot.items():
        add(robot, part, _lateness(part), _clock(part.clock, is_reference=robot == result.reference))
    table.add_section()
    add("all", result, "", "")
    return table


def _lateness(robot: RobotTrial) -> str:
    if robot.lateness_p50_ms is None:
        return ""
    return f"{robot.lateness_p50_ms} ms, {robot.lateness_p99_ms} ms"


def _clock(segments: tuple[ClockReport, ...], *, is_reference: bool) -> str:
    """A line for each segment."""
    if is_reference and len(segments) == 1:
        return "itself"
    return "\n".join(map(_segment, segments))


def _segment(clock: ClockReport) -> str:
    if clock.error_s is None:
        return "unknown"
    return f"{clock.offset_s:+.4f} s ± {clock.error_s * 1000:.2f} ms"


def _sentences(result: TrialResult) -> Iterator[str]:
    yield f"{result.duration_s:.1f} s from the first step of all to the last"
    if result.completion_s is None and result.settled_s is not None:
        yield f"every place was reported or given up by {result.settled_s:.1f} s"
    if result.places_done is not None:
        yield f"truly: {result.places_done} of {result.places_total} places done, {result.contacts} contacts"
    if result.places_lost:
        places = "1 place was" if result.places_lost == 1 else f"{result.places_lost} places were"
        yield f"{places} lost: neither reported nor given up, and in nobody's route"
    frames = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in result.frames.items() if count)
    yield f"radio: {frames or 'silence'}"
