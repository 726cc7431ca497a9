"""Range sensors of the robots, and statistics of their pose errors."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Floats, Records, UInt16s
from actors.floor.grid import OccupancyGrid
from actors.floor.raster import free_squares
from actors.messages import NO_ECHO_MM, RobotTruth
from actors.portable import arrays, hypot
from actors.portable.draws import normals_of_each
from actors.robot_model import RangeSensor, RobotModel, scan_angles
from actors.world.battery import EnergyReport
from actors.world.rays import BODY, SENSOR, report_ranges, sweep, wall_faces


class RangeSensors:
    """Range sensors of all robots on one floor plan; a sensor does not detect its own body."""

    def __init__(
        self,
        grid: OccupancyGrid,
        models: Sequence[RobotModel],
        generators: Sequence[Generator],
        dropout: float = 0.0,
        dropouts: Sequence[Generator] = (),
    ) -> None:
        """Create the sensors.

        `generators`: one per robot, for the noise of its ranges; `dropouts`: one per robot, for the share
        `dropout` of rays without echo, required if that is not 0.
        """
        assert len(models) == len(generators)
        self.set_floor(grid)
        self._generators = tuple(generators)
        self._dropout = dropout
        self._dropouts = tuple(dropouts)
        self._sensors, self._table = _sensors([model.sensor for model in models])
        noisy = (self._sensors["noise"] > 0) | (self._sensors["noise_growth"] > 0)
        self._draws: list[int] = np.where(noisy, self._sensors["rays"], 0).tolist()
        self._bodies, self._vertices = _bodies(models)

    def set_floor(self, grid: OccupancyGrid) -> None:
        """Replace the floor plan."""
        self._grid = grid
        self._squares = free_squares(grid.blocking)
        self._faces = wall_faces(self._squares)

    def scan(self, due: Sequence[int], poses: Floats, obstacles: Floats) -> list[UInt16s]:
        """Return a scan of each robot in `due`: (rays,) mm, 65535 = no echo.

        `poses`: (n, 3) of all robots; `obstacles`: (m, 3) x, y, radius; m, rad, map frame.
        """
        robots = np.array(due, np.int64)
        rays = self._sensors["rays"][robots]
        ends = rays.cumsum()
        starts = ends - rays
        ranges = np.empty(int(ends[-1]) if ends.size else 0)
        plan = self._grid
        sweep(
            self._squares, *self._faces, plan.resolution, *plan.origin, robots, poses, self._sensors,
            self._table, self._bodies, self._vertices, obstacles, starts, ranges,
        )  # fmt: skip
        draws = normals_of_each([self._generators[i] for i in due], [self._draws[i] for i in due])
        report = np.empty(ranges.size, np.uint16)
        report_ranges(ranges, draws, robots, self._sensors, starts, report)
        bounds = [*starts.tolist(), report.size]
        if self._dropout:
            for robot, (begin, end) in zip(due, pairwise(bounds), strict=True):
                report[begin:end][self._dropouts[robot].random(end - begin) < self._dropout] = NO_ECHO_MM
        return [report[begin:end] for begin, end in pairwise(bounds)]


def _sensors(sensors: Sequence[RangeSensor]) -> tuple[Records, Floats]:
    """Return (n,) of SENSOR, and the (m, 2) ray directions of all distinct sensors."""
    different = list(dict.fromkeys(sensors))
    angles = [scan_angles(sensor) for sensor in different]
    begins = np.cumsum([0, *map(len, angles)])
    first_ray = dict(zip(different, begins.tolist(), strict=False))
    rows = []
    for one in sensors:
        rays = one.first_angle, one.increment, one.rays, first_ray[one]
        rows.append((*one.mount, *rays, one.range_min, one.range_max, one.noise, one.noise_growth))
    all_angles = np.concatenate([*angles, np.empty(0)])
    table = np.stack([arrays.cos(all_angles), arrays.sin(all_angles)], axis=1)
    return np.array(rows, SENSOR), table


def _bodies(models: Sequence[RobotModel]) -> tuple[Records, Floats]:
    """Return (n,) of BODY, and the (v, 2) vertices of all polygons."""
    vertices: list[tuple[float, float]] = []
    rows = []
    for model in models:
        ring = model.footprint.vertices or ()
        rows.append((model.footprint.circumradius, len(vertices), len(ring)))
        vertices += ring
    return np.array(rows, BODY), np.array(vertices, np.float64).reshape(-1, 2)


ASTRAY: Final = 0.5
"""Localisation error above which a robot counts as astray, m."""
LOST: Final = 1.0
"""Localisation error above which a robot is lost, m."""


class PoseError(msgspec.Struct, frozen=True):
    """Statistics of one robot's localisation error over all steps with an estimate."""

    samples: int
    """Number of steps with an estimate; if 0, all other values are 0."""
    rmse: float
    """Root mean square of the error, m: the absolute trajectory error."""
    greatest: float
    """Greatest error, m."""
    astray_share: float
    """Share of samples above ASTRAY."""
    lost_share: float
    """Share of samples above LOST."""
    times_lost: int
    """Number of times that the error rose above LOST."""
    lost_at_end: bool
    """True if the last error is above LOST."""


class WorldReport(msgspec.Struct, frozen=True):
    """Ground truth of a run; part of the last record of the world, with the task's outcome."""

    contacts: int
    pose_errors: dict[str, PoseError]
    driven: dict[str, float]
    """Distance that each robot truly covered, driven or pushed, m."""
    steps: int
    refused_orders: tuple[str, ...]
    """Messages of refused orders from outside."""
    energy: dict[str, EnergyReport] = {}
    """Energy of each robot whose battery is simulated."""
    people_contacts: int | msgspec.UnsetType = msgspec.UNSET
    """Contacts between robots and people; absent without people."""
    people_contact_s: float | msgspec.UnsetType = msgspec.UNSET
    """Total duration of these contacts, s."""


class PoseErrorSum:
    """Accumulates the pose error of one robot."""

    def __init__(self) -> None:
        self._samples = self._astray = self._lost = self._times_lost = 0
        self._squares = self._greatest = 0.0
        self._is_lost = False

    def add(self, estimate: tuple[float, float, float], true: RobotTruth) -> None:
        """Compare an estimated pose at a step's start with the true one."""
        distance = hypot(estimate[0] - true.x, estimate[1] - true.y)
        is_lost = distance > LOST
        self._samples += 1
        self._squares += distance * distance
        self._greatest = max(self._greatest, distance)
        self._astray += distance > ASTRAY
        self._lost += is_lost
        self._times_lost += is_lost and not self._is_lost
        self._is_lost = is_lost

    def error(self) -> PoseError:
        """Return the error over all samples so far."""
        share = 1 / self._samples if self._samples else 0.0
        return PoseError(
            samples=self._samples,
            rmse=math.sqrt(self._squares * share),
            greatest=self._greatest,
            astray_share=self._astray * share,
            lost_share=self._lost * share,
            times_lost=self._times_lost,
            lost_at_end=self._is_lost,
        )
