"""Global planning like ROS's navfn: the plans of the original, point by point.

After ros-planning/navigation: costmap_2d's static and inflation layers, and navfn_ros.cpp without unknown
space. Each plan is a new wave from the robot to the goal, followed by gradient descent back to the robot. A
robot whose four neighbouring cells are all occupied has no plan. Points are cell number · resolution, as in
the original: half a cell south-west of their potential.
"""

import math
from typing import Final

import msgspec
import numpy as np

from actors.array_types import Floats, Indices, Octets, Singles
from actors.floor.grid import OCCUPIED, UNKNOWN, Cell, OccupancyGrid, SharedCache
from actors.floor.raster import squared_distance
from actors.geometry import Point
from actors.robot.navigation import ray_tracing
from actors.robot.navigation.cost_map import INSCRIBED, Inflation
from actors.robot.navigation.planning import HIGHEST, PlanningParameters, Window, with_marks
from actors.robot.navigation.potential import IMPASSABLE, UNREACHED, steepest_descent, wave
from actors.robot.navigation.ray_tracing import check_reach, squared_within

_NO_INFORMATION: Final = 255
"""Cost of an unknown cell away from obstacles (costmap_2d)."""


class GlobalCosts(msgspec.Struct, frozen=True, eq=False, weakref=True):
    """Global cost map of a floor plan for one body."""

    plan: OccupancyGrid
    inflation: Inflation
    costs: Octets
    """(rows, columns), read-only: cost of each cell for `potential.wave`."""


_COSTS: Final = SharedCache[GlobalCosts]()


def global_costs(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> GlobalCosts:
    """Return the costs for a disc of `radius`, m: computed once per map and body, and shared.

    Raises ParameterError for an inflation radius of too many cells.
    """
    content = plan.content, radius, parameters
    return _COSTS.get(content, lambda: _global_costs(plan, radius, parameters))


def _global_costs(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> GlobalCosts:
    within = ray_tracing.inscribed(radius + parameters.allowance, parameters.padding)
    inflation = Inflation(within, parameters.inflation_radius, parameters.scaling)
    farthest = max(inflation.radius, within)
    check_reach("planner: the inflation radius", farthest, plan.resolution)
    costs = _cell_costs(static_costs(plan, inflation), parameters)
    costs[[0, -1]] = costs[:, [0, -1]] = IMPASSABLE
    costs.setflags(write=False)
    return GlobalCosts(plan, inflation, costs)


def static_costs(plan: OccupancyGrid, inflation: Inflation) -> Octets:
    """Return costmap_2d's costs of the floor plan: (rows, columns), 254 in walls, 255 in unknown space."""
    beyond = inflation.reach(plan.resolution) + 1
    limit = beyond * beyond
    squared = np.minimum(squared_distance(plan.cells == OCCUPIED, limit), limit).astype(np.int16)
    costs = inflation.table(plan.resolution)[squared]
    costs[(plan.cells == UNKNOWN) & (costs < INSCRIBED)] = _NO_INFORMATION
    return costs


def _cell_costs(costs: Octets, parameters: PlanningParameters) -> Octets:
    """Return navfn's costs of cells from their costs on the cost map."""
    weighed = np.minimum(np.floor(parameters.neutral + parameters.factor * np.arange(256.0)), HIGHEST)
    weighed[INSCRIBED:] = IMPASSABLE
    table: Octets = weighed.astype(np.uint8)
    return table[costs]


def occupied(cost_map: GlobalCosts, marks: Floats, parameters: PlanningParameters) -> Octets:
    """Return the costs with additional obstacles; see `with_marks`."""
    plan, inflation = cost_map.plan, cost_map.inflation

    def near(window: Window, marked: Octets) -> Octets:
        costs = inflation.table(plan.resolution)[squared_within(marked, reach)]
        return np.maximum(cost_map.costs[window], _cell_costs(costs, parameters))

    reach = inflation.reach(plan.resolution)
    return with_marks(cost_map.costs, plan, plan.clearance, marks, parameters.wall, reach, near)


class NavfnPlanner:
    """Global planner with the method navfn; caches the last path for a standing robot."""

    def __init__(self, cost_map: GlobalCosts, parameters: PlanningParameters) -> None:
        """Create a planner; `parameters` are those of `cost_map`."""
        self._cost_map = cost_map
        self._p = parameters
        self._query: tuple[Cell, Point] | None = None
        self._answer: Floats | None = None
        """Path of `_query` without marks."""

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """Return the path to `goal`, or to the nearest point within the tolerance; None if there is none.

        (n, 2), n ≥ 2, m, map frame: from the robot's cell, spacing half a cell, up to a diagonal beside
        obstacles. The last point is the goal if its cell is free, otherwise one of a raster around it.
        `marks`: (k, 2), m, map frame: additional obstacles.
        """
        plan = self._cost_map.plan
        if marks is not None:
            return self._search(occupied(self._cost_map, marks, self._p), plan.cell(start), goal)
        query = plan.cell(start), goal
        if query != self._query:
            self._query, self._answer = query, self._search(self._cost_map.costs, *query)
        return self._answer

    def _search(self, costs: Octets, first: Cell, goal: Point) -> Floats | None:
        plan, last = self._cost_map.plan, self._cost_map.plan.cell(goal)
        if not (0 < first.row < plan.rows - 1 and 0 < first.column < plan.columns - 1):
            return None
        known = plan.contains(goal)
        field = wave(costs, first, self._p.neutral, last if known else None)
        end = goal
        if not known or field[last] >= UNREACHED:
            nearest = self._nearest(field, goal)
            if nearest is None:
                return None
            end, last = nearest
        points = steepest_descent(field, *last, self._p.neutral)[::-1, ::-1]
        path = np.empty((len(points) + 1, 2))
        for axis in range(2):  # along the points, which are many
            path[:-1, axis] = points[:, axis] * plan.resolution + plan.origin[axis]
        path[-1] = end
        return path

    def _nearest(self, field: Singles, goal: Point) -> tuple[Point, Cell] | None:
        """Return the nearest raster point to the goal in a reached cell, and the cell; None if there is none.

        The raster has a spacing of one cell and begins at the goal less the tolerance, along both axes.
        """
        plan = self._cost_map.plan
        x, column = _raster(goal.x, self._p.tolerance, plan.origin.x, plan.resolution, plan.columns)
        y, row = _raster(goal.y, self._p.tolerance, plan.origin.y, plan.resolution, plan.rows)
        reached = field[np.ix_(row, column)] < UNREACHED
        if not reached.any():
            return None
        squared = np.square(y - goal.y)[:, None] + np.square(x - goal.x)[None, :]
        i, j = divmod(int(np.argmin(np.where(reached, squared, np.inf))), x.size)
        return Point(float(x[j]), float(y[i])), Cell(int(row[i]), int(column[j]))


def _raster(
    middle: float, tolerance: float, origin: float, cell: float, count: int
) -> tuple[Floats, Indices]:
    """Return coordinates from `middle` - `tolerance` to `middle` + `tolerance`, and their cells.

    Spacing: one cell; along one axis of a map with `count` cells. Points outside the map are omitted.
    """
    begin = middle - tolerance
    low = max(0, math.floor((origin - begin) / cell))
    high = min(math.floor(2 * tolerance / cell + 1e-9), math.ceil((origin - begin) / cell) + count)
    places = begin + cell * np.arange(low, high + 1)
    cells = np.floor((places - origin) / cell).astype(np.intp)
    inside = (cells >= 0) & (cells < count)
    return places[inside], cells[inside]
