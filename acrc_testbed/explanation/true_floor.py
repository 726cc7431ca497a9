"""A run's true floor by stages, the paths on it, and the passages that bodies leave free."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.explanation.episodes import STANDARD, EpisodeParameters
from acrc_testbed.run_model.floor import FloorObject, FloorState
from actors.floor import raster
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, largest_region, nearest_cell
from actors.geometry import Point
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, descent, potential

Points = NDArray[np.float64]
_SIDE: Final = 0.067
"""Cells are joined until they would be larger, m: a way need not be finer than a third of a robot."""
_OPEN: Final = 10
"""Cost of a cell far from walls,"""
_TIGHT: Final = 30
"""and so much more where a robot just fits: ways keep to the middle as navigation's do."""
_WAY_ROOM: Final = 0.3
"""From so much room on, m, beside what a robot needs, a cell is far from walls."""
_ASIDE: Final = 0.3
"""A robot that stands where none fits, as in a corner, begins at the nearest cell within, m."""
_CELL_COST: Final = 2 * STRAIGHT * _OPEN


class FloorWays:
    """Of discs of one radius on one floor; what was computed for a goal is kept."""

    def __init__(self, grid: OccupancyGrid, radius: float, reach: float) -> None:
        """`radius` of a robot, m; a goal is reached by who is within `reach` of it, m."""
        by = max(int(_SIDE / grid.resolution), 1)
        rows, columns = grid.rows // by, grid.columns // by
        blocks = grid.clearance[: rows * by, : columns * by].reshape(rows, by, columns, by)
        room = blocks.max(axis=(1, 3)) - (radius - grid.resolution / 2)
        self._fits = room >= 0
        tight = np.clip(1 - room / _WAY_ROOM, 0.0, 1.0)
        self._costs = np.where(self._fits, np.rint(_OPEN + _TIGHT * tight), 0).astype(np.int32)
        cells = np.where(self._fits, FREE, OCCUPIED).astype(np.uint8)
        self._grid = OccupancyGrid(cells, grid.resolution * by, grid.origin)
        self._reach = reach
        self._fields: dict[tuple[float, float], NDArray[np.int32] | None] = {}
        self._begins: dict[tuple[int, int], Cell | None] = {}

    def far(self, points: Points, goal: tuple[float, float]) -> NDArray[np.float64]:
        """(n,): how far it is from each point, (n, 2), m, where there is room; inf without a way."""
        field = self._field(goal)
        if field is None:
            return np.full(len(points), np.inf)
        squares, which = np.unique(self.squares(points), axis=0, return_inverse=True)
        begins = [self._begin(row, column) for row, column in squares.tolist()]
        costs = np.array([UNREACHABLE if one is None else field[one] for one in begins], np.int64)
        metres = np.where(costs == UNREACHABLE, np.inf, costs * (self._grid.resolution / _CELL_COST))
        return metres[which.reshape(-1)]

    def way(self, point: tuple[float, float], goal: tuple[float, float], length: float) -> Points | None:
        """(n, 2): points from this one on, for so many m, about as far apart as cells; None without a way."""
        field, begin = self._field(goal), self._begin(*self.squares(np.array([point]))[0].tolist())
        if field is None or begin is None or field[begin] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *begin)[: int(length / self._grid.resolution) + 1]
        x, y = self._grid.centres()
        return self._straight(np.column_stack([x[cells[:, 1]], y[cells[:, 0]]]))

    def _straight(self, way: Points) -> Points:
        """The same way without the bends that come of going from cell to cell in eight directions."""
        parts, here = [way[:1]], 0
        while here < len(way) - 1:
            there = next(
                k for k in range(len(way) - 1, here, -1) if k == here + 1 or self._clear(*way[[here, k]])
            )
            parts.append(np.linspace(way[here], way[there], there - here + 1)[1:])
            here = there
        return np.concatenate(parts)

    def _clear(self, one: Points, other: Points) -> bool:
        """True if a robot fits everywhere on the straight line between two points."""
        count = 2 * int(np.hypot(*(other - one)) / self._grid.resolution) + 2
        rows, columns = self.squares(np.linspace(one, other, count).astype(np.float64)).T
        return bool(self._fits[rows, columns].all())

    def squares(self, points: Points) -> NDArray[np.int64]:
        """(n, 2): row and column of the cells that points, (n, 2), are in; from one cell leads one way."""
        corner = np.array([self._grid.origin.x, self._grid.origin.y])
        cells: NDArray[np.int64] = np.floor((points - corner) / self._grid.resolution).astype(np.int64)
        return cells[:, ::-1]

    def _begin(self, row: int, column: int) -> Cell | None:
        if (row, column) not in self._begins:
            middle = self._grid.centre(Cell(row, column))
            self._begins[row, column] = nearest_cell(self._grid, self._fits, middle, _ASIDE)
        return self._begins[row, column]

    def _field(self, goal: tuple[float, float]) -> NDArray[np.int32] | None:
        if goal not in self._fields:
            cell = nearest_cell(self._grid, self._fits, Point(*goal), self._reach)
            self._fields[goal] = None if cell is None else potential(self._costs, *cell)
        return self._fields[goal]


