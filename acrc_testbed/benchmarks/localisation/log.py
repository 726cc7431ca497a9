"""Reader of localisation logs: courses in one file each, as docs/localisation-log.md describes them."""

import io
import json
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import MapError, load_map
from actors.geometry import Pose, wrap
from actors.messages import NO_ECHO_MM
from actors.robot_model import RangeSensor
from actors.runtime.errors import AcrcError
from actors.settings import decode

FORMAT: Final = "acrc-localisation-log"
VERSION: Final = 1
POSES: Final = "time_us,x,y,heading"


class CourseLogError(AcrcError):
    """A log that cannot be read."""


@dataclass(frozen=True, eq=False)
class Course:
    """Input of a localisation on one drive, with the ground truth. All arrays are in order of time."""

    grid: OccupancyGrid
    sensor: RangeSensor
    start: Pose
    """The true pose at the first odometry pose, m and rad, map frame."""
    instants: NDArray[np.int64]
    """(n,), µs: when the odometry was read."""
    odometry: NDArray[np.float64]
    """(n, 3): x, y, heading, m and rad, in the odometry's frame."""
    truth: NDArray[np.float64]
    """(n, 3): the true poses of these instants, m and rad, map frame."""
    stamps: NDArray[np.int64]
    """(k,), µs: when the scans were made."""
    scans: NDArray[np.uint16]
    """(k, rays), mm; NO_ECHO_MM = nothing within reach."""

    @property
    def origin(self) -> Pose:
        """Pose of the odometry frame in the map frame at the start."""
        return self.start.frame(Pose(*self.odometry[0].tolist()))


@dataclass(frozen=True)
class LogLimits:
    """Largest log that is read."""

    text_bytes: int = 400_000_000
    """Of a table: two hours of scans at 10 Hz with 640 rays have 350 MB."""
    small_bytes: int = 65_536
    """Of about.json and map.yaml."""
    image_bytes: int = 32_000_000
    """Of map.png, as it lies in the archive."""
    farthest: float = 1e6
    """No coordinate lies beyond this, m."""


def read(file: Path, limits: LogLimits = LogLimits()) -> Course:
    """Return the course of a log; ground truth is interpolated between rows. Raises CourseLogError."""
    try:
        with zipfile.ZipFile(file) as archive:
            return _Log(file, archive, limits).course()
    except zipfile.BadZipFile as error:
        wrong = f"this is not a localisation log, which is a ZIP archive: {error}."
        raise CourseLogError(f"{file}: {wrong}") from error
    except (OSError, EOFError, zlib.error, RuntimeError, NotImplementedError, ValueError) as error:
        raise CourseLogError(f"{file}: the log cannot be read: {error}.") from error


