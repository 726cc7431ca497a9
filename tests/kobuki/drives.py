"""A driver and an emulated base, one on each end of a wire without a delay of its own."""

from collections.abc import Callable

import numpy as np

from actors.geometry import Pose
from actors.instant import START, Instant, milliseconds
from firmware_bridge.kobuki.base import BaseParameters, EmulatedKobuki
from firmware_bridge.kobuki.driver import Event, Fed, KobukiDriver
from tests.kobuki.room import Room, Unicycle

ROUND = milliseconds(5)
HALL = Room(20.0, 20.0)

Wish = tuple[float, float] | None


class Rig:
    """Both ends, the body, and everything that was told except each single feedback."""

    def __init__(
        self,
        base: BaseParameters | None = None,
        room: Room = HALL,
        pose: Pose | None = None,
        seed: int = 7,
    ) -> None:
        self.now = START
        self.body = Unicycle(pose, room)
        self.base = EmulatedKobuki(self.body, np.random.default_rng(seed), base or BaseParameters())
        self.driver = KobukiDriver(START)
        self.told: list[Event] = []
        self.written: list[tuple[Instant, bytes]] = []
        self.fed = 0

    def run(self, seconds: float, wish: Wish = None, each: Callable[[], None] | None = None) -> None:
        """Go on for so long with that wish, renewed every round; None: no command at all."""
        end = self.now + round(seconds * 1e6)
        while self.now < end:
            self.now = Instant(self.now + ROUND)
            if wish is not None:
                self.driver.command(self.now, *wish)
            self.once()
            if each is not None:
                each()

    def once(self) -> None:
        """One round of the shell."""
        for event in self.driver.take(self.now, self.base.run(self.now)):
            if isinstance(event, Fed):
                self.fed += 1
            else:
                self.told.append(event)
        data = self.driver.due(self.now)
        if data:
            self.written.append((self.now, data))
            self.base.take(self.now, data)