_ROOM: Final = 1.0
"""What is cut off counts from so much floor on, for the centre of a robot, m²: more than a niche has."""
_AROUND: Final = 1.0
"""So far around a robot it is looked first whether it leaves a way, m; of no influence on what comes out."""


class Passages:
    """The narrow places of one floor plan, for discs of one radius."""

    def __init__(self, grid: OccupancyGrid, radius: float, neck: float = 0.0) -> None:
        """`radius`, m; `neck`: for `at`, passages between rooms that are narrower count as well, m."""
        self.grid = self._grid = grid
        self._radius = radius
        self._floor = largest_region(grid, radius)
        self._centres = grid.centres()
        self._neck = _necks(grid, self._floor, neck) if neck else np.zeros(grid.cells.shape, np.bool_)
        self._to_neck = raster.squared_distance(self._neck) * grid.resolution**2
        self._judged: dict[tuple[float, float, float], bool] = {}

    def closed_by(self, point: Point) -> bool:
        """True if a robot at `point` cuts off at least 1 m² from the floor that the others can get to."""
        if self._leaves_way(point):
            return False
        left = self._floor & ~self._taken(point)
        cut_off = int(left.sum()) - int(raster.largest_region(left).sum())
        return cut_off * self._grid.resolution**2 >= _ROOM

    def at(self, points: NDArray[np.float64], within: float) -> NDArray[np.bool_]:
        """(k,): which of the points, (k, 2), m, are at a neck, or at a passage as `beside` has it.

        All points of one square of a lattice of half of `within` are judged by its middle, and once.
        """
        side = within / 2
        squares, which = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
        judged = [self._square(float(x), float(y), within) for x, y in (squares + 0.5) * side]
        return np.array(judged, np.bool_)[which.reshape(-1)]

    def sees(self, one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(k,): where no wall stands between two points of the map, each (k, 2), m."""
        farthest = float(np.hypot(*(other - one).T).max(initial=0.0))
        along = np.linspace(0.0, 1.0, int(farthest / self._grid.resolution) + 2)[:, None, None]
        corner = np.array([self._grid.origin.x, self._grid.origin.y])
        cells = ((one + (other - one) * along - corner) / self._grid.resolution).astype(np.intp)
        seen: NDArray[np.bool_] = ~self._grid.blocking[cells[..., 1], cells[..., 0]].any(axis=0)
        return seen

    def _square(self, x: float, y: float, within: float) -> bool:
        key = (x, y, within)
        if key not in self._judged:
            point = Point(x, y)
            near = self._grid.contains(point) and self._to_neck[self._grid.cell(point)] <= within**2
            self._judged[key] = bool(near) or self.beside(point, within)
        return self._judged[key]

    def beside(self, point: Point, within: float = 0.5) -> bool:
        """True if some point of the floor not farther than `within`, m, is one at which a robot would.

        Looked at are points of a lattice of a quarter of `within` around `point`.
        """
        marks = np.linspace(-within, within, 9)
        around = [(point.x + dx, point.y + dy) for dx in marks for dy in marks if np.hypot(dx, dy) <= within]
        return any(self._is_floor(Point(*xy)) and self.closed_by(Point(*xy)) for xy in [point, *around])

    def _leaves_way(self, point: Point) -> bool:
        """True if the floor around hangs together without where the robot stands: then nothing is cut off.

        The other way round nothing follows: there may be another way about.
        """
        cell, side = self._grid.cell(point), self._grid.resolution
        if self._grid.contains(point) and self._grid.clearance[cell] >= 3 * self._radius + 2 * side:
            return True  # others get by on every side
        reach = int((2 * self._radius + _AROUND) / side)
        bottom, left = max(cell.row - reach, 0), max(cell.column - reach, 0)
        around = np.s_[bottom : cell.row + reach + 1, left : cell.column + reach + 1]
        near = raster.flood(self._floor[around], cell.row - bottom, cell.column - left)
        near &= ~self._taken(point, around)
        return bool(np.array_equal(raster.largest_region(near), near))

    def _is_floor(self, point: Point) -> bool:
        return self._grid.contains(point) and bool(self._floor[self._grid.cell(point)])

    def _taken(self, point: Point, around: tuple[slice, slice] = np.s_[:, :]) -> NDArray[np.bool_]:
        """(rows, columns) of a part of the map: where the centre of another robot cannot be."""
        x, y = self._centres
        taken: NDArray[np.bool_] = (x[around[1]] - point.x) ** 2 + (y[around[0], None] - point.y) ** 2 < (
            2 * self._radius
        ) ** 2
        return taken


def _necks(grid: OccupancyGrid, floor: NDArray[np.bool_], width: float) -> NDArray[np.bool_]:
    """(rows, columns): floor under no free disc of this width, m, without which rooms fall apart."""
    roomy = raster.squared_distance(grid.clearance >= width / 2) * grid.resolution**2 < (width / 2) ** 2
    rest, necks = floor & ~roomy, np.zeros_like(floor)
    while rest.any():
        row, column = np.argwhere(rest)[0]
        part = raster.flood(rest, int(row), int(column))
        rest &= ~part
        left = floor & ~part
        if int(left.sum()) - int(raster.largest_region(left).sum()) >= _ROOM / grid.resolution**2:
            necks |= part
    return necks


@dataclass(frozen=True, eq=False)
class Stage:
    """The floor from one step on until the next stage."""

    begin: int
    ways: FloorWays
    """As it is."""
    opened: FloorWays
    """If all doors were open."""
    leaves: NDArray[np.float64]
    """(n, 2): the middles of the cells that closed doors fill, m."""


class TrueFloor:
    """All stages of a run's floor, and its narrow places."""

    def __init__(
        self,
        grid: OccupancyGrid,
        radius: float,
        changes: Sequence[tuple[int, FloorState]] = (),
        parameters: EpisodeParameters = STANDARD,
    ) -> None:
        """`grid`: the robots' map; `radius`: of the largest robot, m.

        `changes`: steps from which on these objects were on the floor.
        """
        self.grid = grid
        self.passages = Passages(grid, radius, parameters.neck)
        self._radius, self._reach = radius, parameters.reported
        self._changes = changes

    def stages(self) -> list[Stage]:
        """From the first step on."""
        found: list[Stage] = [self._stage(0, ())]
        before: FloorState = ()
        for begin, state in self._changes:
            solid = tuple(one for one in state if one.kind != "jammer")
            if solid != before:
                before = solid
                found.append(self._stage(begin, solid))
        return found

    def _stage(self, begin: int, things: FloorState) -> Stage:
        taken, leaves = np.zeros((2, *self.grid.cells.shape), np.bool_)
        for thing in things:
            if thing.kind == "closed door":
                leaves |= self._leaf(thing)
            else:
                taken |= self._from(thing) <= thing.radius
        opened = self._ways(taken)
        ways = self._ways(taken | leaves) if leaves.any() else opened
        rows, columns = np.nonzero(leaves)
        x, y = self.grid.centres()
        return Stage(begin, ways, opened, np.column_stack([x[columns], y[rows]]))

    def _leaf(self, door: FloorObject) -> NDArray[np.bool_]:
        """(rows, columns): the cells of the map that a closed door fills; none if it is on no door of it."""
        (x, y), (to_x, to_y) = door.points
        try:
            return self._doorways.closed(self._doorways.at(Point((x + to_x) / 2, (y + to_y) / 2)))
        except DoorError:
            return np.zeros(self.grid.cells.shape, np.bool_)

    @cached_property
    def _doorways(self) -> Doorways:
        return Doorways(self.grid, self._radius)

    def _ways(self, taken: NDArray[np.bool_]) -> FloorWays:
        key = taken.tobytes()
        if key not in self._known:
            cells = np.where(taken, np.uint8(OCCUPIED), self.grid.cells)
            floor = replace(self.grid, cells=cells) if taken.any() else self.grid
            self._known[key] = FloorWays(floor, self._radius, self._reach)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[bytes, FloorWays]:
        return {}

    def _from(self, thing: FloorObject) -> NDArray[np.float64]:
        """(rows, columns): how far cells are from a line or a point, m."""
        columns, rows = self.grid.centres()
        (x, y), (to_x, to_y) = thing.points[0], thing.points[-1]
        dx, dy = to_x - x, to_y - y
        across, up = columns[None, :] - x, rows[:, None] - y
        share = np.clip((across * dx + up * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        far: NDArray[np.float64] = np.hypot(across - share * dx, up - share * dy)
        return far
