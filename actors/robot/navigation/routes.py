"""Shortest paths, doors and regions on a floor, and the FloorPlan port of strategies."""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from actors.array_types import Flags, Floats, Indices, Int32s
from actors.floor import raster
from actors.floor.doors import Regions, regions
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, SharedCache, nearest_cell
from actors.floor.placement import Area, PlacementError
from actors.geometry import Door, Point
from actors.robot.navigation.planning import PlanningGrid, blocks
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, descent, potential

_TOLERANCE: Final = 0.5
"""Distance within which an occupied point is replaced by the nearest free one, m."""
_FIELDS: Final = 256
"""Number of cached goals; 0.11 MB each on the corridor map."""
_PAIRS: Final = 1 << 16
"""Number of cached results of `doors_between`."""


class Routes:
    """Path lengths, paths and doors on one floor."""

    def __init__(self, floor: PlanningGrid) -> None:
        self._floor = floor
        self._factor = max(1, int(floor.reach / (floor.grid.resolution * math.sqrt(2.0))))
        self._grid, self._costs = _coarse(floor, self._factor)
        costs = self._costs
        self._field = lru_cache(_FIELDS)(lambda goal: potential(costs, *goal))
        self._doors_between = lru_cache(_PAIRS)(self._find_doors)

    def length(self, start: Point, goal: Point) -> float | None:
        """Return the path length, m; None if there is no path.

        At most 8 % more than the shortest curve, since paths on the grid turn by multiples of 45°.
        """
        first, last = self._cell(start), self._cell(goal)
        if first is None or last is None:
            return None
        steps = int(self._field(last)[first])
        return None if steps == UNREACHABLE else steps * self._grid.resolution / (2 * STRAIGHT)

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """Return the path as centres of neighbouring cells; None if there is none."""
        first, last = self._cell(start), self._cell(goal)
        if first is None or last is None or self._field(last)[first] == UNREACHABLE:
            return None
        cells = descent(self._costs, self._field(last), *first)
        return tuple(self._grid.centre(Cell(int(row), int(column))) for row, column in cells)

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Return the indices of the doors on the path, in order; None if there is none."""
        first, last = self._cell(start), self._cell(goal)
        return None if first is None or last is None else self._doors_between(first, last)

    @cached_property
    def regions(self) -> Regions:
        """Regions of the floor, on the planning grid."""
        floor = self._floor
        return regions(floor.grid, floor.costs > 0, floor.clearance)

    def region(self, point: Point) -> int | None:
        """Return the number of a point's region, from 1; None in a door and in occupied cells."""
        label = self._label(point)
        return label if 0 < label <= self.regions.count else None

    def door(self, point: Point) -> int | None:
        """Return the index of a point's door; None if there is none."""
        label = self._label(point)
        return label - self.regions.count - 1 if label > self.regions.count else None

    def _label(self, point: Point) -> int:
        grid = self._floor.grid
        return int(self.regions.labels[grid.cell(point)]) if grid.is_free(point) else 0

    def _cell(self, point: Point) -> Cell | None:
        return nearest_cell(self._grid, self._costs > 0, point, _TOLERANCE)

    def _find_doors(self, first: Cell, last: Cell) -> tuple[int, ...] | None:
        field = self._field(last)
        if field[first] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *first)
        labels = self._coarse_labels[cells[:, 0], cells[:, 1]]
        labels = labels[labels > 0]
        met = labels[np.flatnonzero(np.diff(labels, prepend=0))].tolist()
        count = self.regions.count
        doors = []
        for index, label in enumerate(met):
            ends = index in (0, len(met) - 1)
            if label > count and (ends or met[index - 1] != met[index + 1]):
                doors.append(label - count - 1)
        return tuple(doors)

    @cached_property
    def _coarse_labels(self) -> Int32s:
        """(rows, columns): labels of the coarse cells; a cell that contains a door belongs to it."""
        labels: Int32s = blocks(self.regions.labels, self._factor).max(axis=(1, 3))
        return labels


_ROUTES: Final = SharedCache[Routes]()


def routes(floor: PlanningGrid) -> Routes:
    """Return the routes of a floor; shared by all robots of a process with the same floor."""
    return _ROUTES.get(floor, lambda: Routes(floor))


def _coarse(floor: PlanningGrid, factor: int) -> tuple[OccupancyGrid, Int32s]:
    """Return a grid of larger cells, free if one of their cells is, and its costs of 1.

    No wall is lost: occupied space is everywhere wider than the diagonals of two large cells.
    """
    costs = blocks((floor.costs > 0).astype(np.int32), factor).max(axis=(1, 3))
    costs.setflags(write=False)  # like those of the floor, for which the kernels are compiled
    cells = np.where(costs > 0, FREE, OCCUPIED).astype(np.uint8)
    return OccupancyGrid(cells, floor.grid.resolution * factor, floor.grid.origin), costs


