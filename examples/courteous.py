"""A strategy of one's own that pulls every lever: `./acrc run --strategy examples.courteous:behaviour`.

Robots visit the nearest place first (reorder). Of two that block each other, each tosses a coin whether to
stand for a while (pause) or to go somewhere else (send anywhere). Who has nothing left to do gets the last
place of somebody else (hand over). What is not done by closing time never will be (give up). No place is lost
over it: see `cleaning.adoption`.
"""

from dataclasses import dataclass, field
from typing import Self

from numpy.random import Generator

from actors.robot.behaviour import Behaviour, FloorPlan, Navigation, PlaceMonitor, Start, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from cleaning.place import Assignment
from cleaning.settings import from_settings
from deeco import START, Duration, Instant, adaptation, component, ensemble, periodic, replace, role, seconds


@dataclass(frozen=True)
class CourteousParameters(AdaptationParameters):
    """What the scenario's table [strategy] may set."""

    wait: Duration = field(default=seconds(3))
    """How long who gives way stands."""
    closing: Duration = field(default=seconds(580))
    """When robots give up what is left, after the start of the run."""


@role
class Offering(Cleaner):
    """A cleaner that lets others know, too, what they may do for it."""

    offered: Assignment | None = None


@component
class CourteousRobot(AdaptiveCleaningRobot, Offering):
    """Gives way, and does what others have not got to."""

    parameters: CourteousParameters = CourteousParameters()
    waits_until: Instant | None = None

    @adaptation
    @periodic(every=seconds(5))
    def reorder(self) -> Self:
        """The nearest place first, and the farthest for whoever has time."""
        nearest = tuple(
            sorted(self.route, key=lambda assignment: assignment.point.distance_to(self.position))
        )
        return replace(self, route=nearest, offered=nearest[-1] if len(nearest) > 1 else None)

    @adaptation
    @periodic(every=seconds(1), order=6)
    def wait(self, navigation: Navigation, now: Instant) -> Self:
        """Stand while it gives way; then ask navigation anew."""
        if self.waits_until is None:
            return self
        if now >= self.waits_until:
            return replace(self, waits_until=None, attempt=self.attempt + 1)
        navigation.stop()
        return self

    @adaptation
    @periodic(every=seconds(10))
    def close(self, monitor: PlaceMonitor, now: Instant) -> Self:
        """Give up what is left at closing time."""
        robot = self
        if now >= START + self.parameters.closing:
            for assignment in self.route:
                robot = robot.given_up(assignment, "it was closing time", monitor, now)
        return robot


@ensemble(every=seconds(3), max_age=seconds(5))
class GivingWay:
    """Two blocked robots near each other: each stands or goes away, as its coin falls."""

    max_distance: float

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Both are blocked, and near each other."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.is_blocked() and apart < self.max_distance

    def at_member(
        self,
        coordinator: Cleaner,
        member: CourteousRobot,
        floor: FloorPlan,
        generator: Generator,
        now: Instant,
    ) -> CourteousRobot:
        """Stand, or go."""
        if member.waits_until is not None:
            return member
        if generator.random() < 0.5:
            return member.sent_to(floor.random_place())
        return replace(member, waits_until=Instant(now + member.parameters.wait))


@ensemble(every=seconds(3), max_age=seconds(5))
class HandOver:
    """Who has nothing left takes over what another one offers, which that one drops when it hears of it."""

    def membership(self, coordinator: Offering, member: CourteousRobot) -> bool:
        """Somebody offers a place to somebody who has none."""
        return coordinator.offered is not None and not member.route

    def at_member(self, coordinator: Offering, member: CourteousRobot, now: Instant) -> CourteousRobot:
        """Take it over."""
        return member if coordinator.offered is None else member.adopting(coordinator.offered, now)


def behaviour(start: Start) -> Behaviour:
    """Give way, help those who have more to do, and close in time: an example of a strategy of one's own."""
    p = from_settings(CourteousParameters, start.settings)
    robot, way = CourteousRobot.at_start(start, p), GivingWay(p.adoption_distance)
    return host(start, robot, way, HandOver(), AdoptedDestinationRemove(exchange=False))
