"""A course in one file that any AMCL can be fed from; docs/localisation-log.md describes its fields."""

import io
import json
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import ValidationError

from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.map_header import MapError
from actors.geometry import Pose, wrap
from actors.messages import NO_ECHO_MM
from actors.robot_model import RangeSensor
from actors.runtime.errors import AcrcError
from benchmarks.localisation.course import Course

FORMAT: Final = "acrc-localisation-log"
VERSION: Final = 1
POSES: Final = "time_us,x,y,heading"
_WHEN: Final = (1980, 1, 1, 0, 0, 0)
"""Stands in every archive, so that equal courses give equal files."""
_MAP: Final = (
    "image: map.png\nresolution: {resolution!r}\norigin: [{x!r}, {y!r}, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


class CourseLogError(AcrcError):
    """A log that cannot be written or read."""


def write(file: Path, course: Course) -> None:
    """Write the course, but for its peers, who are only seen in the scans. Raises LogError."""
    sensor, start = course.sensor.model_dump(), list(course.start)
    about = {"format": FORMAT, "version": VERSION, "sensor": sensor, "start": start}
    rays = ",".join(f"r{i}" for i in range(course.sensor.rays))
    members: dict[str, str | bytes] = {
        "about.json": json.dumps(about, indent=2) + "\n",
        **map_members(course.grid),
        "odometry.csv": _table(POSES, course.instants, course.odometry),
        "truth.csv": _table(POSES, course.instants, course.truth),
        "scans.csv": _table(f"time_us,{rays}", course.stamps, course.scans),
    }
    pack(file, members)


def pack(file: Path, members: Mapping[str, str | bytes]) -> None:
    """Write the members as an archive; equal members give equal files. Raises LogError."""
    try:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in members.items():
                archive.writestr(zipfile.ZipInfo(name, _WHEN), content, zipfile.ZIP_DEFLATED)
    except OSError as error:
        raise CourseLogError(f"{file}: the log cannot be written: {error.strerror}.") from error


def map_members(grid: OccupancyGrid) -> dict[str, str | bytes]:
    """The floor plan as ROS map_server has it."""
    header = _MAP.format(resolution=grid.resolution, x=float(grid.origin.x), y=float(grid.origin.y))
    return {"map.yaml": header, "map.png": _image(grid)}


def _image(grid: OccupancyGrid) -> bytes:
    """As ROS map_saver: free 254, unknown 205, occupied 0, the north on top."""
    grey = np.zeros(grid.cells.shape, np.uint8)
    grey[grid.cells == FREE] = 254
    grey[grid.cells == UNKNOWN] = 205
    written = io.BytesIO()
    Image.fromarray(np.flipud(grey)).save(written, "PNG")
    return written.getvalue()


def _table(header: str, times: NDArray[np.int64], values: NDArray[Any]) -> str:
    """CSV; numbers as Python writes them, which reads back to the same bits."""
    rows = zip(times.tolist(), values.tolist(), strict=True)
    return "\n".join([header, *(f"{time},{','.join(map(repr, row))}" for time, row in rows), ""])


@dataclass(frozen=True)
class LogLimits:
    """How much of a log is read at most."""

    text_bytes: int = 400_000_000
    """Of a table: two hours of scans at 10 Hz with 640 rays have 350 MB."""
    small_bytes: int = 65_536
    """Of about.json and map.yaml."""
    image_bytes: int = 32_000_000
    """Of map.png, as it lies in the archive."""
    farthest: float = 1e6
    """No coordinate lies beyond this, m."""


def read(file: Path, limits: LogLimits = LogLimits()) -> Course:
    """The course in a log; the truth between its rows is interpolated. Raises LogError."""
    try:
        with zipfile.ZipFile(file) as archive:
            return _Log(file, archive, limits).course()
    except zipfile.BadZipFile as error:
        wrong = f"this is not a localisation log, which is a ZIP archive: {error}."
        raise CourseLogError(f"{file}: {wrong}") from error
    except (OSError, EOFError, zlib.error, RuntimeError, NotImplementedError, ValueError) as error:
        raise CourseLogError(f"{file}: the log cannot be read: {error}.") from error


class _Log:
    """One log while it is read."""

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
            peers=np.empty((len(instants), 0, 2)),
        )

    def _about(self) -> tuple[RangeSensor, Pose]:
        try:
            about = json.loads(self._bytes("about.json", self._limits.small_bytes))
        except (ValueError, RecursionError) as error:
            raise self._wrong(f"about.json is no JSON: {error}") from error
        if not isinstance(about, dict) or (about.get("format"), about.get("version")) != (FORMAT, VERSION):
            raise self._wrong(f'about.json must have "format": "{FORMAT}" and "version": {VERSION}')
        try:
            sensor = RangeSensor.model_validate(about.get("sensor"))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in ("sensor", *first["loc"]))
            raise self._wrong(f"in about.json, {key}: {first['msg']}") from error
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
        """The map, by way of a folder, as `load_map` wants it."""
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
            raise self._wrong(f"{name} has a value beyond ± {self._limits.farthest:g} or that is no number")
        beyond = (poses[:, 2] <= -np.pi) | (poses[:, 2] > np.pi)
        poses[beyond, 2] = [wrap(angle) for angle in poses[beyond, 2].tolist()]
        return times, poses

    def _scans(self, rays: int) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
        columns = ",".join(["time_us", *(f"r{i}" for i in range(rays))])
        times, ranges = self._numbers("scans.csv", columns)
        if not ((ranges >= 0) & (ranges <= NO_ECHO_MM) & (ranges == np.floor(ranges))).all():
            raise self._wrong(f"scans.csv has a range that is no whole number from 0 to {NO_ECHO_MM} mm")
        return times, ranges.astype(np.uint16)

    def _numbers(self, name: str, columns: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """A table's first column, times, and the rest."""
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
            raise self._wrong(f"{name} is no table of numbers: {error}") from error
        if table.shape[1] != columns.count(",") + 1:
            raise self._wrong(f"{name} has {table.shape[1]} columns, but its first line names others")
        times = table[:, 0]
        if not (np.isfinite(times) & (np.abs(times) < 2**53) & (times == np.floor(times))).all():
            raise self._wrong(f"{name} has a time_us that is no whole number")
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
    """The poses at other instants, headings the short way round."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.stack([np.interp(instants, stamps, column) for column in columns], axis=1)
