"""Whole runs in memory with an eye on the bus: where each robot truly was, and what it held and wanted."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.messages import DRIVE, TRUTH, Drive, Truth
from actors.runtime.bus import Delivery
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.memory_bus import MemoryBus
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from benchmarks.goal_log import SUBJECT, LoggedGoal
from deploy import swarm
from deploy.navigation_result import NavigationOutcome, navigation_outcome
from deploy.options import RunOptions
from deploy.result import RunResult
from deploy.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Tracks:
    """All robots of one run at the start of each step."""

    robots: tuple[str, ...]
    step_us: int
    true: NDArray[np.float64]
    """(steps, robots, 3): x, y in m and heading in rad, map frame, as the world has it."""
    held: NDArray[np.float64]
    """(steps, robots, 3): where the robot holds itself to be; NaN where it has not said so."""

    def index(self, instant: int) -> int:
        """The step that begins at the instant, or the last one before the end of the run."""
        return min(instant // self.step_us, len(self.true) - 1)


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """What there is to know about a run."""

    scenario: Scenario
    """With everything that was drawn."""
    result: RunResult
    tracks: Tracks
    goals: Mapping[str, list[LoggedGoal]]
    """The log of each robot's goals; none for a behaviour without such a log."""
    navigation: Mapping[str, NavigationOutcome]
    """What each robot's navigation has to say; robots without a word are absent."""


class Tracker:
    """Takes down what passes over the bus."""

    def __init__(self, bus: MemoryBus) -> None:
        self._held: dict[str, tuple[int, tuple[float, float, float]]] = {}
        self._rows: list[tuple[list[tuple[float, float, float]], list[tuple[float, float, float]]]] = []
        self._robots: tuple[str, ...] = ()
        bus.listen(at(DRIVE, "*"), self._take_drive)
        bus.listen(at(TRUTH), self._take_truth)

    def tracks(self, step_us: int) -> Tracks:
        """Everything so far; there must have been a step."""
        rows = np.array(self._rows, dtype=np.float64)
        return Tracks(self._robots, step_us, rows[:, 0], rows[:, 1])

    def _take_drive(self, delivery: Delivery) -> None:
        drive = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(drive, Drive)
        if drive.pose is not None:
            self._held[_robot(delivery.key)] = (drive.step, drive.pose)

    def _take_truth(self, delivery: Delivery) -> None:
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        if truth.halt:
            return
        self._robots = tuple(robot.id for robot in truth.robots)
        true = [(robot.x, robot.y, robot.heading) for robot in truth.robots]
        self._rows.append((true, [self._held_at(robot, truth.step) for robot in self._robots]))

    def _held_at(self, robot: str, step: int) -> tuple[float, float, float]:
        said = self._held.get(robot)
        return said[1] if said is not None and said[0] == step else (np.nan, np.nan, np.nan)


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
        scenario,
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
