"""A strategy that is no cleaning robot's: each of its decisions has one cause, and comes when that does.

r1 counts seconds, and does something at each number; r2 follows the wish of r1, r3 that of r2; r4 shouts.
"""

from dataclasses import replace
from typing import Self

from actors.geometry import Point
from actors.items import ItemKey
from actors.robot.behaviour import Behaviour, Navigation, Positioning, Start, TaskMonitor, host
from deeco import Instant, Knowledge, adaptation, component, ensemble, milliseconds, periodic, role, seconds

WISHES = {3: Point(5.0, 12.5), 6: Point(4.0, 12.0)}
"""Wishes of r1 by the number from which they hold."""


@role
class Wishing(Knowledge):
    """Role that is published."""

    wish: Point | None = None
    leader: str = ""


@component
class Planted(Wishing):
    """Component that counts, wishes and drives."""

    number: int = 0
    going: Point | None = None
    standing: bool = False
    backing: bool = False
    lost: bool = False
    place_left: bool = False

    @periodic(every=seconds(1), order=0)
    def count(self) -> Self:
        return replace(self, number=self.number + 1) if self.id == "r1" else self

    @periodic(every=seconds(1), order=1)
    def want(self) -> Self:
        return replace(self, wish=WISHES[self.number]) if self.number in WISHES else self

    @periodic(every=milliseconds(500), order=2)
    def go(self, navigation: Navigation) -> Self:
        if self.wish is None or self.wish == self.going:
            return self
        navigation.go_to(self.wish)
        return replace(self, going=self.wish)

    @adaptation
    @periodic(every=seconds(1), order=3)
    def halt(self, navigation: Navigation) -> Self:
        if self.number < 8 or self.standing:
            return self
        navigation.pause()
        return replace(self, standing=True)

    @adaptation
    @periodic(every=seconds(1), order=4)
    def retreat(self, navigation: Navigation) -> Self:
        if self.number < 9 or self.backing:
            return self
        navigation.back_out(0.5)
        return replace(self, backing=True)

    @adaptation
    @periodic(every=seconds(1), order=5)
    def doubt(self, positioning: Positioning) -> Self:
        if self.number < 10 or self.lost:
            return self
        positioning.relocalise()
        return replace(self, lost=True)

    @periodic(every=seconds(1), order=6)
    def leave(self, monitor: TaskMonitor, now: Instant) -> Self:
        if self.number < 11 or self.place_left:
            return self
        monitor.given_up(ItemKey(self.id, 0), "eleven", now)
        return replace(self, place_left=True)

    @adaptation
    @periodic(every=seconds(1), order=7)
    def rest(self, navigation: Navigation) -> Self:
        if self.number < 12 or self.going is None:
            return self
        navigation.stop()
        return replace(self, going=None, wish=None, number=-100)


@ensemble(every=seconds(1), max_age=seconds(20))
class Following:
    """Copies the wish of the leader to its followers."""

    def membership(self, coordinator: Wishing, member: Wishing) -> bool:
        return member.leader == coordinator.id and coordinator.wish not in (None, member.wish)

    def at_member(self, coordinator: Wishing, member: Planted) -> Planted:
        return replace(member, wish=coordinator.wish)


def behaviour(start: Start) -> Behaviour:
    """Return the behaviour: r2 and r3 follow r1, r4 follows r2."""
    leader = {"r2": "r1", "r3": "r1", "r4": "r2"}.get(start.robot, "")
    return host(start, Planted(id=start.robot, leader=leader), Following())
