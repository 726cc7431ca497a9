"""Closed-loop drives by the dynamic window approach on drawn floors; robots see each other as discs."""

import math
from dataclasses import dataclass, field

import numpy as np

from actors.array_types import Flags
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import STILL, Point, Pose, Twist
from actors.messages import Drive
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS, CostMap, CostMapParameters
from actors.robot.navigation.disc_local_planner import DiscLocalPlanner
from actors.robot.navigation.local_planner import DwaLocalPlanner
from actors.robot.navigation.planning import GridPlanner, planning_grid
from actors.robot.navigation.steering import DWA_PRESETS, BaseLocalPlanner, DwaParameters, Steering
from actors.robot.sweep import OdometryBuffer
from actors.robot_model import DriveParameters
from tests.robot.base import FakeBase, at_step, model

RADIUS = 0.177
KIND = model(rays=240)
DWA = {**DWA_PRESETS, "disc": DwaParameters(rules="disc", granularity=0.05)}
LOCAL_MAPS = {
    **LOCAL_MAP_PRESETS,
    "disc": CostMapParameters(body="disc", allowance=0.0, padding=0.045, inf_is_valid=True),
}
"""The presets, and "disc": own rules with the chapter's values."""
DISC = DWA["disc"]
ROBUST = DWA_PRESETS["robust"]


def hall(length: float, width: float) -> Flags:
    """Return walls around a hall of that size, m, in cells of 0.04 m."""
    walls = np.ones((round(width / CELL) + 8, round(length / CELL) + 8), np.bool_)
    walls[4:-4, 4:-4] = False
    return walls


def floor(walls: Flags) -> OccupancyGrid:
    """Return the floor plan with these walls; the hall's corner is at (0.16, 0.16)."""
    return OccupancyGrid(np.where(walls, OCCUPIED, FREE).astype(np.uint8), CELL)


def neck(width: float) -> OccupancyGrid:
    """Return two rooms of 3 m by 3.2 m, joined by a passage of 2 m: x = 3.16 to 5.16, around y = 1.76."""
    walls = hall(8.0, 3.2)
    walls[:, 79:129] = True
    free = round(width / CELL)
    walls[44 - free // 2 : 44 - free // 2 + free, 79:129] = False
    return floor(walls)


CELL = 0.04
DOOR = neck(0.88)
"""Width as of the passages between corridor and offices of the testbed."""
HALL = floor(hall(7.0, 3.2))


def local_planner(
    local: CostMap, parameters: DwaParameters, drive: DriveParameters = KIND.drive
) -> BaseLocalPlanner:
    if parameters.rules == "indigo":
        return DwaLocalPlanner(local, drive, parameters)
    return DiscLocalPlanner(local, RADIUS, drive, parameters)


@dataclass
class Record:
    poses: list[Pose] = field(default_factory=list)
    steerings: list[Steering] = field(default_factory=list)
    gap: float = math.inf
    """Minimum distance to walls and others so far, m."""
    arrived: bool = False

    @property
    def invalid(self) -> int:
        count = 0
        for steering in reversed(self.steerings):
            if steering.valid:
                break
            count += 1
        return count


class Pilot:
    """A robot with its planners and one goal."""

    def __init__(
        self,
        floor: OccupancyGrid,
        start: Pose,
        goal: Point,
        *,
        preset: str = "disc",
        parameters: DwaParameters | None = None,
        noise: np.random.Generator | None = None,
    ) -> None:
        """Create a robot; `noise`: the estimate jumps by 5 cm and 0.02 rad (σ) in each step."""
        self.base = FakeBase(floor, KIND, start)
        self.goal = goal
        self.fixed: list[tuple[Point, float]] = []
        self.local = CostMap(KIND.sensor, RADIUS, LOCAL_MAPS[preset])
        self.local_planner = local_planner(self.local, parameters or DWA[preset])
        self.record = Record()
        self._start = start
        self._sweeps = OdometryBuffer(KIND.sensor)
        self._planner = GridPlanner(planning_grid(floor, RADIUS))
        self._noise = noise

    def step(self, step: int) -> None:
        senses = self.base.senses(step)
        odometry, instant = senses.odometry, at_step(step)
        here = Pose(odometry.x, odometry.y, odometry.heading)
        self.local.take(instant, here, self._sweeps.take(instant, here, senses.scan))
        estimate = self._estimate(here)
        if step % 10 == 0:
            path = self._planner.path(estimate.point, self.goal)
            assert path is not None
            self.local_planner.follow(path)
        velocity = Twist(odometry.vx, odometry.vy, odometry.omega)
        self.record.arrived |= self.local_planner.reached(estimate, velocity)
        steering = self.record.steerings[-1] if step % 2 else Steering(STILL, True)
        if self.record.arrived:
            steering = Steering(STILL, True)
        elif step % 2 == 0:  # of 0.1 s: a command holds for two
            steering = self.local_planner.steer(instant, here, estimate, velocity)
        self.record.steerings.append(steering)
        self.record.poses.append(self.base.pose)
        self.base.drive(Drive(step, *steering.twist, 0))
        self.record.gap = min(self.record.gap, self.base.wall_gap())

    def _estimate(self, here: Pose) -> Pose:
        pose = self._start.compose(here)
        if self._noise is None:
            return pose
        x, y, turn = self._noise.normal(0.0, (0.05, 0.05, 0.02))
        return pose.compose(Pose(float(x), float(y), float(turn)))


def drive(*pilots: Pilot, steps: int) -> None:
    for step in range(steps):
        bodies = [(pilot.base.pose.point, RADIUS) for pilot in pilots]
        for k, pilot in enumerate(pilots):
            pilot.base.obstacles = [*pilot.fixed, *bodies[:k], *bodies[k + 1 :]]
        for pilot in pilots:
            pilot.step(step)
        if all(pilot.record.arrived for pilot in pilots):
            return
