"""Doors of a floor: narrow passages between regions, and the straight lines that close them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import msgspec
import numpy as np

from actors.array_types import Flags, Floats, Int32s, Int64s
from actors.floor import raster
from actors.floor.grid import Cell, OccupancyGrid, nearest_cell, passable
from actors.floor.raster import squared_distance
from actors.geometry import Door, Point
from actors.portable import arrays
from actors.runtime.errors import AcrcError

ROOM: Final = 0.8
"""Distance from the walls above which floor counts as wide, m. Own choice: in the corridor map's passages,
1.5 m wide, two robots of 0.35 m that meet head-on stop for good, as the chapter's local planner keeps to the
middle."""


class Regions(msgspec.Struct, frozen=True, eq=False):
    """Partition of a floor into regions and doors."""

    labels: Int32s
    """(rows, columns): 0 where the robot's centre cannot be, 1 to `count` for regions, `count` + 1 + index
    for doors."""
    count: int
    """Number of regions."""
    doors: tuple[Door, ...]
    """Doors in the order of their southernmost, then westernmost cells."""


def regions(grid: OccupancyGrid, passable: Flags, clearance: Floats, room: float = ROOM) -> Regions:
    """Return regions and doors of the `passable` cells, (rows, columns), with their `clearance`, m.

    An isolated narrow area is a region, too.
    """
    wide = passable & (clearance >= room)
    rim = room - float(clearance[passable].min(initial=room)) + grid.resolution
    rim_cells = rim / grid.resolution
    squared_rim = rim_cells * rim_cells
    opened = passable & (squared_distance(wide, int(squared_rim) + 1) <= squared_rim)
    labels = raster.regions(opened)
    count = int(labels.max())
    narrow = raster.regions(passable & ~opened)
    doors: list[Door] = []
    numbers = [0]
    """By number of the narrow part: of its region; negative: of its door."""
    for number, adjacent in enumerate(adjacent_labels(labels, narrow), start=1):
        if len(adjacent) > 1:
            cells = narrow == number
            row, column = divmod(int(np.argmax(np.where(cells, clearance, 0.0))), grid.columns)
            doors.append(Door(len(doors), grid.centre(Cell(row, column)), adjacent))
            numbers.append(-len(doors))
            continue
        if not adjacent:
            count += 1
        numbers.append(adjacent[0] if adjacent else count)
    numbered = labels + np.array(numbers, np.int32)[narrow]
    numbered = np.where(numbered < 0, count - numbered, numbered).astype(np.int32)
    numbered.setflags(write=False)
    return Regions(numbered, count, tuple(doors))


def adjacent_labels(labels: Int32s, parts: Int32s) -> list[tuple[int, ...]]:
    """Return the labels of regions and doors adjacent to each part, ascending; 0 in `parts`: no part."""
    found: list[set[int]] = [set() for _ in range(int(parts.max()))]
    for part, label in ((parts, labels), (parts.T, labels.T)):
        for here, beside in ((part[1:], label[:-1]), (part[:-1], label[1:])):
            touching = (here > 0) & (beside > 0)
            for number, other in {*zip(here[touching].tolist(), beside[touching].tolist(), strict=True)}:
                found[number - 1].add(other)
    return [tuple(sorted(each)) for each in found]


_MAX_DISTANCE: Final = 0.5
"""Maximum distance of a point from a door's cells to select the door, m."""
_DIRECTIONS: Final = 16
"""Number of directions of candidate lines, from east to west through north."""
_STRAIGHTNESS: Final = 0.8
"""A line counts if this share of its length is at most twice the clearance at its middle: others cut
corners."""
_SAMPLES: Final = 4
"""Samples of a line per cell length."""


class DoorError(AcrcError):
    """A point without a door, or a door that no straight line closes."""


