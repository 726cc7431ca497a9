"""True floor of a run over time, the paths on it, and its narrow passages."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Final

import msgspec
import numpy as np

from acrc_testbed.explanation.episodes import STANDARD
from acrc_testbed.run_model.floor import FloorObject, FloorState
from actors.array_types import Flags, Floats, Int32s, Int64s
from actors.floor import raster
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, largest_region, nearest_cell
from actors.geometry import Point
from actors.kernels import load_numba
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, descent, potential

Points = Floats
_MAX_CELL: Final = 0.067
"""Maximum edge of a cell of the path grid, m: a third of a robot."""
_OPEN_COST: Final = 10
"""Cost of a cell far from walls."""
_TIGHT_COST: Final = 30
"""Additional cost where a robot just fits, so that paths keep to the middle as navigation's do."""
_PATH_ROOM: Final = 0.3
"""Clearance beyond a robot's radius from which a cell is far from walls, m."""
_MAX_OFFSET: Final = 0.3
"""Maximum distance to the first free cell for a robot in a cell where it does not fit, m."""
_CELL_COST: Final = 2 * STRAIGHT * _OPEN_COST


class FloorPaths:
    """Shortest paths of discs of one radius on one floor; cached per goal."""

    def __init__(self, grid: OccupancyGrid, radius: float, reach: float) -> None:
        """`radius` of a robot, m; `reach`: distance at which a goal is reached, m."""
        by = max(int(_MAX_CELL / grid.resolution), 1)
        rows, columns = grid.rows // by, grid.columns // by
        blocks = grid.clearance[: rows * by, : columns * by].reshape(rows, by, columns, by)
        room = blocks.max(axis=(1, 3)) - (radius - grid.resolution / 2)
        self._fits = room >= 0
        tight = np.clip(1 - room / _PATH_ROOM, 0.0, 1.0)
        self._costs = np.where(self._fits, np.rint(_OPEN_COST + _TIGHT_COST * tight), 0).astype(np.int32)
        cells = np.where(self._fits, FREE, OCCUPIED).astype(np.uint8)
        self._grid = OccupancyGrid(cells, grid.resolution * by, grid.origin)
        self._reach = reach
        self._field, self._start_cell = cache(self._compute_field), cache(self._nearest_cell)

    def lengths(self, points: Points, goal: tuple[float, float]) -> Floats:
        """Return path lengths from points, (n, 2), m, to the goal, (n,), m; inf without a path."""
        field = self._field(goal)
        if field is None:
            return np.full(len(points), np.inf)
        squares, groups = np.unique(self.squares(points), axis=0, return_inverse=True)
        begins = [self._start_cell(row, column) for row, column in squares.tolist()]
        costs = np.array([UNREACHABLE if one is None else field[one] for one in begins], np.int64)
        metres = np.where(costs == UNREACHABLE, np.inf, costs * (self._grid.resolution / _CELL_COST))
        return metres[groups.reshape(-1)]

    def path(self, point: tuple[float, float], goal: tuple[float, float], length: float) -> Points | None:
        """Return the first `length` m of the path, (n, 2), points about a cell apart; None without a path."""
        field, begin = self._field(goal), self._start_cell(*self.squares(np.array([point]))[0].tolist())
        if field is None or begin is None or field[begin] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *begin)[: int(length / self._grid.resolution) + 1]
        x, y = self._grid.centres()
        return self._straight(np.column_stack([x[cells[:, 1]], y[cells[:, 0]]]))

    def _straight(self, path: Points) -> Points:
        """Return the path without the bends of an 8-connected grid."""
        parts, start = [path[:1]], 0
        while start < len(path) - 1:
            end = next(
                k
                for k in range(len(path) - 1, start, -1)
                if k == start + 1 or self._is_clear(*path[[start, k]])
            )
            parts.append(np.linspace(path[start], path[end], end - start + 1)[1:])
            start = end
        return np.concatenate(parts)

    def _is_clear(self, one: Points, other: Points) -> bool:
        """Return True if a robot fits everywhere on the line between two points."""
        count = 2 * int(np.hypot(*(other - one)) / self._grid.resolution) + 2
        rows, columns = self.squares(np.linspace(one, other, count).astype(np.float64)).T
        return bool(self._fits[rows, columns].all())

    def squares(self, points: Points) -> Int64s:
        """Return row and column of the cells of points, (n, 2); all points of a cell have one path."""
        corner = np.array(self._grid.origin)
        cells: Int64s = np.floor((points - corner) / self._grid.resolution).astype(np.int64)
        return cells[:, ::-1]

    def _nearest_cell(self, row: int, column: int) -> Cell | None:
        middle = self._grid.centre(Cell(row, column))
        return nearest_cell(self._grid, self._fits, middle, _MAX_OFFSET)

    def _compute_field(self, goal: tuple[float, float]) -> Int32s | None:
        cell = nearest_cell(self._grid, self._fits, Point(*goal), self._reach)
        return None if cell is None else potential(self._costs, *cell)


