"""`acrc bench budget`: cost of one robot's step in memory and over Zenoh, beside the kept counts."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final, get_args

from rich.table import Table

from acrc_testbed.benchmarks.measured import Measured
from acrc_testbed.benchmarks.swarm import counts
from acrc_testbed.benchmarks.swarm.counts import ROBOTS, SECONDS, CountedSteps, MeshCounts, StepCounts
from actors.console import screen
from actors.installation.repository import clone
from actors.installation.usage import OptionError, wrong_value
from deploy.run.options import Bus

_LEAST_S: Final = 3.0
_MOST_CALLED: Final = 25
_SHOWN: Final = 0.05
"""Least count per robot-step in the tables."""


def measure(bus: str | None = None, duration: float = SECONDS, write: bool = False) -> Measured:
    """Count on one bus, or on both; `duration`: simulated s, of which the first third is not counted.

    `write`: keep the counts in memory as those of this version of Python.
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
        found, blocks = counts.counted(window), counts.blocks(window)
        figures["memory"] = asdict(found) | {"blocks": blocks}
        shown += _memory(found, blocks, counts.kept_counts() if duration == SECONDS else None)
        if write:
            counts.TABLE.write_text(counts.written(found))
            shown.append(f"{counts.TABLE.name} is written")
    if bus != "memory":
        say.print(f"{ROBOTS} robots over Zenoh …")
        mesh = counts.mesh_counted(window)
        figures["zenoh"] = asdict(mesh)
        shown += _mesh(mesh)
    return Measured(figures, shown)


def _memory(found: StepCounts, blocks: float, kept: StepCounts | None) -> list[Table | str]:
    tables: list[Table | str] = [
        _table(f"{words} per robot-step, in memory", getattr(found, name), getattr(kept, name, None))
        for name, words in counts.KEPT.items()
    ]
    most = dict(list(found.functions.items())[:_MOST_CALLED])
    tables.insert(1, _table("the functions called most, per robot-step", most, None, whole=False))
    tables.append(f"memory blocks allocated per robot-step, freed ones included: {blocks:.1f}")
    if kept is not None:
        tables += [*counts.differences(found, kept)] or [f"{counts.TABLE.name} keeps the same, within 2 %"]
    return tables


def _mesh(found: MeshCounts) -> list[Table | str]:
    shown: list[Table | str] = [_table("bytes recorded per robot-step, over Zenoh", found.recorded, None)]
    if found.system_calls is None:
        shown.append("system calls are not counted: that requires strace")
    else:
        shown.append(_table("system calls per robot-step, over Zenoh", found.system_calls, None))
    switches = f"{found.voluntary:.1f} voluntary, {found.forced:.1f} forced"
    return [*shown, f"context switches per robot-step, over Zenoh: {switches}"]


def _table(
    title: str, found: Mapping[str, float], kept: Mapping[str, float] | None, *, whole: bool = True
) -> Table:
    """Tabulate counts by name beside the kept ones, with the sum if they are the `whole`."""
    rows = Table("", "now", *(("kept",) if kept is not None else ()), title=title)
    old = kept or {}
    lines = {name: (found.get(name, 0.0), old.get(name, 0.0)) for name in {**found, **old}}
    if whole:
        lines["all"] = (sum(found.values()), sum(old.values()))
    for name, values in lines.items():
        if max(values) >= _SHOWN:
            rows.add_row(name, *(f"{value:.1f}" for value in values[: len(rows.columns) - 1]))
    return rows
