"""`acrc bench growth`: the sizes are measured, and two tables printed."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from benchmarks.swarm.growth.measuring import ROBOTS, MeshTotals, SizeFigures, measured, memory_mb
from benchmarks.swarm.task import SwarmTask

SIZES: Final = (1, 2, 5, 10, 20, 50, 100, 200)
SECONDS: Final = 10.0
"""Simulated time of every run, for all sizes alike: in it the relays of all robots have become regular."""
_PARTS: Final = 12
"""So many parts are shown: those that cost most with the largest swarm."""


def run(robots: Sequence[int] = SIZES, seconds: float = SECONDS, json_output: bool = False) -> dict[str, Any]:
    """Measure, print and give the figures."""
    task = SwarmTask(tuple(robots), seconds, robot_seconds=None, repeat=1)
    sizes = measured(task)
    figures = {
        "task": asdict(task) | {"scenario": str(task.scenario)},
        "sizes": [asdict(size) for size in sizes],
    }
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        _show(sizes, task)
    return figures


def _show(sizes: Sequence[SizeFigures], task: SwarmTask) -> None:
    console = Console(width=140)
    console.print(_totals(sizes, task))
    console.print(_traffic(sizes))
    console.print(_parts(sizes))


def _totals(sizes: Sequence[SizeFigures], task: SwarmTask) -> Table:
    title = (
        f"{task.scenario.name}, {task.seconds:g} s simulated: CPU ms per robot and simulated second; "
        "memory (PSS) of one process, MB"
    )
    names = ("in memory", "world", "radio", "robots", "over Zenoh", "x real time", "start s")
    table = Table("robots", *names, "a robot MB", "world MB", "radio MB", "load", title=title)
    for size in sizes:
        actors = (size.of(actor) for actor in ("world", "radio", ROBOTS))
        table.add_row(
            str(size.robots),
            *(f"{ms:.2f}" for ms in (size.ms, *actors)),
            *_mesh_cells(size.mesh),
            f"{size.load:.1f}",
        )
    return table


def _mesh_cells(mesh: MeshTotals | None) -> list[str]:
    if mesh is None:
        return ["-"] * 6
    sizes = (memory_mb(mesh.memory, kind) for kind in (ROBOTS, "world", "radio"))
    return [
        f"{mesh.ms:.2f}",
        f"{mesh.real_time_factor:.2f}",
        f"{mesh.start_s:.1f}",
        *(f"{size:.1f}" for size in sizes),
    ]


def _traffic(sizes: Sequence[SizeFigures]) -> Table:
    title = "the air, per robot and simulated second"
    names = ("published", "frames sent", "copies computed", "frames heard", "packets", "news", "no news")
    table = Table("robots", *names, title=title)
    for size in sizes:
        of = size.traffic
        table.add_row(
            str(size.robots),
            *(
                f"{rate:.2f}"
                for rate in (of.published, of.frames, of.copies, of.heard, of.packets, of.news, of.stale)
            ),
        )
    return table


def _parts(sizes: Sequence[SizeFigures]) -> Table:
    """The parts that cost most with the largest swarm."""
    tables = [{(line.actor, line.part): line.ms for line in size.lines} for size in sizes]
    title = "CPU by part in memory, ms per robot and simulated second"
    table = Table("", "part", *(str(size.robots) for size in sizes), title=title)
    for key in sorted(tables[-1], key=lambda key: -tables[-1][key])[:_PARTS]:
        table.add_row(*key, *(f"{one.get(key, 0.0):.3f}" for one in tables))
    return table
