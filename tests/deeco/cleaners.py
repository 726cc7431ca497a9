"""Components and ensembles for `deeco.explain`."""

from dataclasses import replace
from typing import Any, NamedTuple, Protocol, Self

from deeco import (
    START,
    Contact,
    Duration,
    Instant,
    Knowledge,
    adaptation,
    component,
    ensemble,
    on_change,
    periodic,
    role,
    seconds,
)


class Point(NamedTuple):
    x: float
    y: float


class Positioning(Protocol):
    def position(self) -> Point: ...


class Wheels(Protocol):
    def drive_to(self, goal: Point) -> bool: ...


@role
class Cleaner(Knowledge):
    position: Point
    blocked: bool = False
    destination: Point | None = None

    def is_blocked(self) -> bool:
        return self.blocked


@role
class Charged(Knowledge):
    battery: float = 1.0


@component
class CleaningRobot(Cleaner, Charged):
    route: tuple[Point, ...] = ()
    checks: int = 0
    adopted_at: Instant = START

    @periodic(every=seconds(0.1))
    def sense(self, base: Positioning) -> Self:
        return replace(self, position=base.position())

    @periodic(every=seconds(2), offset=seconds(0.5), order=1)
    def drive(self, wheels: Wheels, now: Instant) -> Self:
        goal = self.destination or self.route[0]
        return replace(self, destination=goal, blocked=not wheels.drive_to(goal))

    @adaptation
    @on_change(Cleaner.is_blocked)
    def count_blocks(self) -> Self:
        return replace(self, checks=self.checks + 1)


@component
class Idler(Cleaner):
    pass


@component
class Riddle(Cleaner):
    @periodic(every=seconds(1))
    def guess(self, tables: dict[str, Any]) -> Self:
        return replace(self, **tables)


@ensemble(every=seconds(3), on_change=Cleaner.is_blocked, max_age=seconds(10))
class DestinationAdoption:
    max_distance: float = 3.0
    backoff: Duration = seconds(10)

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        apart = abs(coordinator.position.x - member.position.x)
        return coordinator.is_blocked() and member.is_blocked() and apart < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: CleaningRobot, now: Instant, contact: Contact
    ) -> CleaningRobot:
        goal = coordinator.destination
        if goal is None or now - member.adopted_at < self.backoff or contact.hops:
            return member
        return replace(member, route=(goal, *member.route), checks=0, adopted_at=now)

    def boundary(self, sender: Charged, here: CleaningRobot) -> bool:
        return sender.battery > here.battery


@ensemble(every=seconds(1))
class Charging:
    def membership(self, coordinator: Charged, member: Charged) -> bool:
        return coordinator.battery > member.battery


CAREFUL = DestinationAdoption(max_distance=1.5, backoff=seconds(0.5))
ROBOT = CleaningRobot(id="r1", position=Point(0.0, 0.0))