_MIN_AREA: Final = 1.0
"""Minimum area that counts as cut off, for the centre of a robot, m²; larger than a niche."""
_CHECK_RADIUS: Final = 1.0
"""Radius of the first, local check of a passage, m; it does not affect the result."""


class Passages:
    """Narrow passages of one floor plan for discs of one radius."""

    def __init__(self, grid: OccupancyGrid, radius: float, neck: float = 0.0) -> None:
        """`radius`, m; `neck`: narrower passages between rooms count for `at`, too, m."""
        self._grid = grid
        self._radius = radius
        self._floor = largest_region(grid, radius)
        self._centres = grid.centres()
        self._neck = _neck_cells(grid, self._floor, neck) if neck else np.zeros(grid.cells.shape, np.bool_)
        self._to_neck = raster.squared_distance(self._neck) * grid.resolution**2
        self._is_passage = cache(self._is_passage_square)
        self.is_closed_by = cache(self._is_closed_by)
        """True if a robot at this point, m, cuts off at least 1 m² of the reachable floor."""

    def _is_closed_by(self, point: Point) -> bool:
        if self._has_bypass(point):
            return False
        left = self._floor & ~self._occupied(point)
        cut_off = int(left.sum()) - int(raster.largest_region(left).sum())
        return cut_off * self._grid.resolution**2 >= _MIN_AREA

    def are_at_passage(self, points: Floats, within: float) -> Flags:
        """Return which of the points, (k, 2), m, are at a neck or at a passage (see `door_distance`), (k,).

        Points are rounded to the centres of squares of edge `within` / 2; results are cached.
        """
        side = within / 2
        squares, groups = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
        passages = [self._is_passage(float(x), float(y), within) for x, y in (squares + 0.5) * side]
        return np.array(passages, np.bool_)[groups.reshape(-1)]

    def are_visible(self, one: Floats, other: Floats) -> Flags:
        """Return where no wall is between pairs of points, each (k, 2), m; (k,)."""
        farthest = float(np.hypot(*(other - one).T).max(initial=0.0))
        along = np.linspace(0.0, 1.0, int(farthest / self._grid.resolution) + 2)[:, None, None]
        corner = np.array(self._grid.origin)
        cells = ((one + (other - one) * along - corner) / self._grid.resolution).astype(np.intp)
        seen: Flags = ~self._grid.blocking[cells[..., 1], cells[..., 0]].any(axis=0)
        return seen

    def _is_passage_square(self, x: float, y: float, within: float) -> bool:
        point = Point(x, y)
        near = self._grid.contains(point) and self._to_neck[self._grid.cell(point)] <= within**2
        return bool(near) or self.is_near_passage(point, within)

    def is_near_passage(self, point: Point, within: float = 0.5) -> bool:
        """Return True if a robot at some floor point within `within`, m, would close a passage.

        Checks points of a lattice of spacing `within` / 4 around `point`.
        """
        marks = np.linspace(-within, within, 9)
        around = [(point.x + dx, point.y + dy) for dx in marks for dy in marks if np.hypot(dx, dy) <= within]
        return any(self._is_floor(Point(*xy)) and self.is_closed_by(Point(*xy)) for xy in [point, *around])

    def _has_bypass(self, point: Point) -> bool:
        """Return True if the floor around the robot is connected without it, so that nothing is cut off.

        False is inconclusive: there may be a path farther around.
        """
        cell, side = self._grid.cell(point), self._grid.resolution
        if self._grid.contains(point) and self._grid.clearance[cell] >= 3 * self._radius + 2 * side:
            return True  # others can pass on every side
        reach = int((2 * self._radius + _CHECK_RADIUS) / side)
        bottom, left = max(cell.row - reach, 0), max(cell.column - reach, 0)
        around = np.s_[bottom : cell.row + reach + 1, left : cell.column + reach + 1]
        near = raster.flood(self._floor[around], cell.row - bottom, cell.column - left)
        near &= ~self._occupied(point, around)
        return bool(np.array_equal(raster.largest_region(near), near))

    def _is_floor(self, point: Point) -> bool:
        return self._grid.contains(point) and bool(self._floor[self._grid.cell(point)])

    def _occupied(self, point: Point, around: tuple[slice, slice] = np.s_[:, :]) -> Flags:
        """Return where the centre of another robot cannot be, in a part of the map."""
        x, y = self._centres
        return (x[around[1]] - point.x) ** 2 + (y[around[0], None] - point.y) ** 2 < (2 * self._radius) ** 2


