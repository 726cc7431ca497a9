"""Floors, sensors and drives for tests of localisation: ground truth, odometry and scans."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, Cell, OccupancyGrid, largest_region
from actors.floor.map_file import load_map
from actors.geometry import ORIGIN, Point, Pose, wrap
from actors.messages import NO_ECHO_MM
from actors.robot.localisation import Amcl, AmclParameters, LikelihoodField, likelihood_field, measurement
from actors.robot.navigation.planning import GridPlanner, PlanningGrid, planning_grid
from actors.robot.sweep import Sweep
from actors.robot_model import load_model
from actors.world.sensing import RangeSensors

TURTLEBOT: Final = load_model("turtlebot2", "chapter")
CAMERA: Final = load_model("turtlebot2", "kinect")
APARTMENT: Final = load_map(Path(__file__).parents[2] / "maps" / "apartment.yaml")
_MARGIN: Final = 1.0
"""Margin of unknown cells around the room, m, as on maps made by robots."""
BEAMS: Final = measurement.beams(TURTLEBOT.sensor, 60)
STEP: Final = 0.1
"""Time between scans, s."""


def room(walls: Sequence[tuple[float, float, float, float]] = (), size: float = 8.0) -> OccupancyGrid:
    """Return a square room of cells of 5 cm with walls x0, y0, x1, y1, m, surrounded by unknown cells."""
    cells = np.full((round(size / 0.05),) * 2, FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for x0, y0, x1, y1 in walls:
        cells[round(y0 / 0.05) : round(y1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = OCCUPIED
    margin = round(_MARGIN / 0.05)
    return OccupancyGrid(np.pad(cells, margin, constant_values=UNKNOWN), 0.05, Point(-_MARGIN, -_MARGIN))


ROOM: Final = room(((2.0, 0.0, 2.3, 3.0), (5.0, 5.0, 8.0, 5.2), (4.0, 2.5, 4.5, 3.0)))
"""8 m by 8 m, with three walls that make all places distinguishable."""
FIELD: Final = likelihood_field(ROOM, 2.0)
NO_OBSTACLES: Final = np.empty((0, 3))
APART: Final = 6.0
"""Distance between the centres of the equal rooms, m."""


def twins(shorter: float = 0.0) -> OccupancyGrid:
    """Return two rooms of 6 m by 6 m, west and east, without a door, symmetric under rotation by π.

    `shorter`: the eastern room ends so much sooner, m, at its south; what is behind is not known.
    """
    edge = round(_MARGIN / 0.05)
    west = room(((1.5, 0.0, 1.7, 2.0), (4.0, 2.5, 6.0, 2.7)), 6.0).cells[edge:-edge, edge:-edge]
    east = west[::-1, ::-1].copy()
    if shorter > 0:
        south = round(shorter / 0.05)
        east[:south], east[south] = UNKNOWN, OCCUPIED
    both = np.pad(np.hstack((west, east)), edge, constant_values=UNKNOWN)
    return OccupancyGrid(both, 0.05, Point(-_MARGIN, -_MARGIN))


def twin_of(pose: Pose) -> Pose:
    return Pose(2 * APART - pose.x, APART - pose.y, wrap(pose.heading + math.pi))


@cache
def ground_of(plan: OccupancyGrid) -> PlanningGrid:
    return planning_grid(plan, TURTLEBOT.footprint.circumradius)


def place(plan: OccupancyGrid, rng: np.random.Generator) -> Point:
    floor = ground_of(plan).grid
    row, column = np.argwhere(largest_region(floor))[rng.integers(largest_region(floor).sum())].tolist()
    return floor.centre(Cell(row, column))


@dataclass
class Drive:
    """A drive of a robot with exact odometry."""

    plan: OccupancyGrid
    start: Pose
    seed: int = 0
    others: Sequence[tuple[float, float, float]] = ()
    """Discs on the floor: x, y, radius, m."""

    def sweeps(self, seconds: float) -> Iterator[tuple[Pose, Sweep]]:
        """Return the true pose and the scan there, with the odometry pose."""
        sensors = RangeSensors(self.plan, [TURTLEBOT], [np.random.default_rng(self.seed)])
        obstacles = np.array(self.others, np.float64).reshape(-1, 3)
        poses = self._poses()
        for _ in range(round(seconds / STEP)):
            pose = next(poses)
            ranges = sensors.scan([0], np.array([pose]), obstacles)[0]
            yield pose, Sweep(frozen(ranges), self.start.relative(pose))

    def _poses(self) -> Iterator[Pose]:
        """Return one pose per scan: 0.5 m/s forward, or 1 rad/s on the spot."""
        rng, planner = np.random.default_rng([self.seed, 1]), GridPlanner(ground_of(self.plan))
        pose = self.start
        while True:
            path = planner.path(pose.point, place(self.plan, rng))
            for x, y in () if path is None else path.tolist():
                while pose.point.distance_to(Point(x, y)) > 0.2:
                    yield pose
                    turn = wrap(math.atan2(y - pose.y, x - pose.x) - pose.heading)
                    ahead = 0.5 * STEP if abs(turn) < 0.5 else 0.0
                    pose = pose.compose(Pose(ahead, 0.0, max(-STEP, min(STEP, turn))))


def scan(plan: OccupancyGrid, pose: Pose, others: Floats = NO_OBSTACLES) -> NDArray[np.uint16]:
    sensors = RangeSensors(plan, [TURTLEBOT], [np.random.default_rng(0)])
    return frozen(sensors.scan([0], np.array([pose]), others)[0])


def frozen(ranges: NDArray[np.uint16]) -> NDArray[np.uint16]:
    return np.frombuffer(ranges.astype("<u2").tobytes(), "<u2")


def blind() -> NDArray[np.uint16]:
    return frozen(np.full(TURTLEBOT.sensor.rays, NO_ECHO_MM, np.uint16))


def counted(track: Iterable[tuple[Pose, Sweep]]) -> Iterator[tuple[Pose, Sweep]]:
    """Return the scans that a filter uses: after each 0.25 m or 0.2 rad."""
    last: Pose | None = None
    for truth, sweep in track:
        made = Pose(math.inf, 0.0, 0.0) if last is None else last.relative(sweep.pose)
        if math.hypot(made.x, made.y) >= 0.25 or abs(made.heading) >= 0.2:
            last = sweep.pose
            yield truth, sweep


def anywhere(*seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    point = place(APARTMENT, rng)
    return Pose(point.x, point.y, rng.uniform(-math.pi, math.pi))


@cache
def apartment() -> LikelihoodField:
    return likelihood_field(APARTMENT, 2.0)


def ends(ranges: NDArray[np.uint16]) -> Floats:
    """Return the end points of a scan's beams: (b, 2), m, body's frame."""
    return measurement.end_points(ranges, BEAMS, ORIGIN, np.empty((0, 2)), 0.0).points


def amcl(
    parameters: AmclParameters,
    start: Pose | None,
    field: LikelihoodField = FIELD,
    seed: int = 0,
    origin: Pose = ORIGIN,
) -> Amcl:
    generator = np.random.default_rng(seed)
    return Amcl(field, TURTLEBOT.sensor, start, generator, parameters, origin=origin)


def error(pose: Pose, truth: Pose) -> float:
    return Point(pose.x, pose.y).distance_to(truth.point)
