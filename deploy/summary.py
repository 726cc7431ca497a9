"""A run's result for people, or as JSON for programs."""

import sys
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from deploy.result import RunResult


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
    frames = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in result.frames.items() if count)
    console.print(f"radio: {frames or 'silence'}", highlight=False)
    console.print(f"contacts: {result.contacts}", highlight=False)
    for sentence in result.refused_orders:
        console.print(f"order refused {sentence}", style="bold red", highlight=False, markup=False)
    if result.undelivered or result.unread:
        console.print(
            f"{result.undelivered} messages were not delivered and {result.unread} not read", style="bold red"
        )
    console.print(f"digest {result.digest}\nrecorded in {result.out}", highlight=False, soft_wrap=True)


def print_view(out: Path) -> None:
    """Say on standard error what the observer had to say, and how to see the run again."""
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    log = out / "view.log"
    if log.is_file():
        console.print(log.read_text().strip(), markup=False)
    viewer = Path(sys.executable).parent / "rerun"
    console.print(f"To see it again: {viewer} {out / 'view.rrd'}", markup=False)


def _table(result: RunResult) -> Table:
    table = Table("robot", "places", "done at")
    for robot, part in result.per_robot.items():
        table.add_row(robot, f"{part.places_done} of {part.places_total}", _instant(part.completion_s))
    table.add_section()
    table.add_row("all", f"{result.places_done} of {result.places_total}", _instant(result.completion_s))
    return table


def _instant(completion_s: float | None) -> str:
    return "not all" if completion_s is None else f"{completion_s:.1f} s"