def _neck_cells(grid: OccupancyGrid, floor: Flags, width: float) -> Flags:
    """Return the floor narrower than `width`, m, whose removal disconnects rooms, (rows, columns)."""
    roomy = raster.squared_distance(grid.clearance >= width / 2) * grid.resolution**2 < (width / 2) ** 2
    narrow, necks = raster.regions(floor & ~roomy), np.zeros_like(floor)
    for number in range(1, int(narrow.max()) + 1):
        part = narrow == number
        left = floor & ~part
        rows, columns = (np.flatnonzero(part.any(axis=axis)) for axis in (1, 0))
        around = np.s_[max(rows[0] - 1, 0) : rows[-1] + 2, max(columns[0] - 1, 0) : columns[-1] + 2]
        if raster.regions(left[around]).max() <= 1:  # all paths through this part have a bypass
            continue
        if int(left.sum()) - int(raster.largest_region(left).sum()) >= _MIN_AREA / grid.resolution**2:
            necks |= part
    return necks


class FloorStage(msgspec.Struct, frozen=True, eq=False):
    """The floor from one step until the next stage."""

    begin: int
    paths: FloorPaths
    """Paths on the floor as it is."""
    opened: FloorPaths
    """Paths if all doors were open."""
    leaves: Floats
    """(n, 2): centres of the cells of closed doors, m."""


class TrueFloor:
    """All stages of a run's floor, and its narrow passages."""

    def __init__(
        self,
        grid: OccupancyGrid,
        radius: float,
        changes: Sequence[tuple[int, FloorState]] = (),
    ) -> None:
        """`grid`: the robots' map; `radius`: radius of the largest robot, m.

        `changes`: steps, each with all objects on the floor from then on.
        """
        self.grid = grid
        load_numba()  # paths require it, and passages are found faster with it
        self.passages = Passages(grid, radius, STANDARD.neck)
        self._radius, self._reach = radius, STANDARD.reported
        self._changes = changes
        self._path_cache: dict[bytes, FloorPaths] = {}

    def stages(self) -> list[FloorStage]:
        """Return all stages in order."""
        found: list[FloorStage] = [self._stage(0, ())]
        before: FloorState = ()
        for begin, state in self._changes:
            solid = tuple(one for one in state if one.kind != "jammer")
            if solid != before:
                before = solid
                found.append(self._stage(begin, solid))
        return found

    def _stage(self, begin: int, objects: FloorState) -> FloorStage:
        occupied, leaves = np.zeros((2, *self.grid.cells.shape), np.bool_)
        for object_ in objects:
            if object_.kind == "closed door":
                leaves |= self._door_cells(object_)
            else:
                occupied |= self._distances_from(object_) <= object_.radius
        opened = self._paths(occupied)
        paths = self._paths(occupied | leaves) if leaves.any() else opened
        rows, columns = np.nonzero(leaves)
        x, y = self.grid.centres()
        return FloorStage(begin, paths, opened, np.column_stack([x[columns], y[rows]]))

    def _door_cells(self, door: FloorObject) -> Flags:
        """Return the cells of a closed door, (rows, columns); none if the map has no door there."""
        (x, y), (to_x, to_y) = door.points
        try:
            return self._doorways.closed_cells(self._doorways.at(Point((x + to_x) / 2, (y + to_y) / 2)))
        except DoorError:
            return np.zeros(self.grid.cells.shape, np.bool_)

    @cached_property
    def _doorways(self) -> Doorways:
        return Doorways(self.grid, self._radius)

    def _paths(self, occupied: Flags) -> FloorPaths:
        key = occupied.tobytes()
        if key not in self._path_cache:
            cells = np.where(occupied, np.uint8(OCCUPIED), self.grid.cells)
            floor = replace(self.grid, cells=cells) if occupied.any() else self.grid
            self._path_cache[key] = FloorPaths(floor, self._radius, self._reach)
        return self._path_cache[key]

    def _distances_from(self, object_: FloorObject) -> Floats:
        """Return the distances of cells from a line or a point, (rows, columns), m."""
        columns, rows = self.grid.centres()
        (x, y), (to_x, to_y) = object_.points[0], object_.points[-1]
        dx, dy = to_x - x, to_y - y
        across, up = columns[None, :] - x, rows[:, None] - y
        share = np.clip((across * dx + up * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        return np.hypot(across - share * dx, up - share * dy)
