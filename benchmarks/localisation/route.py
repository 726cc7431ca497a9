"""How the robot truly drives: from one random point to the next, within its drive's limits, off all walls."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid, largest_region
from actors.floor.map_file import load_map
from actors.geometry import Point, Pose, wrap
from actors.robot.navigation.planning import Planner, ground
from actors.robot_model import DriveParameters, RobotModel, load_model
from actors.runtime.errors import AcrcError

GOAL_CLEARANCE: Final = 0.3
"""Goals and starts are at least so far from walls, m."""


@dataclass(frozen=True, eq=False)
class Site:
    """A floor plan as a driver of one robot model needs it."""

    grid: OccupancyGrid
    model: RobotModel

    @cached_property
    def planner(self) -> Planner:
        """Finds ways for the model's body."""
        return Planner(ground(self.grid, self.model.footprint.circumradius))

    @cached_property
    def _cells(self) -> NDArray[np.intp]:
        """(n, 2) row and column of the cells where goals may lie."""
        region = largest_region(self.grid, self.model.footprint.circumradius + 0.05)
        return np.argwhere(region & (self.grid.clearance >= GOAL_CLEARANCE))

    def point(self, generator: Generator) -> Point:
        """A point that the robot gets to, uniform over the cells with GOAL_CLEARANCE. Takes three numbers."""
        which, east, north = generator.random(3).tolist()
        row, column = self._cells[int(which * len(self._cells))].tolist()
        x, y = self.grid.origin
        return Point(x + (column + east) * self.grid.resolution, y + (row + north) * self.grid.resolution)


@lru_cache(maxsize=8)
def site(plan: str, sensor: str) -> Site:
    """That map file with a TurtleBot 2 with that sensor, made once per process. Raises MapError."""
    return Site(load_map(plan), load_model("turtlebot2", sensor))


SUBSTEP: Final = 0.01
"""Of the motion, s; the odometry's."""
CONTROLS: Final = 10
"""Sub-steps from one decision of the follower to the next, and from one scan to the next."""


class CourseError(AcrcError):
    """A course that cannot be driven or used."""


@dataclass(frozen=True)
class FollowerParameters:
    """Pure pursuit (Coulter, CMU-RI-TR-92-01) on the true pose; all own choices for smooth driving."""

    speed: float = 0.5
    """The highest, m/s."""
    turn_rate: float = 1.2
    """The highest, rad/s."""
    braking: float = 0.5
    """Deceleration planned with before a goal, m/s²."""
    turning: float = 2.0
    """Turn rate per angle when turning on the spot, 1/s."""
    spot: float = 1.0
    """Beyond this angle to the way ahead the robot turns on the spot, rad."""
    pursued: tuple[float, ...] = (0.45, 0.3, 0.2, 0.1)
    """How far ahead the point aimed at lies, m: the first to which the straight line is free."""
    arrived: float = 0.05
    """So near a goal the next one is drawn, m."""


