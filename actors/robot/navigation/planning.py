"""Global planning on the floor plan: ways that keep to the middle of doors, from one potential per goal."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final, Literal, Protocol, TypeVar

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
    """How ways are planned; costs as in d3scomp/ROSRemote, simulation/params (navfn on a costmap of ROS)."""

    method: Literal["navfn", "grid"] = "navfn"
    """"navfn": as ROS's navfn, on the map's own cells, by a new wave for every plan. "grid": our own, on a
    coarser grid, by potentials from the goal that are kept; a behaviour's questions about the floor are
    answered on it with both. A parameter that names a method holds for that only."""
    cell: Positive = 0.05
    """grid: side of its cells, m: the smallest multiple of the map's that is at least this."""
    margin: NotNegative = 0.03
    """grid: distance that the body keeps from walls, m; own choice: what the local planner may stray."""
    allowance: NotNegative = 0.003
    """navfn: added to the body's radius, m; the files' robot_radius is 0.18, the TurtleBot's is 0.177."""
    padding: NotNegative = 0.01
    """navfn: added to the coordinates of the outline's corners, m (costmap_2d)."""
    narrowest: NotNegative = 0.0
    """grid: no plan leads through gaps narrower than this, m; 0: as `margin` has it. Own choice: what the
    local planner is certain to pass."""
    inflation_radius: NotNegative = 0.5
    """Distance from a wall at which its cost ends, m (costmap_2d inflation_radius)."""
    scaling: NotNegative = 10.0
    """How fast the cost falls with the distance to a wall, 1/m (costmap_2d cost_scaling_factor)."""
    neutral: PositiveCount = 50
    """Cost of a cell far from walls (navfn, COST_NEUTRAL)."""
    factor: NotNegative = 0.8
    """Weight of a cell's cost on the cost map, up to 252 (navfn, COST_FACTOR as compiled; navfn does not read
    the files' cost_factor 3.0)."""
    wall: NotNegative = 0.1
    """Marks nearer to a wall of the map than this count as the wall, m; own choice: cells and errors of the
    pose."""
    tolerance: NotNegative = 0.5
    """A goal where the robot cannot stand becomes the nearest free point within this distance, m
    (navfn default_tolerance); with the method grid also the start."""
    cached: PositiveCount = 16
    """grid: number of potentials that are kept, 0.5 MB each on the corridor map."""
    cached_mb: Positive = 16.0
    """grid: their size in memory, MB; one is always kept."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method == "navfn" and self.neutral > HIGHEST:
            raise self.wrong("neutral", f'at most {HIGHEST} where planner.method is "navfn"')
        self.check_unused(_IDLE[self.method], f'planner.method is "{self.method}"')


HIGHEST: Final = 253
"""Cost of a cell in navfn, at most, that can be passed."""
_IDLE: Final = {
    "navfn": ("cell", "margin", "narrowest", "cached", "cached_mb"),
    "grid": ("allowance", "padding"),
}
"""By method: parameters that it does not use."""
_GRID: Final = PlanningParameters(method="grid", factor=3.0)
PLANNER_PRESETS: Final[Mapping[str, PlanningParameters]] = MappingProxyType(
    {"chapter": PlanningParameters(), "robust": replace(_GRID, narrowest=0.56)}
)
"""As the presets of the table [navigation] are called."""


class GlobalPlanner(Protocol):
    """What finds ways."""

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """The way from `start` to `goal`, or to a point near it; None without one.

        (n, 2), n ≥ 1, m in the map frame. `marks`: (k, 2), m, map frame: what else is in the way.
        """
        ...


@dataclass(frozen=True, eq=False)
class Ground:
    """The floor plan as one robot's body sees it: where its centre may be, and what that costs."""

    grid: OccupancyGrid
    """The planning grid; FREE where the body's centre may be."""
    clearance: Floats
    """(rows, columns): at least so far is the nearest wall, m."""
    costs: Int32s
    """(rows, columns), > 0; 0 where the body's centre may not be."""
    radius: float
    """Of the body, m."""
    reach: float
    """The clearance that the body's centre needs, m."""


_GROUNDS: Final = SharedCache[Ground]()


def ground(plan: OccupancyGrid, radius: float, parameters: PlanningParameters = _GRID) -> Ground:
    """The ground for a disc of `radius`, m: computed once per map and body, never changed, and shared."""
    content = plan.content, radius, parameters
    return _GROUNDS.get(content, lambda: _ground(plan, radius, parameters))


