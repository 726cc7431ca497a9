"""A timeline of some steps: a run is watched, its picture written, and told what it comes to."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from rich.table import Table

from actors.installation.usage import wrong_value
from benchmarks.statistics.measured import Measured
from benchmarks.swarm.task import SwarmTask
from benchmarks.swarm.timeline import trace_file
from benchmarks.swarm.timeline.shares import StepShares, shares
from benchmarks.swarm.timeline.watching import watch

STEPS: Final = 20
"""Steps that are watched; own choice: two simulated seconds, in which each robot has talked twice."""
ROBOTS: Final = 50
SECONDS: Final = 20.0
"""Simulated time of a run, unless it is said; robots have found their ways by its middle."""


def draw(robots: Sequence[int], seconds: float, path: Path, steps: int = STEPS) -> Measured:
    """Watch one swarm and write the file. OptionError for several, and for a file that cannot be made."""
    if len(robots) != 1:
        raise wrong_value("--robots", " ".join(map(str, robots)), "one number with --timeline")
    trace_file.check(path)
    seen = watch(robots[0], SwarmTask(seconds=seconds, robot_seconds=None), steps)
    trace_file.write(seen, path)
    found = shares(seen)
    figures = asdict(found) | {"digest": seen.digest, "first_step": seen.window.first, "file": str(path)}
    return Measured(figures, _shown(found, seen.window.first, path))


def _shown(found: StepShares, first: int, path: Path) -> tuple[Table | str, ...]:
    title = (
        f"{found.robots} robots, a step of {found.step_ms:.1f} ms\n"
        f"ms, medians of {found.steps} steps from step {first} on"
    )
    table = Table("", "processes", "works", "its CPU", "waits", "CPU of all of them", title=title)
    for kind in found.kinds:
        sizes = (kind.works_ms, kind.works_cpu_ms, kind.waits_ms, kind.cpu_ms)
        table.add_row(kind.kind, str(kind.processes), *(f"{size:.2f}" for size in sizes))
    waits = ", ".join(f"{name} {ms:.2f} ms" for name, ms in found.world_waits_ms.items())
    last = found.slowest
    return (
        table,
        f"the world waits for: {waits}; from Senses to a robot that goes on: {found.delivery_ms:.2f} ms",
        f"idle at the barrier: {found.idle_share:.0%} of {found.cores} cores, {found.idle_ms:.2f} ms a step "
        f"(busy with something else: {found.others:.1f} cores; load before: {found.load:.1f})",
        f"slowest: {last.robot}, last in {last.steps} of {found.steps} steps; works {last.works_ms:.2f} ms, "
        f"all robots {last.robots_work_ms:.2f} ms; the last answer comes {last.behind_ms:.2f} ms after the "
        "median one",
        f"{path}: for Perfetto (ui.perfetto.dev) or chrome://tracing",
    )
