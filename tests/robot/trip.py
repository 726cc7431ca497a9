"""A robot on its way to goals: its navigation is real, its planners and its local map obey a test."""

import numpy as np
from numpy.typing import NDArray

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, seconds
from actors.robot.behaviour.goal import GoalPhase, GoalStatus
from actors.robot.local_planning.steering import Steering
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters, Navigator
from actors.robot.navigation.planning import Planner, ground
from actors.robot.sweep import Sweep
from tests.robot.base import TWO_ROOMS, at_step

FLOOR = ground(TWO_ROOMS, 0.177)
WEST, FAR = Point(1.0, 1.0), Point(9.0, 3.0)
NOWHERE = Point(30.0, 1.0)
AHEAD = Twist(0.5, 0.0, 0.0)
CHAPTER, CLEARING = NAVIGATION_PRESETS["chapter"], NavigationParameters(reset_distance=3.0)
ACTIVE, SUCCEEDED, ABORTED = GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED
HERE = Pose(0.0, 0.0, 0.0)
SHIFT = Pose(-3.0, 2.0, 1.0)
"""The map's origin in the odometry frame."""


class Told(Planner):
    """A planner that finds no way if told so."""

    def __init__(self) -> None:
        super().__init__(FLOOR)
        self.finds = True
        self.asked = 0

    def path(
        self, start: Point, goal: Point, marks: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64] | None:
        self.asked += 1
        return super().path(start, goal, marks) if self.finds else None


class Obedient:
    """A local planner that finds what it is told to find, and arrives when it is told to."""

    period = seconds(0.2)

    def __init__(self) -> None:
        self.valid = True
        self.ways: list[NDArray[np.float64]] = []
        self.begun = 0
        self.asked: list[Instant] = []
        self.found = self.arrives = True

    def begin(self) -> None:
        self.begun += 1

    def follow(self, way: NDArray[np.float64]) -> None:
        self.ways.append(way)

    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        return self.arrives and estimate.point.distance_to(Point(*self.ways[-1][-1])) <= 0.15

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        self.asked.append(instant)
        self.found = self.valid
        return Steering(AHEAD if self.valid else STILL, self.valid)


class Memory:
    """A local map that is told what it holds."""

    def __init__(self) -> None:
        self.cleared: list[float] = []
        self.marked = np.empty((0, 2))
        self.behind = True

    def take(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Needs no scan."""

    def clear(self, beyond: float) -> None:
        self.cleared.append(beyond)

    def marks(self) -> NDArray[np.float64]:
        return self.marked

    def free_behind(self, here: Pose, distance: float, *, touching: bool = False) -> bool:
        return self.behind


class Trip:
    """A robot that is carried about; `drift` says whether it gets about by itself."""

    def __init__(self, parameters: NavigationParameters = CHAPTER) -> None:
        self.local_planner, self.map = Obedient(), Memory()
        self.planner = Told()
        self.navigation = Navigator(self.planner, self.map, self.local_planner, parameters)
        self.place = WEST
        self.step = 0
        self.drifts = True

    def take_step(self, bumped: bool = False) -> Twist:
        estimate = Pose(self.place.x, self.place.y, 0.5)
        here = SHIFT.compose(estimate)
        self.navigation.sense(at_step(self.step), here, None)
        twist = self.navigation.advance(at_step(self.step), here, estimate, STILL, bumped)
        if self.drifts and twist == AHEAD:
            way = self.local_planner.ways[-1]
            nearest = int(np.hypot(*(way - np.array(self.place)).T).argmin())
            self.place = Point(*way[min(nearest + 1, len(way) - 1)].tolist())
        self.step += 1
        return twist

    def steps(self, number: int) -> list[Twist]:
        return [self.take_step() for _ in range(number)]

    def goes_to(self, goal: Point) -> "Trip":
        self.navigation.take(goal)
        return self

    @property
    def status(self) -> GoalStatus | None:
        return None if self.navigation.goal is None else self.navigation.goal.status

    @property
    def phase(self) -> GoalPhase | None:
        assert self.navigation.goal is not None
        return self.navigation.goal.phase

    def count(self, name: str) -> object:
        return self.navigation.outcome()[name]
