"""Where each robot of a run truly was at each step, and what it held and wanted: from a bus or records."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from actors.messages import DRIVE, TRUTH, Drive, Jam, RobotTruth, Truth
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from observation.evidence.recorded import taken

_Triple: TypeAlias = tuple[float, float, float]
_UNSAID: Final[_Triple] = (np.nan, np.nan, np.nan)


class TracksError(AcrcError):
    """A run that nobody can look into."""


class TimedJam(NamedTuple):
    """A jammer, from one instant until another one, µs."""

    begin: int
    jam: Jam


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
    stepping: NDArray[np.bool_]
    """(steps, robots): False where its process was ended or frozen."""
    busy: NDArray[np.bool_]
    """(steps, robots): False where it has said that it means to visit no place any more."""
    jams: tuple[TimedJam, ...] = ()

    def index(self, instant: int) -> int:
        """The step that begins at the instant, or the last one before the end of the run."""
        return min(instant // self.step_us, len(self.true) - 1)


class Tracker:
    """Takes down, step by step, what robots and world say."""

    def __init__(self, bus: MemoryBus | None = None) -> None:
        """`bus`: to listen to; None: messages are handed over."""
        self._drives: dict[str, Drive] = {}
        self._rows: list[list[tuple[_Triple, _Triple, _Triple]]] = []
        self._flags: list[list[tuple[bool, bool]]] = []
        self._busy: dict[str, bool] = {}
        self._robots: tuple[str, ...] = ()
        self._jams: list[TimedJam] = []
        if bus is not None:
            bus.listen(at(DRIVE, "*"), self._hear_drive)
            bus.listen(at(TRUTH), self._hear_truth)

    def tracks(self, step_us: int) -> Tracks:
        """Everything so far. Raises TracksError if there has been no step."""
        if not self._rows:
            raise TracksError("the run has taken no step")
        rows, flags = np.array(self._rows, dtype=np.float64), np.array(self._flags, dtype=np.bool_)
        parts = rows[:, :, 0], rows[:, :, 1], rows[:, :, 2], flags[:, :, 0], flags[:, :, 1]
        return Tracks(self._robots, step_us, *parts, tuple(self._jams))

    def drive(self, robot: str, drive: Drive) -> None:
        """What a robot answers in a step; before that step's truth."""
        self._drives[robot] = drive
        if drive.route is not None:
            self._busy[robot] = bool(drive.route)

    def truth(self, truth: Truth) -> None:
        """What the world says of a step."""
        if truth.halt:
            return
        self._robots = tuple(robot.id for robot in truth.robots)
        self._rows.append([self._row(robot, truth.step) for robot in truth.robots])
        self._flags.append([(robot.stepping, self._busy.get(robot.id, True)) for robot in truth.robots])
        self._jams += [TimedJam(truth.instant, jam) for jam in truth.jams]

    def _hear_drive(self, delivery: Delivery) -> None:
        drive = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(drive, Drive)
        self.drive(_robot(delivery.key), drive)

    def _hear_truth(self, delivery: Delivery) -> None:
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        self.truth(truth)

    def _row(self, true: RobotTruth, step: int) -> tuple[_Triple, _Triple, _Triple]:
        pose = (true.x, true.y, true.heading)
        drive = self._drives.get(true.id)
        if drive is None or drive.step != step:
            return pose, _UNSAID, _UNSAID
        return pose, drive.pose or _UNSAID, (drive.vx, drive.vy, drive.omega)


def recorded(recordings: Mapping[str, Path], step_us: int) -> Tracks:
    """The tracks of a run from the recordings of its world and its radio, by actor.

    Raises TracksError where one of them is missing, and RecordingError for a damaged one.
    """
    for actor in ("world", "radio"):
        if actor not in recordings:
            raise TracksError(f"there is no recording of the {actor}; must be a simulated run's folder")
    drives: dict[int, list[tuple[str, Drive]]] = {}
    for robot, drive in taken(recordings["world"], DRIVE):
        drives.setdefault(drive.step, []).append((robot, drive))
    tracker = Tracker()
    for _, truth in taken(recordings["radio"], TRUTH):
        for robot, drive in drives.pop(truth.step, ()):
            tracker.drive(robot, drive)
        tracker.truth(truth)
    return tracker.tracks(step_us)


def _robot(key: str) -> str:
    """The robot's id in a key of Drive."""
    head, _, tail = DRIVE.pattern.partition("{id}")
    return key[len(head) : len(key) - len(tail)]
