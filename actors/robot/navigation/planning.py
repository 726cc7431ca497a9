"""Global planning on the floor plan: paths through the middle of doors, from one potential per goal."""

import math
from collections.abc import Callable
from functools import lru_cache
from types import MappingProxyType
from typing import Final, Literal, Protocol, TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.array_types import Flags, Floats, Int32s, Octets
from actors.floor import raster
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, SharedCache, nearest_cell
from actors.floor.raster import squared_distance
from actors.geometry import Point
from actors.robot.navigation.cost_map import INSCRIBED, Inflation
from actors.robot.navigation.potential import UNREACHABLE, descent, potential
from actors.robot.navigation.ray_tracing import check_reach, inscribed, squared_within
from actors.settings import NotNegative, Positive, PositiveCount, Settings

N = TypeVar("N", bound=np.generic)


class PlanningParameters(Settings, frozen=True):
    """Global planner; costs as in d3scomp/ROSRemote, simulation/params (navfn on a ROS costmap)."""

    method: Literal["navfn", "grid"] = "navfn"
    """"navfn": as ROS's navfn, on the map's cells, with a new wave for each plan. "grid": our own, on a
    coarser grid, with cached potentials of goals; also used for a behaviour's queries with both methods. A
    parameter that names a method is used by that only."""
    cell: Positive = 0.05
    """grid: side of its cells, m: the smallest multiple of the map's that is at least this."""
    margin: NotNegative = 0.03
    """grid: distance of the body from walls, m; own choice: the local planner's deviation."""
    allowance: NotNegative = 0.003
    """navfn: added to the body's radius, m; the files' robot_radius is 0.18, the TurtleBot's is 0.177."""
    padding: NotNegative = 0.01
    """navfn: added to the coordinates of the outline's corners, m (costmap_2d)."""
    narrowest: NotNegative = 0.0
    """grid: minimum width of gaps, m; 0: given by `margin`. Own choice: the local planner passes such gaps
    reliably."""
    inflation_radius: NotNegative = 0.5
    """Distance from a wall at which its cost ends, m (costmap_2d inflation_radius)."""
    scaling: NotNegative = 10.0
    """Decay rate of the cost with the distance to a wall, 1/m (costmap_2d cost_scaling_factor)."""
    neutral: PositiveCount = 50
    """Cost of a cell far from walls (navfn, COST_NEUTRAL)."""
    factor: NotNegative = 0.8
    """Weight of a cell's cost on the cost map, up to 252 (navfn, COST_FACTOR as compiled; navfn does not read
    the files' cost_factor 3.0)."""
    wall: NotNegative = 0.1
    """Distance from a wall of the map within which marks count as the wall, m; own choice: cell size and pose
    error."""
    tolerance: NotNegative = 0.5
    """An occupied goal is replaced by the nearest free point within this distance, m (navfn
    default_tolerance); with the method grid also the start."""
    cached: PositiveCount = 16
    """grid: number of cached potentials, 0.5 MB each on the corridor map."""
    cached_mb: Positive = 16.0
    """grid: size of the cache, MB; at least one potential is cached."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method == "navfn" and self.neutral > HIGHEST:
            raise self.wrong("neutral", f'at most {HIGHEST} where planner.method is "navfn"')
        self.check_unused(_IDLE[self.method], f'planner.method is "{self.method}"')


HIGHEST: Final = 253
"""Highest cost of a free cell in navfn."""
_IDLE: Final = {
    "navfn": ("cell", "margin", "narrowest", "cached", "cached_mb"),
    "grid": ("allowance", "padding"),
}
"""Unused parameters by method."""
_GRID: Final = PlanningParameters(method="grid", factor=3.0)
PLANNER_PRESETS: Final = MappingProxyType(
    {"chapter": PlanningParameters(), "robust": replace(_GRID, narrowest=0.56)}
)
"""Presets with the names of those of the table [navigation]."""


class GlobalPlanner(Protocol):
    """A global planner."""

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """Return the path from `start` to `goal`, or to a point near it; None if there is none.

        (n, 2), n ≥ 1, m, map frame. `marks`: (k, 2), m, map frame: additional obstacles.
        """
        ...


class PlanningGrid(msgspec.Struct, frozen=True, eq=False, weakref=True):
    """Planning grid of a floor plan for one robot's body."""

    grid: OccupancyGrid
    """Cells that are FREE for the body's centre."""
    clearance: Floats
    """(rows, columns): lower bound of the distance to the nearest wall, m."""
    costs: Int32s
    """(rows, columns): > 0 in free cells, otherwise 0."""
    radius: float
    """Radius of the body, m."""
    reach: float
    """Required clearance of the body's centre, m."""