class _Log:
    """Reader of one log."""

    def __init__(self, file: Path, archive: zipfile.ZipFile, limits: LogLimits) -> None:
        self._file = file
        self._archive = archive
        self._limits = limits

    def course(self) -> Course:
        sensor, start = self._about()
        grid = self._grid()
        instants, odometry = self._poses("odometry.csv")
        stamps, truth = self._poses("truth.csv")
        if stamps[0] > instants[0] or stamps[-1] < instants[-1]:
            raise self._wrong(
                f"truth.csv goes from {stamps[0]} to {stamps[-1]} µs, but must hold all of odometry.csv, "
                f"{instants[0]} to {instants[-1]} µs"
            )
        if not np.array_equal(stamps, instants):
            truth = _between(instants, stamps, truth)
        scanned, scans = self._scans(sensor.rays)
        return Course(
            grid=grid,
            sensor=sensor,
            start=start,
            instants=instants,
            odometry=odometry,
            truth=truth,
            stamps=scanned,
            scans=scans,
        )

    def _about(self) -> tuple[RangeSensor, Pose]:
        try:
            about = json.loads(self._bytes("about.json", self._limits.small_bytes))
        except (ValueError, RecursionError) as error:
            raise self._wrong(f"about.json is not JSON: {error}") from error
        if not isinstance(about, dict) or (about.get("format"), about.get("version")) != (FORMAT, VERSION):
            raise self._wrong(f'about.json must have "format": "{FORMAT}" and "version": {VERSION}')
        try:
            sensor = decode(RangeSensor, about.get("sensor"), "sensor")
        except AcrcError as error:
            raise self._wrong(f"in about.json, {error}") from None
        start = about.get("start")
        if not isinstance(start, list) or len(start) != 3 or not all(map(self._is_near, start)):
            raise self._wrong(
                f"start in about.json is {start!r}, but must be x and y in m and a heading in rad"
            )
        return sensor, Pose(start[0], start[1], wrap(start[2]))

    def _is_near(self, value: Any) -> bool:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and abs(value) <= self._limits.farthest

    def _grid(self) -> OccupancyGrid:
        """Return the map; `load_map` reads it from a temporary folder."""
        with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
            header, image = Path(folder) / "map.yaml", Path(folder) / "map.png"
            header.write_bytes(self._bytes("map.yaml", self._limits.small_bytes))
            image.write_bytes(self._bytes("map.png", self._limits.image_bytes))
            try:
                return load_map(header)
            except MapError as error:
                raise self._wrong(str(error).replace(f"{folder}/", "").rstrip(".")) from error

    def _poses(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        times, poses = self._numbers(name, POSES)
        if not (np.abs(poses) <= self._limits.farthest).all():
            raise self._wrong(f"{name} has a value beyond ± {self._limits.farthest:g} or NaN")
        beyond = (poses[:, 2] <= -np.pi) | (poses[:, 2] > np.pi)
        poses[beyond, 2] = [wrap(angle) for angle in poses[beyond, 2].tolist()]
        return times, poses

    def _scans(self, rays: int) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
        columns = ",".join(["time_us", *(f"r{i}" for i in range(rays))])
        times, ranges = self._numbers("scans.csv", columns)
        if not ((ranges >= 0) & (ranges <= NO_ECHO_MM) & (ranges == np.floor(ranges))).all():
            raise self._wrong(f"scans.csv has a range that is not a whole number from 0 to {NO_ECHO_MM} mm")
        return times, ranges.astype(np.uint16)

    def _numbers(self, name: str, columns: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the first column of a table, times, and the other columns."""
        raw = self._bytes(name, self._limits.text_bytes)
        header, _, rows = raw.decode("ascii", "replace").partition("\n")
        if header.strip() != columns:
            short = columns if len(columns) < 80 else f"{columns[:30]}… with {columns.count(',')} rays"
            raise self._wrong(
                f"{name} begins with {header.strip()[:40]!r}, but its first line must be {short}"
            )
        if not rows.strip():
            raise self._wrong(f"{name} has no rows, but must have one at least")
        try:
            table = np.loadtxt(io.StringIO(rows), delimiter=",", comments=None, ndmin=2)
        except (ValueError, OverflowError) as error:
            raise self._wrong(f"{name} is not a table of numbers: {error}") from error
        if table.shape[1] != columns.count(",") + 1:
            raise self._wrong(f"{name} has {table.shape[1]} columns, but its first line names others")
        times = table[:, 0]
        if not (np.isfinite(times) & (np.abs(times) < 2**53) & (times == np.floor(times))).all():
            raise self._wrong(f"{name} has a time_us that is not a whole number")
        if (np.diff(times) <= 0).any():
            row = int(np.argmax(np.diff(times) <= 0)) + 2
            raise self._wrong(f"time_us in row {row} of {name} is not later than in the row before")
        return times.astype(np.int64), table[:, 1:]

    def _bytes(self, name: str, most: int) -> bytes:
        try:
            with self._archive.open(name) as member:
                content = member.read(most + 1)
        except KeyError:
            raise self._wrong(f"{name} is missing") from None
        if len(content) > most:
            raise self._wrong(f"{name} has more than the {most} bytes allowed")
        return content

    def _wrong(self, what: str) -> CourseLogError:
        return CourseLogError(f"{self._file}: {what}.")


def _between(
    instants: NDArray[np.int64], stamps: NDArray[np.int64], poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate poses at other instants, headings the short way round."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.stack([np.interp(instants, stamps, column) for column in columns], axis=1)
