"""A robot's core, its behaviour, and a base to feed it; and what the core refuses."""

from collections.abc import Sequence

import pytest

from actors.geometry import Point, Pose
from actors.messages import (
    Drive,
    Heard,
    Received,
    Sent,
)
from actors.robot.behaviour.decision_limits import RobotLimits
from actors.robot.core import RobotCore, RobotParts
from actors.robot.cost_maps.cost_map import CostMap
from actors.robot.local_planning.dwa_parameters import DwaParameters
from actors.robot.local_planning.local_planner import DwaLocalPlanner
from actors.robot.localisation import DeadReckoning
from actors.robot.navigation.navigator import Navigator
from actors.robot.navigation.planning import Planner, ground
from actors.robot.sweep import Sweeps
from actors.runtime.core import Output
from actors.runtime.errors import AcrcError
from actors.topic import Message
from tests.robot.base import TWO_ROOMS, FakeBase, model
from tests.robot.behaviours import Scripted

FLOOR = ground(TWO_ROOMS, 0.177)
START = Pose(1.0, 1.0, 0.0)
LIMITS = RobotLimits()
HEARD = Heard(90, 2, -60.0, 255, b"hello")


class Masked(DeadReckoning):
    """Dead reckoning that notes which peers it is told of."""

    told: tuple[Point, ...] | None = None

    relocalised = 0

    def mask(self, peers: Sequence[Point]) -> None:
        self.told = tuple(peers)

    def relocalise(self) -> None:
        self.relocalised += 1


class Robot:
    """A core, its behaviour, and a base to feed it."""

    def __init__(
        self,
        decision: object = None,
        first_step: int = 0,
        limits: RobotLimits = LIMITS,
        behaviour: Scripted | None = None,
    ) -> None:
        kind = model()
        self.behaviour = behaviour or Scripted(decision)
        self.base = FakeBase(TWO_ROOMS, kind, START)
        local = CostMap(kind.sensor, 0.177)
        local_planner = DwaLocalPlanner(local, kind.drive, DwaParameters())
        navigation = Navigator(Planner(FLOOR), local, local_planner)
        self.localisation = Masked(START)
        parts = RobotParts(Sweeps(kind.sensor), self.localisation, navigation, self.behaviour)
        self.core = RobotCore(
            "r1", parts, entry="my.study:behaviour", first_step=first_step, step_us=100_000, limits=limits
        )

    def take_step(self, *events: Heard | Sent) -> tuple[Output, ...]:
        """One step of core and base; nothing may be missing."""
        step = self.core.step
        inputs: dict[str, Message] = {"swarm/down/r1/senses": self.base.senses(step, len(events))}
        if events:
            inputs["swarm/down/r1/received"] = Received(step, events)
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
