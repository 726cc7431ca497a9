"""Doors of a floor: narrow places between regions, and the straight line that closes one."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor import raster
from actors.floor.grid import Cell, OccupancyGrid, nearest_cell, passable
from actors.floor.raster import squared_distance
from actors.geometry import Door, Point
from actors.portable import arrays
from actors.runtime.errors import AcrcError

ROOM: Final = 0.8
"""Wide is where the walls are so far from the middle, m. Own choice: in the corridor map's necks, 1.5 m wide,
robots of 0.35 m that meet head-on stop for good, for the chapter's local planner keeps to the middle."""


@dataclass(frozen=True, eq=False)
class Regions:
    """A floor taken apart."""

    labels: NDArray[np.int32]
    """(rows, columns): 0 where the robot's centre cannot be, 1 to `count` in that region, `count` + 1 + index
    in that door."""
    count: int
    """How many regions there are."""
    doors: tuple[Door, ...]
    """In the order of their southernmost, then westernmost cells."""


def regions(
    grid: OccupancyGrid, passable: NDArray[np.bool_], clearance: NDArray[np.float64], room: float = ROOM
) -> Regions:
    """The regions of the `passable` cells, (rows, columns), with their `clearance`, m, and the doors between.

    Passable floor without any wide place, if it is on its own, is a region, too.
    """
    wide = passable & (clearance >= room)
    rim = room - float(clearance[passable].min(initial=room)) + grid.resolution
    opened = passable & (squared_distance(wide) <= (rim / grid.resolution) * (rim / grid.resolution))
    labels = raster.regions(opened)
    count = int(labels.max())
    narrow = raster.regions(passable & ~opened)
    doors: list[Door] = []
    named = labels.copy()
    for number in range(1, int(narrow.max()) + 1):
        cells = narrow == number
        touched = touching(labels, cells)
        if len(touched) > 1:
            row, column = divmod(int(np.argmax(np.where(cells, clearance, 0.0))), grid.columns)
            doors.append(Door(len(doors), grid.centre(Cell(row, column)), touched))
            named[cells] = -len(doors)
            continue
        if not touched:
            count += 1
        named[cells] = touched[0] if touched else count
    named = np.where(named < 0, count - named, named).astype(np.int32)
    named.setflags(write=False)
    return Regions(named, count, tuple(doors))


def touching(labels: NDArray[np.int32], cells: NDArray[np.bool_]) -> tuple[int, ...]:
    """The labels of regions and doors beside these cells, ascending."""
    beside = np.zeros_like(cells)
    beside[1:] |= cells[:-1]
    beside[:-1] |= cells[1:]
    beside[:, 1:] |= cells[:, :-1]
    beside[:, :-1] |= cells[:, 1:]
    return tuple(int(label) for label in np.unique(labels[beside]) if label > 0)


_WITHIN: Final = 0.5
"""A point is of a door whose cells are so near, m."""
_DIRECTIONS: Final = 16
"""Lines are looked at in so many directions, from east to west by north."""
_STRAIGHT: Final = 0.8
"""A line counts if it is hardly longer than twice the room at its middle: others cut corners off."""
_SAMPLES: Final = 4
"""So many points of each cell's length of a line are looked at."""


class DoorError(AcrcError):
    """A door that there is not, or that no straight line closes."""


