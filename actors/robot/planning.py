"""Global planning on the floor plan: ways that keep to the middle of doors, from one potential per goal."""

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors import distance, flood
from actors.geometry import Point
from actors.grid import FREE, OCCUPIED, Cell, OccupancyGrid
from actors.robot.potential import UNREACHABLE, descent, potential


@dataclass(frozen=True)
class PlanningParameters:
    """How ways are planned; costs as in d3scomp/ROSRemote, simulation/params (navfn on a costmap of ROS)."""

    cell: float = 0.05
    """The planning grid's cells are the smallest multiple of the map's that is at least so long, m."""
    margin: float = 0.03
    """The body's disc keeps at least this far from walls, m; own choice: what the driver may stray."""
    inflation_radius: float = 0.5
    """Walls farther away than this cost nothing, m (costmap_2d inflation_radius)."""
    scaling: float = 10.0
    """How fast the cost falls with the distance to a wall, 1/m (costmap_2d cost_scaling_factor)."""
    neutral: int = 10
    """Cost of a cell far from walls; a fifth of navfn's 50, to keep the numbers small."""
    wall: int = 151
    """What the cell that just touches a wall costs on top; a fifth of 3.0 * 252 (cost_factor, costmap_2d)."""
    tolerance: float = 0.5
    """A goal where the robot cannot stand becomes the nearest point, within so many m, where it can
    (navfn default_tolerance); the same holds for the start."""
    cached: int = 16
    """Potentials kept for goals to come back to; about 0.5 MB each on the corridor map."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The floor plan as one robot's body sees it: where its centre may be, and what that costs."""

    grid: OccupancyGrid
    """The planning grid; FREE where the body's centre may be."""
    clearance: NDArray[np.float64]
    """(rows, columns): at least so far is the nearest wall, m."""
    costs: NDArray[np.int32]
    """(rows, columns), > 0; 0 where the body's centre may not be."""
    reach: float
    """The clearance that the body's centre needs, m."""


def ground(
    plan: OccupancyGrid, radius: float, parameters: PlanningParameters = PlanningParameters()
) -> Ground:
    """The ground for a disc of `radius`, m: computed once per map and body, never changed."""
    factor = max(1, math.ceil(parameters.cell / plan.resolution - 1e-9))
    clearance = _coarse(distance.clearance(plan), factor)
    reach = radius + parameters.margin
    passable = clearance >= reach
    near = parameters.wall * np.exp(-parameters.scaling * (clearance - radius))
    near[clearance > parameters.inflation_radius] = 0.0
    costs = np.where(passable, parameters.neutral + np.rint(near), 0).astype(np.int32)
    cells = np.where(passable, FREE, OCCUPIED).astype(np.uint8)
    for shared in (clearance, costs):
        shared.setflags(write=False)
    return Ground(OccupancyGrid(cells, plan.resolution * factor, plan.origin), clearance, costs, reach)


def _coarse(fine: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """The least value of each block of factor × factor cells; beyond the north and east edges all is 0."""
    rows, columns = -(-fine.shape[0] // factor), -(-fine.shape[1] // factor)
    padded = np.zeros((rows * factor, columns * factor))
    padded[: fine.shape[0], : fine.shape[1]] = fine
    least: NDArray[np.float64] = padded.reshape(rows, factor, columns, factor).min(axis=(1, 3))
    return least


class Planner:
    """Finds ways on one ground; keeps the potentials of the last goals."""

    def __init__(self, ground: Ground, parameters: PlanningParameters = PlanningParameters()) -> None:
        self._ground = ground
        self._parameters = parameters
        self._region = np.zeros(ground.costs.shape, dtype=np.bool_)
        self._fields: OrderedDict[Cell, NDArray[np.int32]] = OrderedDict()

    def path(self, start: Point, goal: Point) -> NDArray[np.float64] | None:
        """The way from `start` to `goal`, or to the nearest point within the tolerance; None without one.

        (n, 2), n ≥ 1, m in the map frame: centres of neighbouring cells, but for the last point, which is
        the goal itself where the body has room there.
        """
        grid = self._ground.grid
        first = self._nearest(grid.free, start)
        if first is None:
            return None
        if not self._region[first]:
            self._region = flood.flood(grid.free, *first)
        last = self._nearest(self._region, goal)
        if last is None:
            return None
        field = self._field(last)
        assert field[first] != UNREACHABLE
        cells = descent(self._ground.costs, field, *first)
        x, y = grid.centres()
        way = np.column_stack((x[cells[:, 1]], y[cells[:, 0]]))
        if last == grid.cell(goal):
            way[-1] = goal
        return way

    def _nearest(self, admitted: NDArray[np.bool_], point: Point) -> Cell | None:
        """The admitted cell around `point`, or the nearest one within the tolerance."""
        grid = self._ground.grid
        here = grid.cell(point)
        if grid.contains(point) and admitted[here]:
            return here
        reach = self._parameters.tolerance
        cells = math.ceil(reach / grid.resolution) + 1
        bottom, left = max(here.row - cells, 0), max(here.column - cells, 0)
        window = admitted[bottom : max(here.row + cells + 1, 0), left : max(here.column + cells + 1, 0)]
        rows, columns = np.nonzero(window)
        if not rows.size:
            return None
        x, y = grid.centres()
        squared = (x[columns + left] - point.x) ** 2 + (y[rows + bottom] - point.y) ** 2
        best = int(np.argmin(squared))
        if squared[best] > reach**2:
            return None
        return Cell(int(rows[best]) + bottom, int(columns[best]) + left)

    def _field(self, goal: Cell) -> NDArray[np.int32]:
        """The potential of the goal, new or kept."""
        field = self._fields.get(goal)
        if field is None:
            field = potential(self._ground.costs, *goal)
            while len(self._fields) >= self._parameters.cached:
                self._fields.popitem(last=False)
            self._fields[goal] = field
        else:
            self._fields.move_to_end(goal)
        return field
