"""What the robots' range sensors report: planar scans of walls, other robots and obstacles."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.floor.raster import free_squares
from actors.messages import NO_ECHO_MM, RobotTruth
from actors.portable import arrays, hypot
from actors.portable.draws import normals_of_each
from actors.robot_model import RangeSensor, RobotModel, scan_angles
from actors.world.rays import BODY, SENSOR, in_millimetres, sweep


class RangeSensors:
    """The range sensors of all robots on one floor plan. A sensor does not see the body that carries it."""

    def __init__(
        self,
        grid: OccupancyGrid,
        models: Sequence[RobotModel],
        generators: Sequence[Generator],
        dropout: float = 0.0,
        dropouts: Sequence[Generator] = (),
    ) -> None:
        """`generators`: one per robot, for the noise of its ranges; `dropouts`: the same for the share
        `dropout` of its rays that give no echo, needed if that is not 0."""
        assert len(models) == len(generators)
        self.look_at(grid)
        self._generators = tuple(generators)
        self._dropout = dropout
        self._dropouts = tuple(dropouts)
        self._sensors, self._table = _sensors([model.sensor for model in models])
        noisy = (self._sensors["noise"] > 0) | (self._sensors["noise_growth"] > 0)
        self._draws: list[int] = np.where(noisy, self._sensors["rays"], 0).tolist()
        self._bodies, self._vertices = _bodies(models)

    def look_at(self, grid: OccupancyGrid) -> None:
        """From now on the floor plan is this one."""
        self._grid = grid
        self._squares = free_squares(grid.blocking)

    def scan(
        self, due: Sequence[int], poses: NDArray[np.float64], obstacles: NDArray[np.float64]
    ) -> list[NDArray[np.uint16]]:
        """A scan of each robot in `due`: (rays,) mm, 65535 = no echo.

        `poses`: (n, 3) of all robots; `obstacles`: (m, 3) x, y, radius; m, rad, map frame.
        """
        report, bounds = self._report(due, poses, obstacles)
        return [report[begin:end] for begin, end in pairwise(bounds)]

    def encoded(
        self, due: Sequence[int], poses: NDArray[np.float64], obstacles: NDArray[np.float64]
    ) -> list[bytes]:
        """The same as messages hold it: (rays,) little-endian uint16."""
        report, bounds = self._report(due, poses, obstacles)
        whole = report.astype("<u2", copy=False).tobytes()
        return [whole[2 * begin : 2 * end] for begin, end in pairwise(bounds)]

    def _report(
        self, due: Sequence[int], poses: NDArray[np.float64], obstacles: NDArray[np.float64]
    ) -> tuple[NDArray[np.uint16], list[int]]:
        """All scans, one after the other, and where each begins, and the last one ends."""
        robots = np.array(due, np.int64)
        rays = self._sensors["rays"][robots]
        ends = rays.cumsum()
        starts = ends - rays
        ranges = np.empty(int(ends[-1]) if ends.size else 0)
        floor = self._squares, self._grid.resolution, *self._grid.origin
        carriers = robots, poses, self._sensors, self._table, self._bodies, self._vertices
        sweep(*floor, *carriers, obstacles, starts, ranges)
        draws = normals_of_each([self._generators[i] for i in due], [self._draws[i] for i in due])
        report = np.empty(ranges.size, np.uint16)
        in_millimetres(ranges, draws, robots, self._sensors, starts, report)
        bounds = [*starts.tolist(), report.size]
        if self._dropout:
            for robot, (begin, end) in zip(due, pairwise(bounds), strict=True):
                report[begin:end][self._dropouts[robot].random(end - begin) < self._dropout] = NO_ECHO_MM
        return report, bounds


def _sensors(sensors: Sequence[RangeSensor]) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """(n,) of SENSOR, and the (m, 2) directions of the rays of each different one."""
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


def _bodies(models: Sequence[RobotModel]) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """(n,) of BODY, and the (v, 2) vertices of all polygons."""
    vertices: list[tuple[float, float]] = []
    rows = []
    for model in models:
        ring = model.footprint.vertices or ()
        rows.append((model.footprint.circumradius, len(vertices), len(ring)))
        vertices += ring
    return np.array(rows, BODY), np.array(vertices, np.float64).reshape(-1, 2)


ASTRAY: Final = 0.5
"""A robot farther than this from where it holds itself to be, m, is astray."""
LOST: Final = 1.0
"""A robot farther than this from where it holds itself to be, m, is lost."""


class PoseError(msgspec.Struct, frozen=True):
    """How far one robot's held positions lay from its true ones, over all steps in which it said any."""

    samples: int
    """Steps in which it said where it holds itself to be; 0: never, and the numbers below are all 0."""
    rmse: float
    """Root of the mean of the squared distances, m: the absolute trajectory error."""
    greatest: float
    """The greatest distance, m."""
    astray_share: float
    """Share of the samples with a distance above ASTRAY."""
    lost_share: float
    """Share of the samples with a distance above LOST."""
    times_lost: int
    """How often the distance rose above LOST."""
    lost_at_end: bool
    """Whether the last distance lies above LOST."""


class WorldReport(msgspec.Struct, frozen=True):
    """Ground truth of a run: part of the last record of its world, beside what the task reports."""

    contacts: int
    pose_errors: dict[str, PoseError]
    driven: dict[str, float]
    """Distance that each robot truly covered, or was pushed, m."""
    steps: int
    refused_orders: tuple[str, ...]
    """Orders from outside that made no sense, a sentence each."""


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
