"""A robot that floods a key that it may write to, through its own session."""

import sys
from typing import Any

from actors.instant import Instant, seconds
from actors.messages import TRANSMIT
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.runtime.zenoh_bus import ZenohBus
from actors.topic import Topic

FRAMES = 50_000
WHEN = seconds(1)


class FloodingRobot:
    """Robot that stands still and floods a key after one second."""

    def __init__(self, start: Start, topic: Topic[Any]) -> None:
        self._key = topic.key(start.robot) if start.robot == "r2" else None

    def advance(self, view: View, until: Instant) -> Decision:
        if self._key is not None and view.instant >= WHEN:
            bus = _bus()
            for _ in range(FRAMES):
                bus.publish(self._key, b"x" * 100)
        return Decision()


def _bus() -> ZenohBus:
    frame = sys._getframe()
    while not isinstance(frame.f_locals.get("bus"), ZenohBus):
        assert frame.f_back is not None
        frame = frame.f_back
    bus = frame.f_locals["bus"]
    assert isinstance(bus, ZenohBus)
    return bus


def transmit(start: Start) -> Behaviour:
    return FloodingRobot(start, TRANSMIT)