class _Tiles(NamedTuple):
    """Disjoint rectangles that cover the floor from which points are drawn."""

    ladder: Floats
    """(n,): cumulative area of the tiles, m²."""
    row: Indices
    column: Indices
    """(n,): index of each tile between the cuts."""
    x: Floats
    y: Floats
    """Cuts along each axis, at the edges of cells and areas, m."""


class ReachableFloor:
    """Implementation of FloorPlan for one robot; data for random points is computed on first use."""

    def __init__(
        self, floor: PlanningGrid, radius: float, start: Point, areas: Sequence[Area], generator: Generator
    ) -> None:
        """Create a floor plan. `radius`: of the body, m; `areas`: of random points, empty: everywhere."""
        self._floor = floor
        self._radius = radius
        self._start = start
        self._areas = tuple(areas)
        self._generator = generator

    def random_point(self) -> Point:
        """Return a random point that is reachable from the start and at least `radius` from walls.

        Uniform in the union of the areas. Uses three numbers of the generator. Raises PlacementError if no
        point is reachable.
        """
        ladder, row, column, x, y = self._tiles
        which, east, north = self._generator.random(3).tolist()
        rung = min(int(ladder.searchsorted(which * ladder[-1], side="right")), len(ladder) - 1)
        i, j = int(column[rung]), int(row[rung])
        x0, x1, y0, y1 = float(x[i]), float(x[i + 1]), float(y[j]), float(y[j + 1])
        return Point(x0 + east * (x1 - x0), y0 + north * (y1 - y0))

    def is_free(self, point: Point) -> bool:
        """Return True if the body's centre may be at a point."""
        return self._floor.grid.is_free(point)

    def length(self, start: Point, goal: Point) -> float | None:
        """Return the length of the shortest path, m; None if there is none."""
        return self._routes.length(start, goal)

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """Return the shortest path; None if there is none."""
        return self._routes.path(start, goal)

    @property
    def doors(self) -> tuple[Door, ...]:
        """Doors of the map."""
        return self._routes.regions.doors

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Return the doors on the shortest path; None if there is none."""
        return self._routes.doors_between(start, goal)

    def door(self, point: Point) -> int | None:
        """Return the index of a point's door; None if there is none."""
        return self._routes.door(point)

    def region(self, point: Point) -> int | None:
        """Return the number of a point's region; None if there is none."""
        return self._routes.region(point)

    @cached_property
    def _routes(self) -> Routes:
        return routes(self._floor)

    @cached_property
    def _tiles(self) -> _Tiles:
        grid = self._floor.grid
        x = _edges(
            grid.origin.x, grid.resolution, grid.columns, [e for a in self._areas for e in (a.x0, a.x1)]
        )
        y = _edges(grid.origin.y, grid.resolution, grid.rows, [e for a in self._areas for e in (a.y0, a.y1)])
        east, north = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
        columns = _cells(east, grid.origin.x, grid.resolution, grid.columns)
        rows = _cells(north, grid.origin.y, grid.resolution, grid.rows)
        counts = self._admitted[np.ix_(rows, columns)] & self._inside(east, north)
        row, column = np.nonzero(counts)
        if not row.size:
            where = f" of {', '.join(repr(area.name) for area in self._areas)}" if self._areas else ""
            raise PlacementError(
                f"a robot that starts at ({self._start.x:.2f}, {self._start.y:.2f}) can reach no point{where}"
                f" at least {self._radius:g} m from walls; change its start or the areas"
            )
        ladder = np.cumsum(np.diff(x)[column] * np.diff(y)[row])
        return _Tiles(ladder, row, column, x, y)

    @property
    def _admitted(self) -> Flags:
        """Cells that are reachable and whose points are all far enough from walls.

        A robot may stand within the margin of the planner.
        """
        floor, grid = self._floor, self._floor.grid
        half_diagonal = grid.resolution * math.sqrt(0.5)
        begin = nearest_cell(grid, grid.free, self._start) or Cell(0, 0)  # any cell if none is free
        region = raster.flood(grid.free, *begin)
        return region & (floor.clearance >= self._radius + half_diagonal)

    def _inside(self, east: Floats, north: Floats) -> Flags:
        """Return which points are in an area: (len(north), len(east))."""
        inside = np.full((north.size, east.size), not self._areas)
        for area in self._areas:
            wide, high = (area.x0 < east) & (east < area.x1), (area.y0 < north) & (north < area.y1)
            inside |= high[:, None] & wide
        return inside


def _edges(origin: float, resolution: float, count: int, edges: Sequence[float]) -> Floats:
    """Return the edges of all cells along one axis, and of the areas on the map."""
    cells = origin + np.arange(count + 1) * resolution
    cuts: Floats = np.unique(np.concatenate([cells, np.clip(edges, cells[0], cells[-1])]))
    return cuts


def _cells(middles: Floats, origin: float, resolution: float, count: int) -> Indices:
    """Return the cell of each tile along one axis."""
    return np.clip(((middles - origin) / resolution).astype(np.intp), 0, count - 1)
