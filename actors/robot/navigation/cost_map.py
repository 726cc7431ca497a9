"""Local cost map: obstacles around the robot, in a rolling window of the odometry frame.

As costmap_2d with an obstacle layer and an inflation layer (ros-planning/navigation). Cells are aligned to
multiples of their side, so that rolling moves whole cells and marks keep their positions.
"""

import math
from types import MappingProxyType
from typing import Any, Final, Literal

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from actors.array_types import Floats, Int16s, Int64s, Octets
from actors.floor.grid import Cell
from actors.geometry import Pose
from actors.instant import Duration, Instant, in_seconds, seconds
from actors.portable import arrays
from actors.robot.navigation.ray_tracing import (
    Rays,
    check_reach,
    inscribed,
    mark_and_clear,
    outline,
    squared_within,
    stamp_free_cells,
    stamp_new_marks,
)
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor
from actors.settings import Interval, NotNegative, Positive, Settings
from deeco.knowledge import new_tuple

LETHAL: Final = 254
"""Cost of a cell with an obstacle."""
INSCRIBED: Final = 253
"""Cost of a cell in which the robot's centre implies a collision."""


class Inflation(msgspec.Struct, frozen=True):
    """Cost as a function of the distance to the nearest lethal cell."""

    inscribed: float
    """Distance up to which the body collides, m."""
    radius: float
    """Distance from which the cost is 0, m."""
    scaling: float
    """Decay rate of the cost between the two, 1/m (cost_scaling_factor)."""

    def costs(self, distance: ArrayLike) -> Octets:
        """Return the cost at each distance, m: LETHAL at 0, INSCRIBED, then from 252 to 0; same shape."""
        away = np.asarray(distance, dtype=np.float64)
        beyond = np.maximum(away - self.inscribed, 0.0)
        falling = np.floor((INSCRIBED - 1) * arrays.exp(-self.scaling * beyond))
        costs = np.where(away > self.radius, 0.0, falling)
        costs = np.where(away <= self.inscribed, INSCRIBED, costs)
        return np.where(away <= 0.0, LETHAL, costs).astype(np.uint8)

    def reach(self, cell: float) -> int:
        """Return the distance in cells of side `cell`, m, beyond which the cost is 0."""
        return math.ceil(max(self.radius, self.inscribed) / cell - 1e-9)

    def table(self, cell: float) -> Octets:
        """Return the cost by squared distance in cells of side `cell`, m: ((reach + 1)² + 1,), read-only.

        The last cost is 0. Distances are between the centres of cells.
        """
        reach = self.reach(cell) + 1
        table = self.costs(cell * np.sqrt(np.arange(reach * reach + 1)))
        table[-1] = 0
        table.setflags(write=False)
        return table


def fingerprint() -> bytes:
    """Return costs for fixed inputs; another processor or library may give others."""
    return (
        Inflation(0.227, 0.75, 15.0).table(0.05).tobytes() + Inflation(0.2, 0.5, 10.0).table(0.05).tobytes()
    )


_NEVER: Final = np.iinfo(np.int64).min


