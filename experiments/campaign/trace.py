"""Where all robots truly were, second by second, in a form that is quick to compare."""

import hashlib
import struct
from typing import Final

from actors.messages import TRUTH, Truth
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import decode
from actors.runtime.core import at

DIGITS: Final = 8
"""Hexadecimal digits of each second: two states look alike once in 4 000 million."""


class Trace:
    """Takes down what passes over the bus of a run in memory."""

    def __init__(self, bus: MemoryBus) -> None:
        self._seconds: list[str] = []
        bus.listen(at(TRUTH), self._take)

    @property
    def text(self) -> str:
        """DIGITS for each whole simulated second so far, from 0 on."""
        return "".join(self._seconds)

    def _take(self, delivery: Delivery) -> None:
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        if truth.halt or truth.instant < len(self._seconds) * 1_000_000:
            return
        poses = [value for robot in truth.robots for value in (robot.x, robot.y, robot.heading)]
        state = struct.pack(f"<{len(poses)}d", *poses)
        self._seconds.append(hashlib.blake2b(state, digest_size=DIGITS // 2).hexdigest())


def coincide_s(one: str, other: str) -> int:
    """How many whole seconds two traces have in common from the beginning on."""
    pairs = zip(_by_second(one), _by_second(other), strict=False)
    for number, (mine, theirs) in enumerate(pairs):
        if mine != theirs:
            return number
    return min(len(one), len(other)) // DIGITS


def _by_second(trace: str) -> list[str]:
    return [trace[at_ : at_ + DIGITS] for at_ in range(0, len(trace), DIGITS)]