def _ground(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> Ground:
    factor = _factor(parameters, plan.resolution)
    clearance = _coarse(plan.clearance, factor)
    reach = radius + parameters.margin
    passable = (clearance >= reach) & _wide_enough(plan, reach, factor, parameters.narrowest)
    costs = np.where(passable, _costs(clearance, radius, parameters), 0).astype(np.int32)
    cells = np.where(passable, FREE, OCCUPIED).astype(np.uint8)
    for shared in (clearance, costs):
        shared.setflags(write=False)
    return Ground(
        OccupancyGrid(cells, plan.resolution * factor, plan.origin), clearance, costs, radius, reach
    )


def narrowest_door(radius: float, parameters: PlanningParameters, resolution: float) -> float:
    """Return the width, m, from which on a disc of `radius`, m, has a plan through any door of the map.

    The door's jambs lie along the map's cells, of side `resolution`, m.
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
    """Return which planning cells lie in no gap between walls that is narrower than `narrowest`, m.

    A cell beside a wall is near the middle of a wide gap; a cell in a narrow gap is not. The middle of a gap
    is a cell, or the line between two.
    """
    if not narrowest:
        return np.True_
    cell = plan.resolution
    beside = plan.clearance >= (narrowest - cell) / 2 - 1e-9
    square = beside[:-1, :-1] & beside[1:, :-1] & beside[:-1, 1:] & beside[1:, 1:]
    middle = plan.clearance >= narrowest / 2 - 1e-9
    middle[:-1, :-1] |= square
    middle[1:, 1:] |= square
    away = cell * np.sqrt(squared_distance(middle))
    open_floor: Flags = _coarse((narrowest + cell) / 2 - reach - away, factor) >= -1e-9
    return open_floor


def _costs(distance: Floats, radius: float, parameters: PlanningParameters) -> Int32s:
    """What a cell costs so far from what it must not touch, m."""
    inflation = Inflation(radius, parameters.inflation_radius, parameters.scaling)
    cost_map = np.minimum(inflation.costs(distance), INSCRIBED - 1)
    return parameters.neutral + np.rint(parameters.factor * cost_map).astype(np.int32)


def occupied(ground: Ground, marks: Floats, parameters: PlanningParameters = _GRID) -> Int32s:
    """Return the ground's costs with more things on it than the floor plan shows; see `with_marks`."""
    cell, costs = ground.grid.resolution, ground.costs
    reach = math.ceil(max(parameters.inflation_radius, ground.reach) / cell)

    def near(window: Window, marked: Octets) -> Int32s:
        distance = cell * np.sqrt(squared_within(marked, reach).astype(np.float64))
        higher = np.maximum(costs[window], _costs(distance, ground.radius, parameters))
        return np.where((costs[window] > 0) & (distance >= ground.reach), higher, 0)

    return with_marks(costs, ground.grid, ground.clearance, marks, parameters.wall, reach, near)


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
    """Return costs on a grid with marked cells, read-only; the very same without any.

    `marks`: (k, 2), m, map frame; those nearer than `wall`, m, to a wall of the map, by `clearance`, m, are
    taken for the wall. `near` gives the costs of the window within `reach` cells of the others, by what is
    marked there: 1, elsewhere 0.
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
    changed.setflags(write=False)  # as without marks: the kernels are compiled for that
    return changed


def blocks(fine: NDArray[N], factor: int) -> NDArray[N]:
    """Return a grid as blocks, (rows, factor, columns, factor), with 0 beyond the north and east edges."""
    rows, columns = -(-fine.shape[0] // factor), -(-fine.shape[1] // factor)
    padded = np.zeros((rows * factor, columns * factor), fine.dtype)
    padded[: fine.shape[0], : fine.shape[1]] = fine
    return padded.reshape(rows, factor, columns, factor)


def _coarse(fine: Floats, factor: int) -> Floats:
    """Return the least value of each block of factor × factor cells; beyond the edges all is 0."""
    least: Floats = blocks(fine, factor).min(axis=(1, 3))
    return least


class Planner:
    """Finds ways on one ground by the method grid; keeps the potentials of the last goals."""

    def __init__(self, ground: Ground, parameters: PlanningParameters = _GRID) -> None:
        farthest = max(parameters.inflation_radius, ground.reach)
        check_reach("planner: the reach of what is marked", farthest, ground.grid.resolution)
        self._ground = ground
        self._parameters = parameters
        self._region = np.zeros(ground.costs.shape, dtype=np.bool_)
        in_memory = int(parameters.cached_mb * 1e6) // ground.costs.nbytes
        kept = lru_cache(max(1, min(parameters.cached, in_memory)))
        self._field = kept(lambda goal: potential(ground.costs, *goal))

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """The way from `start` to `goal`, or to the nearest point within the tolerance; None without one.

        (n, 2), n ≥ 1, m in the map frame: centres of neighbouring cells, but for the last point, which is
        the goal itself where the body has room there. `marks`: (k, 2), m, map frame: what else is in the way.
        """
        grid, ground = self._ground.grid, self._ground
        costs = ground.costs if marks is None else occupied(ground, marks, self._parameters)
        first = self._nearest(costs > 0, start)
        if first is None:
            return None
        region = self._around(costs, first)
        last = self._nearest(region, goal)
        if last is None:
            return None
        field = self._field(last) if costs is ground.costs else potential(costs, *last)
        assert field[first] != UNREACHABLE
        cells = descent(costs, field, *first)
        x, y = grid.centres()
        way = np.column_stack((x[cells[:, 1]], y[cells[:, 0]]))
        if last == grid.cell(goal):
            way[-1] = goal
        return way

    def _around(self, costs: Int32s, start: Cell) -> Flags:
        """The floor that is connected to the start."""
        if costs is not self._ground.costs:
            return raster.flood(costs > 0, *start)
        if not self._region[start]:
            self._region = raster.flood(costs > 0, *start)
        return self._region

    def _nearest(self, admitted: Flags, point: Point) -> Cell | None:
        return nearest_cell(self._ground.grid, admitted, point, self._parameters.tolerance)
