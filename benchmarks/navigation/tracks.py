"""Whole runs in memory with an eye on the bus: where each robot truly was, and what it held and wanted."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.messages import DRIVE, TRUTH, Drive, RobotTruth, Truth
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from actors.world.world_setup import WorldSetup
from benchmarks.navigation.goal_log import SUBJECT, LoggedGoal
from deploy.results.navigation_result import NavigationOutcome, navigation_outcome
from deploy.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.tables import Scenario

_Triple: TypeAlias = tuple[float, float, float]
_UNSAID: Final[_Triple] = (np.nan, np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class Tracks:
    """All robots of one run at the start of each step."""

    robots: tuple[str, ...]
    step_us: int
    true: NDArray[np.float64]
    """(steps, robots, 3): x, y in m and heading in rad, map frame, as the world has it."""
    held: NDArray[np.float64]
    """(steps, robots, 3): where the robot holds itself to be; NaN where it has not said so."""
    wished: NDArray[np.float64]
    """(steps, robots, 3): the velocity that it asks for from then on, in its own frame: m/s, m/s, rad/s; NaN
    where it asks for none."""

    def index(self, instant: int) -> int:
        """The step that begins at the instant, or the last one before the end of the run."""
        return min(instant // self.step_us, len(self.true) - 1)


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """What there is to know about a run."""

    world: WorldSetup
    """What the world was told, with everything that was drawn."""
    result: RunResult
    tracks: Tracks
    goals: Mapping[str, list[LoggedGoal]]
    """The log of each robot's goals; none for a behaviour without such a log."""
    navigation: Mapping[str, NavigationOutcome]
    """What each robot's navigation has to say; robots without a word are absent."""


class Tracker:
    """Takes down what passes over the bus."""

    def __init__(self, bus: MemoryBus) -> None:
        self._drives: dict[str, Drive] = {}
        self._rows: list[list[tuple[_Triple, _Triple, _Triple]]] = []
        self._robots: tuple[str, ...] = ()
        bus.listen(at(DRIVE, "*"), self._take_drive)
        bus.listen(at(TRUTH), self._take_truth)

    def tracks(self, step_us: int) -> Tracks:
        """Everything so far; there must have been a step."""
        rows = np.array(self._rows, dtype=np.float64)
        return Tracks(self._robots, step_us, rows[:, :, 0], rows[:, :, 1], rows[:, :, 2])

    def _take_drive(self, delivery: Delivery) -> None:
        drive = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(drive, Drive)
        self._drives[_robot(delivery.key)] = drive

    def _take_truth(self, delivery: Delivery) -> None:
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        if not truth.halt:
            self._robots = tuple(robot.id for robot in truth.robots)
            self._rows.append([self._row(robot, truth.step) for robot in truth.robots])

    def _row(self, true: RobotTruth, step: int) -> tuple[_Triple, _Triple, _Triple]:
        pose = (true.x, true.y, true.heading)
        drive = self._drives.get(true.id)
        if drive is None or drive.step != step:
            return pose, _UNSAID, _UNSAID
        return pose, drive.pose or _UNSAID, (drive.vx, drive.vy, drive.omega)


def watch(scenario: Scenario) -> WatchedRun:
    """Run a scenario in this process, and watch. Raises an AcrcError where it cannot be run."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus="memory", json=True)
        plan = swarm.plan(scenario, options)
        bus = MemoryBus()
        tracker = Tracker(bus)
        result = swarm.run_in_memory(plan, lambda progress: None, bus)
        records = {robot.id: plan.folder(robot.id) / f"{robot.id}.mcap" for robot in plan.world.robots}
        said = {robot: _outcome(record) for robot, record in records.items()}
    navigation = {robot: navigation_outcome(records[robot], outcome) for robot, outcome in said.items()}
    return WatchedRun(
        plan.world,
        result,
        tracker.tracks(plan.world.step_us),
        {robot: _goals(outcome) for robot, outcome in said.items()},
        {robot: outcome for robot, outcome in navigation.items() if outcome is not None},
    )


def _outcome(record: Path) -> dict[str, msgspec.Raw]:
    return msgspec.json.decode(read_notes(record)["final"], type=FinalNote).outcome


def _goals(outcome: Mapping[str, msgspec.Raw]) -> list[LoggedGoal]:
    return msgspec.json.decode(outcome[SUBJECT], type=list[LoggedGoal]) if SUBJECT in outcome else []


def _robot(key: str) -> str:
    """The robot's id in a key of Drive."""
    head, _, tail = DRIVE.pattern.partition("{id}")
    return key[len(head) : len(key) - len(tail)]