class Doorways:
    """The doors of one floor, for robots of one radius, m, and what closes them."""

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        self._grid = grid
        self._radius = radius

    @cached_property
    def regions(self) -> Regions:
        """The floor taken apart."""
        return regions(self._grid, passable(self._grid, self._radius), self._grid.clearance)

    def at(self, point: Point) -> Door:
        """The door that a point lies in, or is no farther from than 0.5 m. Raises DoorError."""
        parts = self.regions
        cell = nearest_cell(self._grid, parts.labels > parts.count, point, _WITHIN)
        if cell is None:
            known = ", ".join(f"({door.middle.x:.2f}, {door.middle.y:.2f})" for door in parts.doors)
            has = f"its doors are at {known}" if known else "it has none"
            raise DoorError(f"({point.x:g}, {point.y:g}) is in no door of the map; {has}")
        return parts.doors[int(parts.labels[cell]) - parts.count - 1]

    def closed(self, door: Door) -> NDArray[np.bool_]:
        """(rows, columns): the cells that the door fills once it is closed. Raises DoorError.

        They hang together over their edges, so nothing gets or looks through.
        """
        inside = self.regions.labels == self.regions.count + 1 + door.index
        begin, end = self._lines(inside)
        length = arrays.hypot(*(end - begin).T)
        for number in np.argsort(length, kind="stable").tolist():
            filled = self._filled(begin[number], end[number])
            if self._parts(inside & ~filled, door):
                return filled
        x, y = door.middle
        raise DoorError(f"the narrow place at ({x:.2f}, {y:.2f}) cannot be closed by a straight door")

    def leaf(self, closed: NDArray[np.bool_]) -> tuple[Point, Point]:
        """The two of a closed door's cells that are farthest from each other: where it ends, m."""
        rows, columns = np.nonzero(closed)
        gaps = arrays.hypot((rows[:, None] - rows).astype(float), (columns[:, None] - columns).astype(float))
        ends = np.unravel_index(int(gaps.argmax()), gaps.shape)
        one, other = (self._grid.centre(Cell(int(rows[end]), int(columns[end]))) for end in ends)
        return one, other

    def _lines(self, inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(n, 2) each: row and column of the blocking cells that lines through the door's cells end in."""
        cells = np.argwhere(inside)
        room = self._grid.clearance[inside] / self._grid.resolution
        angles = np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS)
        begins, ends = [], []
        for along in np.stack([arrays.sin(angles), arrays.cos(angles)], axis=1):
            begin, end = self._met(cells, -along), self._met(cells, along)
            length = arrays.hypot(*(end - begin).T.astype(np.float64))
            straight = _STRAIGHT * length <= 2 * room + 1
            begins.append(begin[straight])
            ends.append(end[straight])
        return np.concatenate(begins), np.concatenate(ends)

    def _met(self, cells: NDArray[np.int64], along: NDArray[np.float64]) -> NDArray[np.int64]:
        """The first blocking cell on the way from each cell; the last one looked at where there is none."""
        blocking = np.pad(self._grid.blocking, 1, constant_values=True)
        shape = np.array(self._grid.cells.shape)
        met, going = cells.copy(), np.ones(len(cells), np.bool_)
        for step in range(1, int(2 * ROOM / self._grid.resolution) + 2):
            here = np.floor(cells + along * step + 0.5).astype(np.int64)
            met[going] = np.clip(here[going], -1, shape)
            going &= ~blocking[met[:, 0] + 1, met[:, 1] + 1]
        return met

    def _filled(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.bool_]:
        """The free cells on a line; where it goes on over a corner, the cell beside, too."""
        count = int(np.abs(end - begin).max()) * _SAMPLES + 1
        line = np.floor(np.linspace(begin, end, count) + 0.5).astype(np.int64)
        corners = np.stack([line[:-1, 0], line[1:, 1]], axis=1)
        rows, columns = np.concatenate([line, corners]).T
        on_map = (rows >= 0) & (columns >= 0) & (rows < self._grid.rows) & (columns < self._grid.columns)
        filled = np.zeros(self._grid.cells.shape, np.bool_)
        filled[rows[on_map], columns[on_map]] = True
        return filled & self._grid.free

    def _parts(self, left: NDArray[np.bool_], door: Door) -> bool:
        """True if what is left of a door's cells joins not all that the door joined."""
        rows, columns = np.nonzero(left)
        if not rows.size:
            return True
        south, west = max(int(rows.min()) - 1, 0), max(int(columns.min()) - 1, 0)
        around = np.s_[south : int(rows.max()) + 2, west : int(columns.max()) + 2]
        pieces = raster.regions(left[around])
        labels = self.regions.labels[around]
        touched = (touching(labels, pieces == number) for number in range(1, int(pieces.max()) + 1))
        return not any(set(door.regions).issubset(labels) for labels in touched)
