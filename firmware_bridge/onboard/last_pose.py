"""Where a robot last held itself to be, in a file that outlives its processes and a loss of power."""

import math
import os
from pathlib import Path
from typing import Final

import msgspec

from actors.geometry import Pose
from actors.instant import Duration, Instant, seconds
from actors.messages import Odometry
from actors.runtime import regular_file
from actors.runtime.background import Background

SPREAD: Final = 0.3
"""Of what is known, m, and rad for the heading: what PERIOD leaves open at 0.5 m/s. Own choice."""
UNHEARD: Final = 1.0
"""So much is added to the spread for a base that was not heard, m: it may have driven on as last told. Own
choice: twice that is 4 s at 0.5 m/s; where it went farther, it stands."""
PERIOD: Final[Duration] = seconds(0.5)
"""The file is that old at most while the robot drives."""
_LONGEST: Final = 4096
_FARTHEST: Final = 1e6


class LastPose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pose in the map frame, what the odometry said there, and how far both may be trusted."""

    pose: tuple[float, float, float]
    odometry: tuple[float, float, float]
    """Of the base process that has written it, and of no other."""
    spread: float = SPREAD
    """Standard deviation, m, and of the heading rad."""

    @property
    def origin(self) -> Pose:
        """Where that odometry began, map frame."""
        return Pose(*self.pose).compose(Pose(*self.odometry).relative(Pose(0.0, 0.0, 0.0)))


def read(path: Path) -> LastPose | None:
    """What a file says; None if there is none, or it cannot be believed."""
    try:
        with path.open("rb") as file:
            last = msgspec.json.decode(file.read(_LONGEST), type=LastPose)
    except (OSError, msgspec.DecodeError):
        return None
    numbers = (*last.pose, *last.odometry, last.spread)
    sound = all(math.isfinite(number) and abs(number) <= _FARTHEST for number in numbers) and last.spread > 0
    return last if sound else None


def write(path: Path, last: LastPose) -> None:
    """Replace the file; after a loss of power it is the old one or the new one. Raises OSError.

    On a full disk the file is written over: an old pose would be believed at the next start.
    """
    data = msgspec.json.encode(last)
    try:
        regular_file.write(path, data, durable=True)
    except OSError:
        with path.open("r+b") as file:
            file.write(data)
            file.truncate()
            file.flush()
            os.fsync(file.fileno())


class PoseKeeper:
    """One base process's hold on the file."""

    def __init__(self, path: Path, started: Instant) -> None:
        """What is there becomes a pose of this process, whose odometry begins at 0."""
        self._path = path
        self._due = started
        self._background = Background()
        self.begun = read(path)
        if self.begun is not None:
            self._write(LastPose(self.begun.pose, (0.0, 0.0, 0.0), self.begun.spread))

    def keep(self, now: Instant, pose: Pose, odometry: Odometry) -> None:
        """Write, if it is due; never waits."""
        if now < self._due:
            return
        self._due = Instant(now + PERIOD)
        self._write(LastPose((pose.x, pose.y, pose.heading), (odometry.x, odometry.y, odometry.heading)))

    def doubt(self, spread: float) -> None:
        """What is known may be wrong by so much more, m."""
        self._background.close()
        if (last := read(self._path)) is not None:
            write(self._path, msgspec.structs.replace(last, spread=last.spread + spread))

    def close(self) -> None:
        """Wait for what is still to be written."""
        self._background.close()

    def _write(self, last: LastPose) -> None:
        self._background.do(lambda: write(self._path, last))