_PLANNING_GRIDS: Final = SharedCache[PlanningGrid]()


def planning_grid(plan: OccupancyGrid, radius: float, parameters: PlanningParameters = _GRID) -> PlanningGrid:
    """Return the planning grid for a disc of `radius`, m: computed once per map and body, and shared."""
    content = plan.content, radius, parameters
    return _PLANNING_GRIDS.get(content, lambda: _planning_grid(plan, radius, parameters))


def _planning_grid(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> PlanningGrid:
    factor = _factor(parameters, plan.resolution)
    clearance = _coarse(plan.clearance, factor)
    reach = radius + parameters.margin
    passable = (clearance >= reach) & _wide_enough(plan, reach, factor, parameters.narrowest)
    costs = np.where(passable, _costs(clearance, radius, parameters), 0).astype(np.int32)
    cells = np.where(passable, FREE, OCCUPIED).astype(np.uint8)
    for shared in (clearance, costs):
        shared.setflags(write=False)
    return PlanningGrid(
        OccupancyGrid(cells, plan.resolution * factor, plan.origin), clearance, costs, radius, reach
    )


def narrowest_door(radius: float, parameters: PlanningParameters, resolution: float) -> float:
    """Return the width of the narrowest door, m, with a plan for a disc of `radius`, m.

    The door's jambs are aligned with the map's cells, of side `resolution`, m.
    """
    if parameters.method == "navfn":
        within = inscribed(radius + parameters.allowance, parameters.padding)
        return (2 * math.floor(within / resolution) + 1) * resolution
    beside = math.ceil((radius + parameters.margin) / resolution - 0.5 - 1e-9)
    by_margin = 2 * (beside + _factor(parameters, resolution)) - 1
    return max(by_margin, math.ceil(parameters.narrowest / resolution - 1e-9)) * resolution


def _factor(parameters: PlanningParameters, resolution: float) -> int:
    """Return the side of a planning cell in cells of the map."""
    return max(1, math.ceil(parameters.cell / resolution - 1e-9))


def _wide_enough(plan: OccupancyGrid, reach: float, factor: int, narrowest: float) -> Flags | np.bool_:
    """Return which planning cells are outside of gaps between walls narrower than `narrowest`, m.

    A cell beside a wall counts as outside if it is near the middle of a wide gap. The middle of a gap is a
    cell or the line between two.
    """
    if not narrowest:
        return np.True_
    cell = plan.resolution
    beside = plan.clearance >= (narrowest - cell) / 2 - 1e-9
    square = beside[:-1, :-1] & beside[1:, :-1] & beside[:-1, 1:] & beside[1:, 1:]
    middle = plan.clearance >= narrowest / 2 - 1e-9
    middle[:-1, :-1] |= square
    middle[1:, 1:] |= square
    beyond = math.ceil((narrowest + cell) / 2 / cell) + 1
    away = cell * np.sqrt(squared_distance(middle, beyond * beyond))
    return _coarse((narrowest + cell) / 2 - reach - away, factor) >= -1e-9


def _costs(distance: Floats, radius: float, parameters: PlanningParameters) -> Int32s:
    """Return the costs of cells by distance from obstacles, m."""
    inflation = Inflation(radius, parameters.inflation_radius, parameters.scaling)
    cost_map = np.minimum(inflation.costs(distance), INSCRIBED - 1)
    return parameters.neutral + np.rint(parameters.factor * cost_map).astype(np.int32)


def occupied(floor: PlanningGrid, marks: Floats, parameters: PlanningParameters = _GRID) -> Int32s:
    """Return the costs with additional obstacles; see `with_marks`."""
    cell, costs = floor.grid.resolution, floor.costs
    reach = math.ceil(max(parameters.inflation_radius, floor.reach) / cell)

    def near(window: Window, marked: Octets) -> Int32s:
        distance = cell * np.sqrt(squared_within(marked, reach).astype(np.float64))
        higher = np.maximum(costs[window], _costs(distance, floor.radius, parameters))
        return np.where((costs[window] > 0) & (distance >= floor.reach), higher, 0)

    return with_marks(costs, floor.grid, floor.clearance, marks, parameters.wall, reach, near)


Window = tuple[slice, slice]


def with_marks(
    costs: NDArray[N],
    grid: OccupancyGrid,
    clearance: Floats,
    marks: Floats,
    wall: float,
    reach: int,
    near: Callable[[Window, Octets], NDArray[N]],
) -> NDArray[N]:
    """Return costs on a grid with marked cells, read-only; the same array if there are none.

    `marks`: (k, 2), m, map frame; those nearer than `wall`, m, to a wall of the map, by `clearance`, m, count
    as the wall. `near` returns the costs of the window within `reach` cells of the others, from its marks (0
    or 1).
    """
    column, row = np.floor((marks - np.array(grid.origin)) / grid.resolution).astype(np.intp).T
    inside = (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
    row, column = row[inside], column[inside]
    strange = clearance[row, column] >= wall
    row, column = row[strange], column[strange]
    if not row.size:
        return costs
    bottom, left = max(int(row.min()) - reach, 0), max(int(column.min()) - reach, 0)
    top, right = min(int(row.max()) + reach + 1, grid.rows), min(int(column.max()) + reach + 1, grid.columns)
    marked = np.zeros((top - bottom, right - left), np.uint8)
    marked[row - bottom, column - left] = 1
    window = (slice(bottom, top), slice(left, right))
    changed = costs.copy()
    changed[window] = near(window, marked)
    changed.setflags(write=False)  # like costs without marks, for which the kernels are compiled
    return changed


def blocks(fine: NDArray[N], factor: int) -> NDArray[N]:
    """Return a grid as blocks, (rows, factor, columns, factor), padded with 0 in the north and east."""
    rows, columns = -(-fine.shape[0] // factor), -(-fine.shape[1] // factor)
    padded = np.zeros((rows * factor, columns * factor), fine.dtype)
    padded[: fine.shape[0], : fine.shape[1]] = fine
    return padded.reshape(rows, factor, columns, factor)


def _coarse(fine: Floats, factor: int) -> Floats:
    """Return the minimum of each block of factor × factor cells, padded with 0."""
    least: Floats = blocks(fine, factor).min(axis=(1, 3))
    return least


class GridPlanner:
    """Global planner with the method grid; caches the potentials of the last goals."""

    def __init__(self, floor: PlanningGrid, parameters: PlanningParameters = _GRID) -> None:
        farthest = max(parameters.inflation_radius, floor.reach)
        check_reach("planner: the inflation radius", farthest, floor.grid.resolution)
        self._floor = floor
        self._parameters = parameters
        self._region = np.zeros(floor.costs.shape, dtype=np.bool_)
        in_memory = int(parameters.cached_mb * 1e6) // floor.costs.nbytes
        kept = lru_cache(max(1, min(parameters.cached, in_memory)))
        self._field = kept(lambda goal: potential(floor.costs, *goal))

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """Return the path to `goal`, or to the nearest point within the tolerance; None if there is none.

        (n, 2), n ≥ 1, m, map frame: centres of neighbouring cells; the last point is the goal if its cell is
        free. `marks`: (k, 2), m, map frame: additional obstacles.
        """
        grid, floor = self._floor.grid, self._floor
        costs = floor.costs if marks is None else occupied(floor, marks, self._parameters)
        first = self._nearest(costs > 0, start)
        if first is None:
            return None
        region = self._connected_floor(costs, first)
        last = self._nearest(region, goal)
        if last is None:
            return None
        field = self._field(last) if costs is floor.costs else potential(costs, *last)
        assert field[first] != UNREACHABLE
        cells = descent(costs, field, *first)
        x, y = grid.centres()
        path = np.column_stack((x[cells[:, 1]], y[cells[:, 0]]))
        if last == grid.cell(goal):
            path[-1] = goal
        return path

    def _connected_floor(self, costs: Int32s, start: Cell) -> Flags:
        """Return the floor that is connected to the start."""
        if costs is not self._floor.costs:
            return raster.flood(costs > 0, *start)
        if not self._region[start]:
            self._region = raster.flood(costs > 0, *start)
        return self._region

    def _nearest(self, admitted: Flags, point: Point) -> Cell | None:
        return nearest_cell(self._floor.grid, admitted, point, self._parameters.tolerance)
