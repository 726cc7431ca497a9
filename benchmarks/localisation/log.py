"""A course in one file that any AMCL can be fed from; docs/localisation-log.md describes its fields."""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
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


class LogError(AcrcError):
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
        raise LogError(f"{file}: the log cannot be written: {error.strerror}.") from error


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
