"""`acrc bench budget`: what one robot's step costs in memory and over Zenoh, beside the kept table."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final, get_args

from rich.table import Table

from actors.console import screen
from actors.installation.repository import clone
from actors.installation.usage import OptionError, wrong_value
from benchmarks.statistics.measured import Measured
from benchmarks.swarm.counted import in_memory, over_mesh, table
from benchmarks.swarm.counted.in_memory import StepCounts
from benchmarks.swarm.counted.over_mesh import MeshCounts
from benchmarks.swarm.counted.steps import ROBOTS, SECONDS, CountedSteps
from deploy.run.options import Bus

_LEAST_S: Final = 3.0
_MOST_CALLED: Final = 25
_SHOWN: Final = 0.05
"""Of a robot-step; what is rarer is left out of the tables."""


def measure(bus: str | None = None, duration: float = SECONDS, write: bool = False) -> Measured:
    """Count on one bus, or on both; `duration`: simulated s, the first third of which does not count.

    `write`: keep the counts in memory as the table of this Python.
    """
    if bus is not None and bus not in get_args(Bus):
        raise wrong_value("--bus", bus, " or ".join(get_args(Bus)))
    if duration < _LEAST_S:
        raise wrong_value("--duration", f"{duration:g}", f"at least {_LEAST_S:g} for budget")
    if write and (bus == "zenoh" or duration != SECONDS):
        raise OptionError("--write: keeps counts in memory as a test repeats them; cannot be combined with "
                          "--bus zenoh or --duration")  # fmt: skip
    if write:
        clone("acrc bench budget --write")
    say, window = screen(stderr=True), CountedSteps(duration)
    figures: dict[str, Any] = {"robots": ROBOTS, "from_s": window.first_s, "to_s": window.seconds}
    shown: list[Table | str] = []
    if bus != "zenoh":
        say.print(f"{ROBOTS} robots in memory …")
        counts = in_memory.counted(window)
        blocks = in_memory.blocks(window)
        figures["memory"] = asdict(counts) | {"blocks": blocks}
        shown += _memory(counts, blocks, table.read() if duration == SECONDS else None)
        if write:
            table.TABLE.write_text(table.written(counts))
            shown.append(f"{table.TABLE.name} is written")
    if bus != "memory":
        say.print(f"{ROBOTS} robots over Zenoh …")
        mesh = over_mesh.counted(window)
        figures["zenoh"] = asdict(mesh)
        shown += _mesh(mesh)
    return Measured(figures, shown)


def _memory(counts: StepCounts, blocks: float, kept: StepCounts | None) -> list[Table | str]:
    tables: list[Table | str] = [
        _table(f"{words} per robot-step, in memory", getattr(counts, name), getattr(kept, name, None))
        for name, words in table.KEPT.items()
    ]
    most = dict(list(counts.functions.items())[:_MOST_CALLED])
    tables.insert(1, _table("the functions called most, per robot-step", most, None, whole=False))
    tables.append(f"memory blocks allocated per robot-step, freed ones included: {blocks:.1f}")
    if kept is not None:
        tables += [*table.differences(counts, kept)] or [f"{table.TABLE.name} keeps the same, within 2 %"]
    return tables


def _mesh(counts: MeshCounts) -> list[Table | str]:
    shown: list[Table | str] = [_table("bytes recorded per robot-step, over Zenoh", counts.recorded, None)]
    if counts.system_calls is None:
        shown.append("system calls are not counted: that requires strace")
    else:
        shown.append(_table("system calls per robot-step, over Zenoh", counts.system_calls, None))
    switches = f"{counts.voluntary:.1f} voluntary, {counts.forced:.1f} forced"
    return [*shown, f"context switches per robot-step, over Zenoh: {switches}"]


def _table(
    title: str, counts: Mapping[str, float], kept: Mapping[str, float] | None, *, whole: bool = True
) -> Table:
    """The counts by name, with their sum if they are the `whole`, beside those that are kept."""
    rows = Table("", "now", *(("kept",) if kept is not None else ()), title=title)
    old = kept or {}
    lines = {name: (counts.get(name, 0.0), old.get(name, 0.0)) for name in {**counts, **old}}
    if whole:
        lines["all"] = (sum(counts.values()), sum(old.values()))
    for name, values in lines.items():
        if max(values) >= _SHOWN:
            rows.add_row(name, *(f"{value:.1f}" for value in values[: len(rows.columns) - 1]))
    return rows