class WanderingRoute:
    """One robot on its way; the same generator gives the same route."""

    def __init__(
        self,
        site: Site,
        start: Pose,
        generator: Generator,
        parameters: FollowerParameters = FollowerParameters(),
    ) -> None:
        self._site = site
        self._generator = generator
        self._parameters = parameters
        self._radius = site.model.footprint.circumradius
        self._pose, self._speed, self._turn = start, 0.0, 0.0
        self._way: NDArray[np.float64] = np.empty((0, 2))
        self._passed = 0

    def advance(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """One decision and its sub-steps: (CONTROLS, 3) poses after each, and (3,) the velocity at the end.

        m, rad, m/s, rad/s, map frame. Raises CourseError should the body ever touch a wall.
        """
        speed, turn = self._decision()
        track = np.array([self._moved(speed, turn) for _ in range(CONTROLS)])
        here = self._pose.point
        if self._site.grid.clearance_at(here, self._radius) < self._radius:
            raise CourseError(f"the route touches a wall at ({here.x:.2f}, {here.y:.2f}); it should never")
        heading = self._pose.heading
        east, north = self._speed * math.cos(heading), self._speed * math.sin(heading)
        return track, np.array([east, north, self._turn])

    def carry(self, pose: Pose) -> None:
        """Put the robot elsewhere, standing and without a goal."""
        self._pose, self._speed, self._turn = pose, 0.0, 0.0
        self._way, self._passed = np.empty((0, 2)), 0

    def _moved(self, speed: float, turn: float) -> Pose:
        drive: DriveParameters = self._site.model.drive
        change, twist = drive.acceleration * SUBSTEP, drive.turn_acceleration * SUBSTEP
        self._speed += min(max(speed - self._speed, -change), change)
        self._turn += min(max(turn - self._turn, -twist), twist)
        x, y, heading = self._pose
        middle = heading + self._turn * SUBSTEP / 2
        way = self._speed * SUBSTEP
        self._pose = Pose(
            x + way * math.cos(middle), y + way * math.sin(middle), wrap(heading + self._turn * SUBSTEP)
        )
        return self._pose

    def _decision(self) -> tuple[float, float]:
        """The speed and turn rate wished for."""
        told = self._parameters
        remaining = self._remaining()
        while remaining < told.arrived:
            self._set_out()
            remaining = self._remaining()
        aim = self._aim()
        ahead = self._pose.relative(Pose(*aim, 0.0))
        angle, apart = math.atan2(ahead.y, ahead.x), max(math.hypot(ahead.x, ahead.y), 1e-6)
        if abs(angle) > told.spot:
            return 0.0, _limited(told.turning * angle, told.turn_rate)
        curvature = 2 * math.sin(angle) / apart
        speed = min(
            told.speed, math.sqrt(2 * told.braking * remaining), told.turn_rate / max(abs(curvature), 1e-6)
        )
        return speed, speed * curvature

    def _set_out(self) -> None:
        """Draw goals until one can be gone to that is not right here."""
        for _ in range(100):
            way = self._site.planner.path(self._pose.point, self._site.point(self._generator))
            if way is not None and math.dist(way[-1], self._pose[:2]) > 1.0:
                self._way, self._passed = way, 0
                return
        raise CourseError(f"no way leads on from ({self._pose.x:.2f}, {self._pose.y:.2f}) on this map")

    def _remaining(self) -> float:
        """How far the end of the way is, m; also moves on to the point of the way that is nearest."""
        if not len(self._way):
            return 0.0
        near = self._way[self._passed : self._passed + 12]
        self._passed += int(np.argmin(np.hypot(near[:, 0] - self._pose.x, near[:, 1] - self._pose.y)))
        if self._passed < len(self._way) - 20:
            return math.inf
        rest = self._way[self._passed :]
        along = float(np.hypot(*np.diff(rest, axis=0).T).sum())
        return (
            along + math.dist(rest[0], self._pose[:2])
            if len(rest) > 1
            else math.dist(rest[0], self._pose[:2])
        )

    def _aim(self) -> Point:
        """The point of the way to drive at."""
        rest = self._way[self._passed :]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
        for ahead in self._parameters.pursued:
            aim = Point(*rest[min(int(np.searchsorted(along, ahead)), len(rest) - 1)].tolist())
            if self._is_clear(aim):
                return aim
        return aim

    def _is_clear(self, aim: Point) -> bool:
        """True if the body can go straight to that point."""
        grid, here = self._site.grid, self._pose
        count = max(2, math.ceil(here.point.distance_to(aim) / grid.resolution))
        shares = np.linspace(0, 1, count)
        columns = ((here.x + shares * (aim.x - here.x) - grid.origin.x) / grid.resolution).astype(np.intp)
        rows = ((here.y + shares * (aim.y - here.y) - grid.origin.y) / grid.resolution).astype(np.intp)
        return bool(grid.clearance[rows, columns].min() >= self._radius + grid.resolution)


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)
