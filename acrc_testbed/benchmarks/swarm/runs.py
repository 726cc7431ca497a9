"""Runs of a full swarm for the benchmarks, and their CPU time in one process by package."""

import cProfile
import gc
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Final
from unittest.mock import patch

import numpy as np
from msgspec.structs import replace

from acrc_testbed.benchmarks.swarm.profiles import by_room, entries
from acrc_testbed.results.result import RunResult
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.installation.repository import SHIPPED
from actors.runtime.bus.memory_bus import MemoryBus, run_shells
from actors.runtime.shell import Shell
from deploy.run import memory_swarm, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.resolve import SpotError
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario

KINDS: Final = ("world", "radio", "robots")
"""Kinds of processes of a run; world and radio are one process each."""
_CLEARANCE: Final = 0.22
_APART: Final = 0.42
"""m, where the scenario's own distances leave no room; a TurtleBot is 0.354 m wide."""
_MEMORY_REPEATS: Final = 2


@dataclass(frozen=True)
class SwarmTask:
    """Sizes and length of the runs of one benchmark."""

    robots: tuple[int, ...] = (4, 20, 50, 100)
    seconds: float = 60.0
    """Simulated time of each run, at most."""
    robot_seconds: float | None = 800.0
    """Limit of robots times simulated seconds of each run; None: no limit.
    Own choice: the default swarms take less than five minutes on two cores."""
    repeat: int = 3
    """Measured runs over Zenoh, after one that reads memory and warms up the machine."""
    scenario: Path = SHIPPED / "scenarios" / "chapter.toml"
    seed: int | None = None
    """None: the scenario's."""

    def simulated_s(self, robots: int) -> float:
        """Return the simulated time of a run of `robots` robots; at least 2 s."""
        if self.robot_seconds is None:
            return self.seconds
        return min(self.seconds, max(2.0, float(self.robot_seconds // robots)))


@dataclass(frozen=True)
class Range:
    """Median, minimum and maximum over some runs."""

    median: float
    least: float
    greatest: float

    @staticmethod
    def of(values: Sequence[float]) -> "Range":
        """Return the range of at least one value."""
        return Range(median(values), min(values), max(values))


@contextmanager
def planned(count: int, task: SwarmTask, bus: str) -> Iterator[RunPlan]:
    """Plan a run in a temporary folder, which is deleted afterwards."""
    overrides = Overrides(robots=count, duration=task.simulated_s(count), seed=task.seed)
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus="memory" if bus == "memory" else "zenoh", json=True)
        scenario = load_scenario(task.scenario, overrides)
        try:
            plan = swarm.plan(scenario, options)
        except SpotError:  # the scenario draws starts 0.6 m apart: the corridor holds some 140
            plan = swarm.plan(_dense(scenario, count), options)
        yield plan


def _dense(scenario: Scenario, count: int) -> Scenario:
    """Return the scenario with drawn starts, as close to walls and each other as robots can stand."""
    grid = load_map(scenario.map)
    rng = np.random.default_rng(scenario.run.seed)
    points = draw_points(grid, count, rng=rng, clearance=_CLEARANCE, apart=_APART)
    starts = tuple((point.x, point.y, 0.0) for point in points)
    return replace(scenario, robots=replace(scenario.robots, start=starts))


@dataclass(frozen=True)
class MemoryFigures:
    """The swarm in one process."""

    real_time_factor: float
    ms: float
    """CPU per robot and simulated second, ms."""
    rooms: dict[str, float]
    """`ms` by package, shared out as in a profiled run."""
    simulated_s: float
    frames: dict[str, int]
    """Outcomes of frames, as in `RunResult.frames`."""
    node: dict[str, int]
    """Sums of the counters of all robots' nodes."""


def in_memory(count: int, task: SwarmTask) -> MemoryFigures:
    """Measure the fastest of some runs, and profile one more."""
    runs = [_timed(count, task) for _ in range(min(task.repeat, _MEMORY_REPEATS))]
    spent_ns, result = min(runs, key=itemgetter(0))
    ms = spent_ns / count / result.simulated_s / 1e6
    rooms = by_room(entries(profiled(count, task, MemoryBus())[0], "inlinetime"))
    total = sum(rooms.values())
    return MemoryFigures(
        real_time_factor=result.real_time_factor,
        ms=ms,
        rooms={room: ms * share / total for room, share in rooms.items()},
        simulated_s=result.simulated_s,
        frames=result.frames,
        node=result.deeco.counters,
    )


def memory_ms(count: int, task: SwarmTask) -> float:
    """Return the CPU of one run per robot and simulated second, ms."""
    spent_ns, result = _timed(count, task)
    return spent_ns / count / result.simulated_s / 1e6


def _timed(count: int, task: SwarmTask) -> tuple[int, RunResult]:
    """Run in memory; return the CPU from the first step to the last, ns, and the result."""
    spent: list[int] = []

    def timed(shells: Sequence[Shell], hold: Callable[[Shell], None]) -> None:
        began = time.thread_time_ns()
        run_shells(shells, hold)
        spent.append(time.thread_time_ns() - began)

    with planned(count, task, "memory") as plan, patch.object(memory_swarm, "run_shells", timed):
        result = swarm.run_in_memory(plan, lambda progress: None)
    return spent[0], result


def profiled(count: int, task: SwarmTask, bus: MemoryBus) -> tuple[cProfile.Profile, dict[str, float]]:
    """Profile a run in memory; return the profile and the bytes recorded by kind of actor."""
    with planned(count, task, "memory") as plan:
        profile = cProfile.Profile()
        gc.collect()  # free what an earlier run has left before this one is profiled
        profile.runcall(swarm.run_in_memory, plan, lambda progress: None, bus)
        return profile, recorded_bytes(plan.out)


def kind(actor: str) -> str:
    """Return the kind of process of an actor."""
    return actor if actor in KINDS else KINDS[-1]


def recorded_bytes(out: Path) -> dict[str, float]:
    """Return the size of a run's recordings by kind of actor."""
    sizes: defaultdict[str, float] = defaultdict(float)
    for file in out.glob("*/*.mcap"):
        sizes[kind(file.stem)] += file.stat().st_size
    return sizes
