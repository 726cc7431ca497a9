"""The map as a behaviour may ask about it: ways and doors, and points drawn in the given areas."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor import flood
from actors.floor.door import Door
from actors.floor.grid import Cell, nearest_cell
from actors.floor.placement import Area, PlacementError
from actors.geometry import Point
from actors.robot.navigation.planning import Ground
from actors.robot.navigation.routes import Routes, routes


class _Tiles(NamedTuple):
    """Rectangles that make up the floor where points are drawn, without overlaps."""

    ladder: NDArray[np.float64]
    """(n,): surface of the tiles up to and with each, m²."""
    row: NDArray[np.intp]
    column: NDArray[np.intp]
    """(n,): where each lies between the cuts."""
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    """Cuts along each axis, at the edges of cells and areas, m."""


class ReachableFloor:
    """One robot's floor plan; what it needs for drawing it makes on the first draw."""

    def __init__(
        self, ground: Ground, radius: float, start: Point, areas: Sequence[Area], generator: Generator
    ) -> None:
        """`radius` of the body's disc, m; without areas everything counts."""
        self._ground = ground
        self._radius = radius
        self._start = start
        self._areas = tuple(areas)
        self._generator = generator

    def random_place(self) -> Point:
        """A point at least `radius` from walls that the robot gets to from its start, uniform in the areas.

        Where areas overlap it is no more likely than elsewhere. Takes three numbers from the generator.
        Raises PlacementError where the robot gets to no point of the areas.
        """
        ladder, row, column, x, y = self._tiles
        which, east, north = self._generator.random(3).tolist()
        rung = min(int(ladder.searchsorted(which * ladder[-1], side="right")), len(ladder) - 1)
        i, j = int(column[rung]), int(row[rung])
        x0, x1, y0, y1 = float(x[i]), float(x[i + 1]), float(y[j]), float(y[j + 1])
        return Point(x0 + east * (x1 - x0), y0 + north * (y1 - y0))

    def is_free(self, point: Point) -> bool:
        """True if planning lets the body's centre be there."""
        return self._ground.grid.is_free(point)

    def length(self, start: Point, goal: Point) -> float | None:
        """Of the shortest way, m; None without one."""
        return self._routes.length(start, goal)

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """The shortest way; None without one."""
        return self._routes.path(start, goal)

    @property
    def doors(self) -> tuple[Door, ...]:
        """The map's narrow places."""
        return self._routes.regions.doors

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Which doors the shortest way goes through; None without one."""
        return self._routes.doors_between(start, goal)

    def door(self, point: Point) -> int | None:
        """The door around a point; None in none."""
        return self._routes.door(point)

    def region(self, point: Point) -> int | None:
        """The region around a point; None in none."""
        return self._routes.region(point)

    @cached_property
    def _routes(self) -> Routes:
        return routes(self._ground)

    @cached_property
    def _tiles(self) -> _Tiles:
        grid = self._ground.grid
        x = _cuts(
            grid.origin.x, grid.resolution, grid.columns, [e for a in self._areas for e in (a.x0, a.x1)]
        )
        y = _cuts(grid.origin.y, grid.resolution, grid.rows, [e for a in self._areas for e in (a.y0, a.y1)])
        east, north = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
        columns = _cells(east, grid.origin.x, grid.resolution, grid.columns)
        rows = _cells(north, grid.origin.y, grid.resolution, grid.rows)
        counts = self._admitted[np.ix_(rows, columns)] & self._inside(east, north)
        row, column = np.nonzero(counts)
        if not row.size:
            where = f" of {', '.join(repr(area.name) for area in self._areas)}" if self._areas else ""
            raise PlacementError(
                f"a robot that starts at ({self._start.x:.2f}, {self._start.y:.2f}) gets to no point{where}"
                f" at least {self._radius:g} m from walls; there must be one to draw"
            )
        ladder = np.cumsum(np.diff(x)[column] * np.diff(y)[row])
        return _Tiles(ladder, row, column, x, y)

    @property
    def _admitted(self) -> NDArray[np.bool_]:
        """Cells that the robot gets to and of which every point is far enough from walls.

        A robot may stand where planning, which keeps a margin, would not let it.
        """
        ground, grid = self._ground, self._ground.grid
        half_diagonal = grid.resolution * math.sqrt(0.5)
        begin = nearest_cell(grid, grid.free, self._start) or Cell(0, 0)  # any, where nothing is free
        region = flood.flood(grid.free, *begin)
        admitted: NDArray[np.bool_] = region & (ground.clearance >= self._radius + half_diagonal)
        return admitted

    def _inside(self, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(len(north), len(east)): whether points lie in an area."""
        inside = np.full((north.size, east.size), not self._areas)
        for area in self._areas:
            wide, high = (area.x0 < east) & (east < area.x1), (area.y0 < north) & (north < area.y1)
            inside |= high[:, None] & wide
        return inside


def _cuts(origin: float, resolution: float, count: int, edges: Sequence[float]) -> NDArray[np.float64]:
    """The edges of all cells along one axis, and of the areas as far as they lie on the map."""
    cells = origin + np.arange(count + 1) * resolution
    cuts: NDArray[np.float64] = np.unique(np.concatenate([cells, np.clip(edges, cells[0], cells[-1])]))
    return cuts


def _cells(middles: NDArray[np.float64], origin: float, resolution: float, count: int) -> NDArray[np.intp]:
    """In which cell along one axis each tile lies."""
    return np.clip(((middles - origin) / resolution).astype(np.intp), 0, count - 1)
