"""Fakes and behaviours, valid and invalid, for tests of the robot."""

from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest

from actors.array_types import Floats
from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, seconds
from actors.messages import Drive, FrameReceived, FrameSent, RadioEvents
from actors.robot.behaviour.decisions import RobotLimits
from actors.robot.behaviour.ports import Behaviour, Decision, GoalOrder, GoalPhase, GoalStatus, Start, View
from actors.robot.core import RobotCore, RobotParts
from actors.robot.localisation import DeadReckoning
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.local_planner import DwaLocalPlanner
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters, Navigator
from actors.robot.navigation.planning import GridPlanner, planning_grid
from actors.robot.navigation.steering import BaseLocalPlanner, DwaParameters, Steering
from actors.robot.sweep import OdometryBuffer, Sweep
from actors.runtime.core import Output
from actors.runtime.errors import AcrcError
from actors.topic import Message
from tests.robot.base import TWO_ROOMS, FakeBase, at_step, model

number = 7


class ScriptedBehaviour:
    def __init__(self, decision: object = None) -> None:
        self.decision = decision
        self.views: list[tuple[View, Instant]] = []

    def advance(self, view: View, until: Instant) -> Decision:
        self.views.append((view, until))
        if isinstance(self.decision, Exception):
            raise self.decision
        return self.decision or Decision()  # type: ignore[return-value]


def idle(start: Start) -> Behaviour:
    return ScriptedBehaviour()


def nothing(start: Start) -> None:
    return None


def fails(start: Start) -> Behaviour:
    raise ZeroDivisionError("of the user's own")


def keeper(start: Start) -> Behaviour:
    return ScriptedBehaviour(Decision(GoalOrder.KEEP))


FLOOR = planning_grid(TWO_ROOMS, 0.177)
START = Pose(1.0, 1.0, 0.0)
LIMITS = RobotLimits()
HEARD = FrameReceived(90, 2, -60.0, 255, b"hello")


class FakeLocalisation(DeadReckoning):
    masked: tuple[Point, ...] | None = None

    relocalised = 0

    def mask(self, peers: Sequence[Point]) -> None:
        self.masked = tuple(peers)

    def relocalise(self) -> None:
        self.relocalised += 1


class Robot:
    def __init__(
        self,
        decision: object = None,
        first_step: int = 0,
        limits: RobotLimits = LIMITS,
        behaviour: ScriptedBehaviour | None = None,
    ) -> None:
        kind = model()
        self.behaviour = behaviour or ScriptedBehaviour(decision)
        self.base = FakeBase(TWO_ROOMS, kind, START)
        local = CostMap(kind.sensor, 0.177)
        local_planner = DwaLocalPlanner(local, kind.drive, DwaParameters())
        navigation = Navigator(GridPlanner(FLOOR), local, local_planner)
        self.localisation = FakeLocalisation(START)
        parts = RobotParts(OdometryBuffer(kind.sensor), self.localisation, navigation, self.behaviour)
        self.core = RobotCore(
            "r1", parts, entry="my.study:behaviour", first_step=first_step, step_us=100_000, limits=limits
        )

    def take_step(self, *events: FrameReceived | FrameSent) -> tuple[Output, ...]:
        step = self.core.step
        inputs: dict[str, Message] = {"swarm/down/r1/senses": self.base.senses(step, len(events))}
        if events:
            inputs["swarm/down/r1/received"] = RadioEvents(step, events)
        assert not self.core.missing(inputs)
        outputs = self.core.advance(inputs)
        drive = outputs[-1].message
        assert isinstance(drive, Drive)
        self.base.drive(drive)
        return tuple(outputs)


def refusal(robot: Robot, **messages: Message) -> str:
    with pytest.raises(AcrcError) as caught:
        robot.core.advance({f"swarm/down/r1/{name}": message for name, message in messages.items()})
    return str(caught.value)


WEST, FAR = Point(1.0, 1.0), Point(9.0, 3.0)
UNREACHABLE = Point(30.0, 1.0)
AHEAD = Twist(0.5, 0.0, 0.0)
CHAPTER, CLEARING = NAVIGATION_PRESETS["chapter"], NavigationParameters(reset_distance=3.0)
ACTIVE, SUCCEEDED, ABORTED = GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED
HERE = Pose(0.0, 0.0, 0.0)
SHIFT = Pose(-3.0, 2.0, 1.0)
"""The map's origin in the odometry frame."""


class CountingPlanner(GridPlanner):
    def __init__(self) -> None:
        super().__init__(FLOOR)
        self.finds = True
        self.asked = 0

    def path(self, start: Point, goal: Point, marks: Floats | None = None) -> Floats | None:
        self.asked += 1
        return super().path(start, goal, marks) if self.finds else None


class FakeLocalPlanner:
    period = seconds(0.2)

    def __init__(self) -> None:
        self.valid = True
        self.paths: list[Floats] = []
        self.begun = 0
        self.asked: list[Instant] = []
        self.found = self.arrives = True

    def begin(self) -> None:
        self.begun += 1

    def follow(self, path: Floats) -> None:
        self.paths.append(path)

    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        return self.arrives and estimate.point.distance_to(Point(*self.paths[-1][-1])) <= 0.15

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        self.asked.append(instant)
        self.found = self.valid
        return Steering(AHEAD if self.valid else STILL, self.valid)


class FakeCostMap:
    def __init__(self) -> None:
        self.cleared: list[float] = []
        self.marked = np.empty((0, 2))
        self.behind = True

    def take(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Do nothing: scans are not used."""

    def clear(self, beyond: float) -> None:
        self.cleared.append(beyond)

    def marks(self) -> Floats:
        return self.marked

    def free_behind(self, here: Pose, distance: float, *, touching: bool = False) -> bool:
        return self.behind


def navigator(
    planner: GridPlanner,
    local: FakeCostMap,
    local_planner: FakeLocalPlanner,
    parameters: NavigationParameters = CHAPTER,
) -> Navigator:
    return Navigator(planner, cast(CostMap, local), cast(BaseLocalPlanner, local_planner), parameters)


class NavigationRun:
    def __init__(self, parameters: NavigationParameters = CHAPTER) -> None:
        self.local_planner, self.map = FakeLocalPlanner(), FakeCostMap()
        self.planner = CountingPlanner()
        self.navigation = navigator(self.planner, self.map, self.local_planner, parameters)
        self.place = WEST
        self.step = 0
        self.drifts = True

    def take_step(self, bumped: bool = False) -> Twist:
        estimate = Pose(self.place.x, self.place.y, 0.5)
        here = SHIFT.compose(estimate)
        self.navigation.sense(at_step(self.step), here, None)
        twist = self.navigation.advance(at_step(self.step), here, estimate, STILL, bumped)
        if self.drifts and twist == AHEAD:
            path = self.local_planner.paths[-1]
            nearest = int(np.hypot(*(path - np.array(self.place)).T).argmin())
            self.place = Point(*path[min(nearest + 1, len(path) - 1)].tolist())
        self.step += 1
        return twist

    def steps(self, number: int) -> list[Twist]:
        return [self.take_step() for _ in range(number)]

    def goes_to(self, goal: Point) -> "NavigationRun":
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
        return getattr(self.navigation.report(), name)
