"""A custom strategy that uses every verb: `./acrc run --strategy examples.courteous:behaviour`.

Robots visit the nearest place first (reorder). Each of two blocked robots waits or drives to a random place
with equal probability (pause, send anywhere). A finished robot adopts the last place of another one (hand
over). At closing time, remaining places are given up (give up). No place is lost: see `cleaning.adoption`.
"""

from dataclasses import dataclass, field
from typing import Self

from numpy.random import Generator

from actors.robot.behaviour import Behaviour, FloorPlan, Navigation, Start, TaskMonitor, from_settings, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from cleaning.place import Assignment
from deeco import START, Duration, Instant, adaptation, component, ensemble, periodic, replace, role, seconds


@dataclass(frozen=True)
class CourteousParameters(AdaptationParameters):
    """Settings of the scenario's table [strategy]."""

    wait: Duration = field(default=seconds(3))
    """Waiting time of a robot that gives way."""
    closing: Duration = field(default=seconds(580))
    """Time since the start of the run at which robots give remaining places up."""


@role
class OfferingCleaner(Cleaner):
    """A cleaner that also publishes a place for other robots."""

    offered: Assignment | None = None


@component
class CourteousRobot(AdaptiveCleaningRobot, OfferingCleaner):
    """A robot that gives way and helps others."""

    parameters: CourteousParameters = CourteousParameters()
    waits_until: Instant | None = None

    @adaptation
    @periodic(every=seconds(5))
    def reorder(self) -> Self:
        """Sort places by distance and offer the farthest one."""
        nearest = tuple(
            sorted(self.route, key=lambda assignment: assignment.point.distance_to(self.position))
        )
        return replace(self, route=nearest, offered=nearest[-1] if len(nearest) > 1 else None)

    @adaptation
    @periodic(every=seconds(1), order=6)
    def wait(self, navigation: Navigation, now: Instant) -> Self:
        """Stand while giving way, then request the goal again."""
        if self.waits_until is None:
            return self
        if now >= self.waits_until:
            return replace(self, waits_until=None, attempt=self.attempt + 1)
        navigation.stop()
        return self

    @adaptation
    @periodic(every=seconds(10))
    def close(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Give remaining places up at closing time."""
        robot = self
        if now >= START + self.parameters.closing:
            for assignment in self.route:
                robot = robot.given_up(assignment, "it was closing time", monitor, now)
        return robot


@ensemble(every=seconds(3), max_age=seconds(5))
class RandomYielding:
    """Each of two blocked robots near each other waits or moves away, at random."""

    max_distance: float

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Return True if both are blocked and near each other."""
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
        """Wait or drive to a random place."""
        if member.waits_until is not None:
            return member
        if generator.random() < 0.5:
            return member.sent_to(floor.random_point())
        return replace(member, waits_until=Instant(now + member.parameters.wait))


@ensemble(every=seconds(3), max_age=seconds(5))
class PlaceHandover:
    """A finished robot adopts an offered place, which the other robot then drops."""

    def membership(self, coordinator: OfferingCleaner, member: CourteousRobot) -> bool:
        """Return True if the coordinator offers a place and the member has none."""
        return coordinator.offered is not None and not member.route

    def at_member(self, coordinator: OfferingCleaner, member: CourteousRobot, now: Instant) -> CourteousRobot:
        """Adopt the offered place."""
        return member if coordinator.offered is None else member.adopting(coordinator.offered, now)


def behaviour(start: Start) -> Behaviour:
    """Give way, help other robots, and close in time: an example of a custom strategy."""
    p = from_settings(CourteousParameters, start.settings)
    robot, yielding = CourteousRobot.at_start(start, p), RandomYielding(p.adoption_distance)
    return host(start, robot, yielding, PlaceHandover(), AdoptedDestinationRemove(exchange=False))
