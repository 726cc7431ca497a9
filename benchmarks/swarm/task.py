"""Which full swarms are measured, and how each run is laid out."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import Final

import numpy as np

from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.installation.repository import SHIPPED
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.placement import SpotError
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario

_CLEARANCE: Final = 0.22
_APART: Final = 0.42
"""m, where the scenario's own distances leave no room; a TurtleBot is 0.354 m wide."""


@dataclass(frozen=True)
class SwarmTask:
    """What is measured."""

    robots: tuple[int, ...] = (4, 20, 50, 100)
    seconds: float = 60.0
    """Simulated time of each run, at most."""
    robot_seconds: float | None = 800.0
    """Robots times simulated seconds of each run, at most, so that many robots end, too; None: no limit.
    Own choice: with it the default swarms take less than five minutes on two cores."""
    repeat: int = 3
    """Runs over Zenoh whose median counts, after one that weighs the processes and warms up the machine."""
    scenario: Path = SHIPPED / "scenarios" / "chapter.toml"
    seed: int | None = None
    """None: the scenario's."""

    def simulated_s(self, robots: int) -> float:
        """Simulated time of a run of so many robots; at least two seconds, whatever the budget."""
        if self.robot_seconds is None:
            return self.seconds
        return min(self.seconds, max(2.0, float(self.robot_seconds // robots)))


@dataclass(frozen=True)
class Range:
    """The median of some runs, the least and the greatest."""

    median: float
    least: float
    greatest: float

    @staticmethod
    def of(values: Sequence[float]) -> "Range":
        """Of at least one value."""
        return Range(median(values), min(values), max(values))


@contextmanager
def planned(count: int, task: SwarmTask, bus: str) -> Iterator[RunPlan]:
    """The run, in a folder that is gone afterwards."""
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
    """With every start given, as near to walls and each other as robots can stand."""
    grid = load_map(scenario.map)
    rng = np.random.default_rng(scenario.run.seed)
    points = draw_points(grid, count, rng=rng, clearance=_CLEARANCE, apart=_APART)
    starts = [(point.x, point.y, 0.0) for point in points]
    robots = scenario.robots.model_copy(update={"start": starts})
    return scenario.model_copy(update={"robots": robots})


def all_cpu_s() -> float:
    """CPU of this process and of all that it has started and that have ended, s."""
    children = getrusage(RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