class CostMapParameters(Settings, frozen=True):
    """Local cost map; values from d3scomp/ROSRemote, simulation/params, unless stated."""

    size: Positive = 4.0
    """Side of the window, m."""
    cell: Positive = 0.05
    """Side of a cell, m."""
    obstacle_range: NotNegative = 2.5
    """Maximum range of marking, m."""
    raytrace_range: NotNegative = 3.0
    """Maximum range of clearing, m."""
    inf_is_valid: bool = False
    """Clear cells by rays without echo; off by default in costmap_2d. Clears from twice the sensor's shortest
    range, since nearer obstacles cause no echo."""
    inflation_radius: NotNegative = 0.75
    """Distance at which the cost of marks ends, m."""
    scaling: NotNegative = 15.0
    """Decay rate of the cost, 1/m (cost_scaling_factor)."""
    body: Literal["polygon", "disc"] = "polygon"
    """Footprint: a "polygon" of 16 corners, as costmap_2d makes from a radius, or a "disc"."""
    allowance: NotNegative = 0.003
    """Added to the body's radius, m: the files have robot_radius 0.18 for a body of 0.177."""
    padding: NotNegative = 0.01
    """Added to the polygon's coordinates, m (costmap_2d footprint_padding), or to the disc's radius. The
    centre keeps the inscribed radius of the polygon, or that of the padded disc, from centres of marked
    cells."""
    free_memory: Interval = Duration(0)
    """Time for which a cell counts as observed free after a ray passed through it; 0 = never."""
    free_range: NotNegative = 1.0
    """Maximum range of observing free cells, m."""
    moving_memory: Interval = Duration(0)
    """Time for which a mark counts as moving if its cell was observed free before (needs `free_memory`); 0 =
    none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.moving_memory and not self.free_memory:
            raise self.wrong("free_memory", "above 0 where local_map.moving_memory is")
        if not 4 <= self.size / self.cell <= 400:
            raise self.wrong("size", f"4 to 400 cells of {self.cell:g} m")
        if self.inflation_radius > 100 * self.cell:
            raise self.wrong("inflation_radius", f"at most 100 cells of {self.cell:g} m")


_DISC: Final = CostMapParameters(body="disc", allowance=0.0, padding=0.045, inf_is_valid=True)
LOCAL_MAP_PRESETS: Final = MappingProxyType(
    {
        "chapter": CostMapParameters(),
        "robust": replace(_DISC, free_memory=seconds(3), moving_memory=seconds(1)),
    }
)
"""`robust`: own choices. The padding is costmap_2d's 0.01 plus half a cell's diagonal, since an obstacle may
be in a corner of its cell."""


def room_needed(radius: float, parameters: CostMapParameters) -> float:
    """Return the clearance, m, at which a body of `radius`, m, is free of marks at any angle.

    A wall marks whole cells. The corners of cells (for a polygon) are nearer than the wall by at most a
    cell's diagonal, their centres (for a disc) by half of it.
    """
    outer, diagonal = radius + parameters.allowance, parameters.cell * math.sqrt(2.0)
    if parameters.body == "disc":
        return outer + parameters.padding + diagonal / 2
    return float(arrays.hypot(*outline(outer, parameters.padding).T).max()) + diagonal


class CostMap:
    """Local cost map of one robot; empty until the first scan."""

    def __init__(
        self, sensor: RangeSensor, radius: float, parameters: CostMapParameters = LOCAL_MAP_PRESETS["chapter"]
    ) -> None:
        """Create an empty map; `radius`: of the body, m."""
        p = self.parameters = parameters
        outer = radius + p.allowance
        self.outline: Final = outline(outer, p.padding)
        """(16, 2): corners of the footprint, m, body's frame."""
        within = inscribed(outer, p.padding) if p.body == "polygon" else outer + p.padding
        self.inflation: Final = Inflation(within, p.inflation_radius, p.scaling)
        check_reach("local_map: the radius of the body with its padding", self.inflation.inscribed, p.cell)
        self.table: Final = self.inflation.table(p.cell)
        """Cost by squared distance in cells."""
        self._radius = radius
        self._room = within if p.body == "disc" else radius
        self._seen, self._body = np.zeros(3), np.array([0.0, 0.0, radius / p.cell])
        """Sensor's position, cells from the corner, and heading at the scan; body's position and radius,
        cells."""
        self._mount = sensor.mount
        angles = sensor.first_angle + sensor.increment * np.arange(sensor.rays)
        directions = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
        silent = 2.0 * sensor.range_min if p.inf_is_valid else math.inf
        limits = np.array([1e-3, p.obstacle_range, p.raytrace_range, silent]) / p.cell
        self._rays = Rays(directions, np.array([sensor.first_angle, sensor.increment]), limits)
        remembered = np.minimum(limits, [math.inf, math.inf, p.free_range / p.cell, math.inf])
        self._stamped = self._rays._replace(limits=remembered)
        self._half = round(p.size / p.cell / 2)
        side = 2 * self._half
        self._marks: Octets = np.zeros((side, side), np.uint8)
        self._stamps: Int64s = np.full((side, side) if p.free_memory else (0, 0), _NEVER, np.int64)
        self.arrivals: Int64s = np.full((side, side) if p.moving_memory else (0, 0), _NEVER, np.int64)
        """Time at which a cell observed free was last marked; empty if `moving_memory` is 0."""
        self._squared: Int16s | None = None
        self._taken: Instant | None = None
        self.corner = Cell(-self._half, -self._half)
        """Row and column of the window's south-west cell, relative to the odometry frame's origin."""

    @property
    def side(self) -> int:
        """Number of rows and columns of the window."""
        return len(self._marks)

    @property
    def squared(self) -> Int16s:
        """Squared distance from each cell to the nearest mark, cells²: (rows, columns), capped."""
        if self._squared is None:
            self._squared = squared_within(self._marks, self.inflation.reach(self.parameters.cell))
        return self._squared

    def take(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Roll to `here`, the body's pose in the odometry frame, and process a scan if there is one."""
        self._roll(here)
        if sweep is None:
            return
        ranges = sweep.ranges_mm
        mount = sweep.pose.compose(self._mount)
        cell, corner, seen, body = self.parameters.cell, self.corner, self._seen, self._body
        seen[0], seen[1], seen[2] = mount.x / cell - corner.column, mount.y / cell - corner.row, mount.heading
        body[0], body[1] = here.x / cell - corner.column, here.y / cell - corner.row
        before = self._marks.copy() if self.arrivals.size else self._marks
        mark_and_clear(self._marks, ranges, self._rays, seen, body)
        if self.arrivals.size:
            oldest = instant - self.parameters.free_memory
            stamp_new_marks(self.arrivals, instant, self._marks, before, self._stamps, oldest)
        if self._stamps.size:
            stamp_free_cells(self._stamps, instant, ranges, self._stamped, seen, body)
        self._squared = None
        self._taken = instant

    def restore(self, instant: Instant, corner: Cell, marks: Octets) -> None:
        """Restore recorded marks, (rows, columns), 0 or 1, of a window with that corner at `instant`."""
        self.corner, self._marks, self._squared, self._taken = corner, marks, None, instant

    def age(self, instant: Instant) -> float:
        """Return the time since the last scan, s; inf before the first."""
        return math.inf if self._taken is None else in_seconds(Duration(instant - self._taken))

    def clear(self, beyond: float) -> None:
        """Clear marks outside of the square of side `beyond`, m, around the robot.

        As clear_costmap_recovery of ros-planning/navigation with that reset_distance.
        """
        reach = min(round(beyond / 2 / self.parameters.cell), self._half)
        inner = slice(self._half - reach, self._half + reach)
        kept = self._marks[inner, inner].copy()
        self._marks[:] = 0
        self._marks[inner, inner] = kept
        self._squared = None

    def marked(self) -> Int64s:
        """Return the indices of marked cells, row by row from the south: (k,)."""
        return np.flatnonzero(self._marks.view(np.bool_))

    def marks(self) -> Floats:
        """Return the centres of marked cells: (k, 2), m, odometry frame, south to north, west to east."""
        rows, columns = np.nonzero(self._marks)
        cell = self.parameters.cell
        return np.column_stack(
            ((columns + (self.corner.column + 0.5)) * cell, (rows + (self.corner.row + 0.5)) * cell)
        )

    def free_behind(self, here: Pose, distance: float, *, touching: bool = False) -> bool:
        """Return True if the body at `here` can back off straight by `distance`, m, according to the map.

        The centre keeps the local planner's distance from marks, or its current distance if that is less.
        `touching`: marks may be within the body's radius now.
        """
        marks, cell = self.marks(), self.parameters.cell
        least = math.inf
        for step in range(math.ceil(distance / cell) + 1):
            back = here.compose(Pose(-min(step * cell, distance), 0.0, 0.0))
            x, y = self._cells(back.x, back.y)
            if not (0 <= x < len(self._marks) and 0 <= y < len(self._marks)):
                return False
            squared = np.square(marks[:, 0] - back.x) + np.square(marks[:, 1] - back.y)
            near = math.sqrt(squared.min(initial=math.inf))
            if step == 0:
                least = min(self._room, near) if touching or near >= self._radius else math.inf
            if near < least:
                return False
        return True

    def costs(self) -> Octets:
        """Return the cost of each cell: (rows, columns), row 0 the southernmost."""
        return self.table[self.squared]

    def trusted(self, instant: Instant) -> Octets:
        """Return 1 in each cell observed free or below the body within `free_memory`: (rows, columns)."""
        if not self._stamps.size:
            return np.zeros_like(self._marks)
        return (self._stamps >= instant - self.parameters.free_memory).astype(np.uint8)

    def _cells(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the odometry frame, m, in cells from the window's corner."""
        cell = self.parameters.cell
        return x / cell - self.corner.column, y / cell - self.corner.row

    def _roll(self, here: Pose) -> None:
        """Centre the window on the robot."""
        cell = self.parameters.cell
        row, column = math.floor(here.y / cell) - self._half, math.floor(here.x / cell) - self._half
        up, right = row - self.corner.row, column - self.corner.column
        if up or right:
            self.corner = new_tuple(Cell, (row, column))
            self._marks = _moved_window(self._marks, up, right, 0)
            if self._stamps.size:
                self._stamps = _moved_window(self._stamps, up, right, _NEVER)
            if self.arrivals.size:
                self.arrivals = _moved_window(self.arrivals, up, right, _NEVER)
            self._squared = None


def _moved_window(cells: NDArray[Any], up: int, right: int, empty: int) -> NDArray[Any]:
    """Return the cells of a window moved by `up` rows and `right` columns; `empty` in new cells."""
    side = cells.shape[0]
    rolled = np.empty(cells.shape, cells.dtype)
    rolled[:] = empty
    bottom, below = (up, 0) if up > 0 else (0, -up)
    left, beside = (right, 0) if right > 0 else (0, -right)
    height, width = side - bottom - below, side - left - beside
    if height > 0 and width > 0:
        rolled[below : below + height, beside : beside + width] = cells[
            bottom : bottom + height, left : left + width
        ]
    return rolled
