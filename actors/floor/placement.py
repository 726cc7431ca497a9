"""Random points on a floor plan, and validation of robot positions."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Flags, Floats
from actors.floor.grid import OccupancyGrid, largest_region, nearest_cell, reachable
from actors.geometry import Point
from actors.runtime.errors import AcrcError


class PlacementError(AcrcError):
    """A position without room, or too many positions."""


class Area(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A named rectangle of the floor, its sides along the axes of the map frame."""

    name: str
    x0: float
    """West edge, m."""
    y0: float
    """South edge, m."""
    x1: float
    """East edge, m."""
    y1: float
    """North edge, m."""

    def __post_init__(self) -> None:
        if not (self.x0 < self.x1 and self.y0 < self.y1):
            raise PlacementError(
                f"area {self.name!r} spans x {self.x0:g} to {self.x1:g} and y {self.y0:g} to {self.y1:g} m,"
                " but must have x0 < x1 and y0 < y1."
            )

    @property
    def surface(self) -> float:
        """Surface, m²."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)


def areas_named(areas: Sequence[Area], names: Sequence[str]) -> tuple[Area, ...]:
    """Return the areas of these names in the order of `names`. Raises PlacementError for an unknown name."""
    known = {area.name: area for area in areas}
    if unknown := [name for name in names if name not in known]:
        raise PlacementError(
            f"area {unknown[0]!r} is not defined; defined are {', '.join(map(repr, known)) or 'none'}."
        )
    return tuple(known[name] for name in names)


def has_free_floor(grid: OccupancyGrid, area: Area) -> bool:
    """Return whether the area overlaps a free cell."""
    return _Window(grid, grid.free, area).has_room


def draw_points(
    grid: OccupancyGrid,
    count: int,
    *,
    rng: Generator,
    clearance: float = 0.6,
    apart: float = 0.6,
    keep_off: Sequence[Point] = (),
    start: Point | None = None,
    areas: Sequence[Area] | None = None,
    passage: float = 0.0,
) -> tuple[Point, ...]:
    """Return `count` random points of the reachable floor, each uniform in the remaining surface.

    A point is at least `clearance` from blocking points, and at least `apart` from earlier points and from
    `keep_off` (m). Reachable is what a disc of radius `passage` can reach from `start`, or the largest such
    region if `start` is None. With areas, one of those with room is selected first, with a probability
    proportional to its surface.

    Cells are admitted as a whole, so that every point of an admitted cell keeps these distances: up to 0.71
    of a cell beside walls and points is not used, for an exactly uniform draw that always ends. Raises
    PlacementError if there is not enough room.
    """
    half_diagonal = grid.resolution * math.sqrt(0.5)
    walkable = _walkable(grid, start, passage)
    admitted = walkable & (grid.clearance >= clearance + half_diagonal)
    everything = Area("", *grid.origin, *grid.corner)
    windows = [_Window(grid, admitted, area) for area in areas or (everything,)]
    if full := next((window for window in windows if not window.has_room), None):
        raise PlacementError(
            f"{full.title} has no reachable point at least {clearance:g} m from walls;"
            " reduce clearance or move the area."
        )
    spacing = apart + half_diagonal if apart > 0 else 0.0
    for point in keep_off:
        _exclude(grid, admitted, point, spacing)
    points: list[Point] = []
    while len(points) < count:
        with_room = [window for window in windows if window.has_room]
        if not with_room:
            raise PlacementError(
                f"only {len(points)} of {count} points fit at least {clearance:g} m from walls and"
                f" {apart:g} m from each other; use fewer robots or points, or smaller distances."
            )
        point = _draw(with_room, rng)
        _exclude(grid, admitted, point, spacing)
        points.append(point)
    return tuple(points)


def check_pose(grid: OccupancyGrid, point: Point, radius: float, robot: str) -> None:
    """Raise PlacementError if `robot`, a disc of `radius`, m, overlaps blocking cells at `point`."""
    gap = grid.clearance_at(point, radius)
    if gap >= radius - 1e-9:  # tolerance for rounding
        return
    if not grid.contains(point):
        where = "is outside the map"
    elif gap == 0:
        where = "is not on free floor"
    else:
        where = f"is {gap:.3f} m from a wall"
    raise PlacementError(
        f"robot {robot!r} at ({point.x:.2f}, {point.y:.2f}) {where}, but must be at least"
        f" {radius:g} m from walls; {_advice(grid, point, radius)}."
    )


class _Window:
    """Cells that an area overlaps, weighted by the shared surface."""

    def __init__(self, grid: OccupancyGrid, admitted: Flags, area: Area) -> None:
        self.title = f"area {area.name!r}" if area.name else "the map"
        self.surface = area.surface
        self._x0, self._x1 = _clipped_edges(grid.origin.x, grid.resolution, grid.columns, area.x0, area.x1)
        self._y0, self._y1 = _clipped_edges(grid.origin.y, grid.resolution, grid.rows, area.y0, area.y1)
        columns, rows = np.flatnonzero(self._x1 > self._x0), np.flatnonzero(self._y1 > self._y0)
        self._left = int(columns[0]) if columns.size else 0
        self._bottom = int(rows[0]) if rows.size else 0
        self._weights = np.outer((self._y1 - self._y0)[rows], (self._x1 - self._x0)[columns])
        # a view: cells withdrawn later disappear from all windows
        self._admitted = admitted[
            self._bottom : self._bottom + rows.size, self._left : self._left + columns.size
        ]

    @property
    def has_room(self) -> bool:
        """True while points can be drawn."""
        return bool(self._admitted.any())

    def point(self, chance: float, east: float, north: float) -> Point:
        """Return the point of three numbers in [0, 1): they select a cell by surface, then x and y in it."""
        cells = np.flatnonzero(self._admitted)
        ladder = np.cumsum(self._weights.ravel()[cells])
        rung = min(int(np.searchsorted(ladder, chance * ladder[-1], side="right")), cells.size - 1)
        row, column = divmod(int(cells[rung]), self._weights.shape[1])
        row, column = row + self._bottom, column + self._left
        x0, x1 = float(self._x0[column]), float(self._x1[column])
        y0, y1 = float(self._y0[row]), float(self._y1[row])
        return Point(x0 + east * (x1 - x0), y0 + north * (y1 - y0))


def _clipped_edges(
    origin: float, resolution: float, count: int, low: float, high: float
) -> tuple[Floats, Floats]:
    """Return both edges of the cells along one axis, m, clipped to the interval from low to high."""
    edges = np.clip(origin + np.arange(count + 1) * resolution, low, high)
    return edges[:-1], edges[1:]


def _walkable(grid: OccupancyGrid, start: Point | None, passage: float) -> Flags:
    if start is None:
        return largest_region(grid, passage)
    region = reachable(grid, start, passage)
    if not region.any():
        raise PlacementError(
            f"a disc of radius {passage:g} m does not fit at the start ({start.x:.2f}, {start.y:.2f});"
            f" {_advice(grid, start, passage)}."
        )
    return region


def _draw(windows: Sequence[_Window], rng: Generator) -> Point:
    """Return a point of one window; always draw four numbers, whatever the number of windows."""
    selector, chance, east, north = (float(number) for number in rng.random(4))
    ladder = np.cumsum([window.surface for window in windows])
    rung = min(int(np.searchsorted(ladder, selector * ladder[-1], side="right")), len(windows) - 1)
    return windows[rung].point(chance, east, north)


def _exclude(grid: OccupancyGrid, admitted: Flags, point: Point, spacing: float) -> None:
    """Exclude the cells whose centre is nearer than `spacing` to `point`."""
    row, column = grid.cell(point)
    reach = int(spacing / grid.resolution) + 1
    rows = slice(max(row - reach, 0), max(row + reach + 1, 0))
    columns = slice(max(column - reach, 0), max(column + reach + 1, 0))
    x, y = grid.centres()
    near = np.square(x[columns] - point.x) + np.square(y[rows, None] - point.y) < spacing * spacing
    admitted[rows, columns] &= ~near


def _advice(grid: OccupancyGrid, point: Point, radius: float) -> str:
    """Return a suggestion instead of `point`; the margin of 1 cm compensates for printing two digits."""
    cell = nearest_cell(grid, grid.clearance >= radius + 0.01, point)
    if cell is None:
        return "no point of this map is that far from walls"
    nearest = grid.centre(cell)
    return f"the nearest point with room is ({nearest.x:.2f}, {nearest.y:.2f})"
