"""Canvas for drawing over time: a rerun recording, its timeline, and robots with colours."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.array_types import Floats, Singles
from actors.observer.glyphs import GREY, Colour, is_small_swarm
from actors.observer.glyphs import robot as robot_colour

TIMELINE: Final = "sim_time"
# Heights of the layers above the floor, m; higher layers cover lower ones.
ITEM: Final = 0.02
COSTS: Final = 0.03
INTENT: Final = 0.04
TRAIL: Final = 0.05
LINK: Final = 0.06
WAY: Final = 0.07
BODY: Final = 0.10
CLOUD: Final = 0.13
NOSE: Final = 0.16
LABEL: Final = 0.20
_ANGLES: Final = np.linspace(0, 2 * np.pi, 25)
CIRCLE: Final = np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))
"""(25, 2): closed circle of radius 1."""


class Canvas:
    """Drawing surface over time."""

    def __init__(self, recording: rr.RecordingStream, robots: Sequence[str], root: str = "") -> None:
        """`robots`: in scenario order, which determines colours. `root`: as in `ViewerContents`."""
        self.recording = recording
        self._root = root
        self.robots = tuple(robots)
        self.is_small_swarm = is_small_swarm(robots)
        self._index = {robot: number for number, robot in enumerate(robots)}

    def colour(self, robot: str) -> Colour:
        """Return a robot's colour; grey for an unknown robot."""
        number = self._index.get(robot)
        return GREY if number is None else robot_colour(number)

    def draw_static(self, path: str, drawn: Any) -> None:
        """Draw something for the whole run."""
        self.recording.log(f"{self._root}/{path}", drawn, static=True)

    def draw_at(self, second: float, path: str, drawn: Any) -> None:
        """Draw or replace something at an instant, s."""
        self.recording.set_time(TIMELINE, duration=_microseconds([second])[0])
        self.recording.log(f"{self._root}/{path}", drawn)

    def draw_columns(self, path: str, seconds: Sequence[float] | Floats, columns: Any) -> None:
        """Draw or replace something at many instants, s; one row of the columns for each."""
        if len(seconds):
            when = rr.TimeColumn(TIMELINE, duration=_microseconds(seconds))
            self.recording.send_columns(f"{self._root}/{path}", [when], columns)

    def draw_strips(
        self,
        path: str,
        seconds: Sequence[float] | Floats,
        rows: Iterable[Sequence[Any]],
        colours: Iterable[Sequence[Colour]] | None = None,
    ) -> None:
        """Draw or replace lines at many instants; `rows`: lines per instant, `colours`: one per line."""
        listed = [list(row) for row in rows]
        lengths = [len(row) for row in listed]
        flat = [np.asarray(strip, np.float32) for row in listed for strip in row]
        more: Any = {} if colours is None else {"colors": packed([one for row in colours for one in row])}
        if not flat:
            flat, more = [], {}
        self.draw_columns(path, seconds, rr.LineStrips3D.columns(strips=flat, **more).partition(lengths))


def _microseconds(seconds: Sequence[float] | Floats) -> NDArray[np.timedelta64]:
    """Convert s to whole microseconds."""
    return np.round(np.asarray(seconds, np.float64) * 1e6).astype("timedelta64[us]")


def packed(colours: Sequence[Colour]) -> NDArray[np.uint32]:
    """Pack colours into rerun's format, one integer each."""
    parts = np.array(colours, np.uint32).reshape(-1, 3)
    numbers = (parts[:, 0] << 24) | (parts[:, 1] << 16) | (parts[:, 2] << 8) | 0xFF
    return numbers.astype(np.uint32)


def ring(x: float, y: float, radius: float, height: float) -> Singles:
    """Return a circle as a line, (25, 3)."""
    return at_height(CIRCLE * radius + (x, y), height)


def at_height(points: NDArray[Any], height: float) -> Singles:
    """Return points of the floor, (k, 2), at a height, (k, 3)."""
    return np.column_stack((points, np.full(len(points), height))).astype(np.float32)


def quaternions(headings: Floats) -> Singles:
    """Return rotations about the vertical axis, (k, 4), by headings, (k,), rad."""
    none, half = np.zeros(len(headings)), headings / 2
    return np.column_stack((none, none, np.sin(half), np.cos(half))).astype(np.float32)
