"""Global planning as ROS's navfn does it, on its cost map: the plans of the original, point by point.

By ros-planning/navigation: costmap_2d's static and inflation layers, and navfn_ros.cpp, unknown space not
allowed. Every plan is a new wave from the robot, which ends as it comes to the goal; from there the way leads
down to the robot. A robot whose four neighbouring cells are all too near to something has no plan. Points are
cell number · resolution, as in the original: half a cell south-west of where their potential is.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats, Indices, Octets, Singles
from actors.floor.grid import OCCUPIED, UNKNOWN, Cell, OccupancyGrid, SharedCache
from actors.geometry import Point
from actors.robot.navigation import ray_tracing
from actors.robot.navigation.cost_map import INSCRIBED, Inflation
from actors.robot.navigation.planning import HIGHEST, PlanningParameters, Window, with_marks
from actors.robot.navigation.potential import IMPASSABLE, UNREACHED, wave, way_down
from actors.robot.navigation.ray_tracing import check_reach, squared_within

_NO_INFORMATION: Final = 255
"""Cost of a cell of which the map says nothing, where nothing is near (costmap_2d)."""


@dataclass(frozen=True, eq=False)
class GlobalCosts:
    """What it costs one robot's body to be somewhere on the floor plan."""

    plan: OccupancyGrid
    inflation: Inflation
    costs: Octets
    """(rows, columns), read-only: of a step through each cell, as `potential.wave` takes it."""


_COSTS: Final = SharedCache[GlobalCosts]()


def global_costs(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> GlobalCosts:
    """The costs for a disc of `radius`, m: computed once per map and body, never changed, and shared.

    Raises ParameterError for an inflation that reaches too many cells.
    """
    content = plan.content, radius, parameters
    return _COSTS.get(content, lambda: _global_costs(plan, radius, parameters))


def _global_costs(plan: OccupancyGrid, radius: float, parameters: PlanningParameters) -> GlobalCosts:
    within = ray_tracing.inscribed(radius + parameters.allowance, parameters.padding)
    inflation = Inflation(within, parameters.inflation_radius, parameters.scaling)
    farthest = max(inflation.radius, within)
    check_reach("planner: the reach of what is marked", farthest, plan.resolution)
    costs = _cell_costs(static_costs(plan, inflation), parameters)
    costs[[0, -1]] = costs[:, [0, -1]] = IMPASSABLE
    costs.setflags(write=False)
    return GlobalCosts(plan, inflation, costs)


def static_costs(plan: OccupancyGrid, inflation: Inflation) -> Octets:
    """costmap_2d's costs of the floor plan alone: (rows, columns), 254 in a wall, 255 in unknown space."""
    costs = _inflated(plan.cells == OCCUPIED, inflation, plan.resolution)
    costs[(plan.cells == UNKNOWN) & (costs < INSCRIBED)] = _NO_INFORMATION
    return costs


def _inflated(marked: NDArray[np.bool_ | np.uint8], inflation: Inflation, cell: float) -> Octets:
    """Costs around marked cells of side `cell`, m."""
    squared = squared_within(marked.astype(np.uint8), inflation.reach(cell))
    return inflation.table(cell)[squared]


def _cell_costs(costs: Octets, parameters: PlanningParameters) -> Octets:
    """What a step through a cell costs that has these costs on the cost map."""
    weighed = np.minimum(np.floor(parameters.neutral + parameters.factor * np.arange(256.0)), HIGHEST)
    weighed[INSCRIBED:] = IMPASSABLE
    table: Octets = weighed.astype(np.uint8)
    return table[costs]


def occupied(ground: GlobalCosts, marks: Floats, parameters: PlanningParameters) -> Octets:
    """Return the costs with more things on the floor than its plan shows; see `with_marks`."""
    plan, inflation = ground.plan, ground.inflation

    def near(window: Window, marked: Octets) -> Octets:
        added = _cell_costs(_inflated(marked, inflation, plan.resolution), parameters)
        return np.maximum(ground.costs[window], added)

    reach = inflation.reach(plan.resolution)
    return with_marks(ground.costs, plan, plan.clearance, marks, parameters.wall, reach, near)


class NavfnPlanner:
    """Finds ways on one floor plan by the method navfn; keeps the last one for a robot that stands."""

    def __init__(self, ground: GlobalCosts, parameters: PlanningParameters) -> None:
        """`parameters`: those that the costs were made by."""
        self._ground = ground
        self._p = parameters
        self._asked: tuple[Cell, Point] | None = None
        self._answer: Floats | None = None
        """To that, without marks: a way follows from the robot's cell and the goal."""

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        """The way from `start` to `goal`, or to the nearest point within the tolerance; None without one.

        (n, 2), n ≥ 2, m in the map frame: from the robot's cell, half a cell from point to point, beside what
        cannot be passed up to a diagonal. The last is the goal itself where the body's centre may be in its
        cell, else one of a raster around it. `marks`: (k, 2), m, map frame: what else is in the way.
        """
        plan = self._ground.plan
        if marks is not None:
            return self._way(occupied(self._ground, marks, self._p), plan.cell(start), goal)
        asked = plan.cell(start), goal
        if asked != self._asked:
            self._asked, self._answer = asked, self._way(self._ground.costs, *asked)
        return self._answer

    def _way(self, costs: Octets, first: Cell, goal: Point) -> Floats | None:
        plan, last = self._ground.plan, self._ground.plan.cell(goal)
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
        points = way_down(field, *last, self._p.neutral)[::-1, ::-1] * plan.resolution
        return np.vstack((np.array(plan.origin) + points, np.array(end)))

    def _nearest(self, field: Singles, goal: Point) -> tuple[Point, Cell] | None:
        """The point nearest to the goal in a cell that was reached, and the cell; None without one.

        Of the points that are a whole number of cells away from the goal less the tolerance, along both axes.
        """
        plan = self._ground.plan
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
    """Places a cell apart from `middle` less `tolerance`, up to as far beyond it, along one axis of a map.

    And in which of its `count` cells each is: those outside are left out.
    """
    begin = middle - tolerance
    low = max(0, math.floor((origin - begin) / cell))
    high = min(math.floor(2 * tolerance / cell + 1e-9), math.ceil((origin - begin) / cell) + count)
    places = begin + cell * np.arange(low, high + 1)
    cells = np.floor((places - origin) / cell).astype(np.intp)
    inside = (cells >= 0) & (cells < count)
    return places[inside], cells[inside]
