"""Last pose estimate of a robot, in a file that survives crashes and power loss."""

import os
from pathlib import Path
from typing import Final

import msgspec

from actors.geometry import ORIGIN, Pose
from actors.instant import Instant, seconds
from actors.messages import Odometry
from actors.runtime import regular_file
from actors.runtime.background import BackgroundWorker

SPREAD: Final = 0.3
"""Standard deviation of a stored pose, m and rad, due to PERIOD at 0.5 m/s. Own choice."""
FEEDBACK_LOSS_SPREAD: Final = 1.0
"""Increase of the spread after a loss of the base's feedback, m, as it may have driven on. Own choice: twice
that is 4 s at 0.5 m/s; after a longer motion the robot stands."""
PERIOD: Final = seconds(0.5)
"""Maximum age of the file while the robot drives."""
_MAX_FILE_BYTES: Final = 4096
_MAX_VALUE: Final = 1e6


class LastPose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pose estimate in the map frame, the odometry at that time, and the uncertainty."""

    pose: tuple[float, float, float]
    odometry: tuple[float, float, float]
    """Odometry of the base process that wrote the file."""
    spread: float = SPREAD
    """Standard deviation, m, and of the heading rad."""

    @property
    def origin(self) -> Pose:
        """Origin of that odometry, map frame."""
        return Pose(*self.pose).compose(Pose(*self.odometry).relative(ORIGIN))


def read(path: Path) -> LastPose | None:
    """Read a file; None if it is missing or invalid."""
    try:
        with path.open("rb") as file:
            last = msgspec.json.decode(file.read(_MAX_FILE_BYTES), type=LastPose)
    except (OSError, msgspec.DecodeError):
        return None
    numbers = (*last.pose, *last.odometry, last.spread)
    valid = all(abs(number) <= _MAX_VALUE for number in numbers) and last.spread > 0
    return last if valid else None


def write(path: Path, last: LastPose) -> None:
    """Replace the file atomically, also on power loss. Raises OSError.

    On a full disk the file is overwritten in place, as an outdated pose would mislead the next start.
    """
    data = msgspec.json.encode(last)
    try:
        regular_file.write_atomically(path, data, durable=True)
    except OSError:
        with path.open("r+b") as file:
            file.write(data)
            file.truncate()
            file.flush()
            os.fsync(file.fileno())


class PoseWriter:
    """Writer of the file in one base process."""

    def __init__(self, path: Path, started: Instant) -> None:
        """Read the file and rewrite its pose with this process's odometry, which starts at 0."""
        self._path = path
        self._due = started
        self._background = BackgroundWorker()
        self.initial = read(path)
        if self.initial is not None:
            self._write(LastPose(self.initial.pose, (0.0, 0.0, 0.0), self.initial.spread))

    def store(self, now: Instant, pose: Pose, odometry: Odometry) -> None:
        """Store the pose if PERIOD has passed; does not block."""
        if now < self._due:
            return
        self._due = Instant(now + PERIOD)
        self._write(LastPose((pose.x, pose.y, pose.heading), (odometry.x, odometry.y, odometry.heading)))

    def add_spread(self, spread: float) -> None:
        """Increase the stored spread, m."""
        self._background.close()
        if (last := read(self._path)) is not None:
            write(self._path, msgspec.structs.replace(last, spread=last.spread + spread))

    def close(self) -> None:
        """Finish pending writes."""
        self._background.close()

    def _write(self, last: LastPose) -> None:
        self._background.submit(lambda: write(self._path, last))