@dataclass(frozen=True)
class Doorways:
    """Doors of one floor for robots of one radius, m, and the cells that close them."""

    grid: OccupancyGrid
    radius: float

    @cached_property
    def regions(self) -> Regions:
        """Regions and doors of the floor."""
        return regions(self.grid, passable(self.grid, self.radius), self.grid.clearance)

    def at(self, point: Point) -> Door:
        """Return the door at a point, or within 0.5 m of it. Raises DoorError."""
        parts = self.regions
        cell = nearest_cell(self.grid, parts.labels > parts.count, point, _MAX_DISTANCE)
        if cell is None:
            known = ", ".join(f"({door.middle.x:.2f}, {door.middle.y:.2f})" for door in parts.doors)
            has = f"the map's doors are at {known}" if known else "the map has none"
            raise DoorError(f"({point.x:g}, {point.y:g}) is not at a door; {has}")
        return parts.doors[int(parts.labels[cell]) - parts.count - 1]

    def closed_cells(self, door: Door) -> Flags:
        """Return the cells that the closed door fills, (rows, columns). Raises DoorError.

        They are connected by their edges, so they block robots and rays.
        """
        inside = self.regions.labels == self.regions.count + 1 + door.index
        begin, end = self._lines(inside)
        length = arrays.hypot(*(end - begin).T)
        for number in np.argsort(length, kind="stable").tolist():
            filled = self._cells_on_line(begin[number], end[number])
            if self._separates(inside & ~filled, door):
                return filled
        x, y = door.middle
        raise DoorError(f"the door at ({x:.2f}, {y:.2f}) cannot be closed by a straight line")

    def ends_of(self, closed_cells: Flags) -> tuple[Point, Point]:
        """Return the ends of a closed door, m: its two cells farthest from each other."""
        rows, columns = np.nonzero(closed_cells)
        gaps = arrays.hypot((rows[:, None] - rows).astype(float), (columns[:, None] - columns).astype(float))
        ends = np.unravel_index(int(gaps.argmax()), gaps.shape)
        one, other = (self.grid.centre(Cell(int(rows[end]), int(columns[end]))) for end in ends)
        return one, other

    def _lines(self, inside: Flags) -> tuple[Int64s, Int64s]:
        """Return row and column of both ends of all lines through the door's cells, (n, 2) each."""
        cells = np.argwhere(inside)
        room = self.grid.clearance[inside] / self.grid.resolution
        angles = np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS)
        begins, ends = [], []
        for along in np.stack([arrays.sin(angles), arrays.cos(angles)], axis=1):
            begin, end = self._first_blocking(cells, -along), self._first_blocking(cells, along)
            length = arrays.hypot(*(end - begin).T.astype(np.float64))
            straight = _STRAIGHTNESS * length <= 2 * room + 1
            begins.append(begin[straight])
            ends.append(end[straight])
        return np.concatenate(begins), np.concatenate(ends)

    def _first_blocking(self, cells: Int64s, along: Floats) -> Int64s:
        """Return the first blocking cell from each cell in a direction; the last one otherwise."""
        blocking = np.pad(self.grid.blocking, 1, constant_values=True)
        shape = np.array(self.grid.cells.shape)
        last, active = cells.copy(), np.ones(len(cells), np.bool_)
        for step in range(1, int(2 * ROOM / self.grid.resolution) + 2):
            here = np.floor(cells + along * step + 0.5).astype(np.int64)
            last[active] = np.clip(here[active], -1, shape)
            active &= ~blocking[last[:, 0] + 1, last[:, 1] + 1]
        return last

    def _cells_on_line(self, begin: Int64s, end: Int64s) -> Flags:
        """Return the free cells on a line; at a diagonal step, one of the cells beside, too."""
        count = int(np.abs(end - begin).max()) * _SAMPLES + 1
        line = np.floor(np.linspace(begin, end, count) + 0.5).astype(np.int64)
        corners = np.stack([line[:-1, 0], line[1:, 1]], axis=1)
        rows, columns = np.concatenate([line, corners]).T
        on_map = (rows >= 0) & (columns >= 0) & (rows < self.grid.rows) & (columns < self.grid.columns)
        filled = np.zeros(self.grid.cells.shape, np.bool_)
        filled[rows[on_map], columns[on_map]] = True
        return filled & self.grid.free

    def _separates(self, rest: Flags, door: Door) -> bool:
        """Return whether the rest of a door's cells no longer connects all its regions."""
        rows, columns = np.nonzero(rest)
        if not rows.size:
            return True
        south, west = max(int(rows.min()) - 1, 0), max(int(columns.min()) - 1, 0)
        box = np.s_[south : int(rows.max()) + 2, west : int(columns.max()) + 2]
        pieces = raster.regions(rest[box])
        labels = self.regions.labels[box]
        return not any(set(door.regions).issubset(adjacent) for adjacent in adjacent_labels(labels, pieces))
