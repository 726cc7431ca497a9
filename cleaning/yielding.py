"""Yielding: one of two robots that block each other backs out along its trail and waits.

Based on priority inheritance with backtracking (PIBT, Okumura 2019, arXiv 1901.11282), for pairs: a robot
with a destination has priority over one without, otherwise the greater id. Robots less than 0.45 m apart have
no valid trajectory, and without backing out stand until the end of the run.
"""

from dataclasses import dataclass, field
from typing import Final, Self

from actors.geometry import Point
from actors.robot.behaviour import MAX_BACK_OUT, FloorPlan, Navigation
from actors.settings import check_range
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from deeco import Duration, Instant, adaptation, component, ensemble, periodic, replace, seconds

_DRAWS: Final = 8
"""Number of random places from which `nearby_place` chooses the nearest."""


@dataclass(frozen=True)
class YieldingParameters(AdaptationParameters):
    """Parameters of the chapter and of yielding."""

    yield_distance: float = 1.5
    """Maximum distance between blocked robots for yielding, m: head-on they stop at 1.4 m."""
    yield_checks: int = 2
    """Time of being blocked after which the robot without priority yields, s."""
    insist_checks: int = 5
    """Time of being blocked after which the robot with priority yields, s."""
    back_out: float = 1.0
    """Distance of backing out, m."""
    back_out_of_door: float = 2.0
    """Distance of backing out if the robot stands in a door, m."""
    wait: Duration = field(default=seconds(8))
    """Waiting time for the other robot to pass, including backing out."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("back_out", "back_out_of_door"):
            check_range(f"strategy.{name}", getattr(self, name), 0.0, MAX_BACK_OUT)


@component
class YieldingRobot(AdaptiveCleaningRobot):
    """A robot that yields by backing out."""

    parameters: YieldingParameters = YieldingParameters()
    backs_by: float = 0.0
    """Distance of backing out that is yet to be requested, m."""
    waits_until: Instant | None = None
    """End of waiting; None if it does not yield."""

    @adaptation
    @periodic(every=seconds(1), order=6)
    def give_way(self, navigation: Navigation, now: Instant) -> Self:
        """Back out and wait, then request the goal again."""
        if self.backs_by:
            navigation.stop()
            navigation.back_out(self.backs_by)
            return replace(self, backs_by=0.0)
        if self.waits_until is None:
            return self
        if now < self.waits_until:
            return self.unblocked()
        return replace(self, waits_until=None, attempt=self.attempt + 1)

    @adaptation
    @periodic(every=seconds(2), order=6)
    def leave_door(self, floor: FloorPlan) -> Self:
        """Leave a door if the robot has no target."""
        if self.target is not None or floor.door(self.position) is None:
            return self
        return self.sent_to(nearby_place(self.position, floor))

    def request_back_out(self, floor: FloorPlan, now: Instant) -> Self:
        """Return the robot with a request to back out."""
        p = self.parameters
        far = p.back_out if floor.door(self.position) is None else p.back_out_of_door
        return replace(self, backs_by=far, waits_until=Instant(now + p.wait))


@ensemble(every=seconds(1), max_age=seconds(5))
class Yielding:
    """One of two blocked robots near each other yields."""

    max_distance: float
    """Maximum distance between the robots, m."""
    least_checks: int
    """Time of being blocked after which the robot without priority yields, s."""
    insist_checks: int
    """Time of being blocked after which the robot with priority yields, s."""

    def membership(self, coordinator: Cleaner, member: YieldingRobot) -> bool:
        """Return True if both are blocked near each other and the member should yield."""
        if not (coordinator.is_blocked() and member.is_blocked()) or member.waits_until is not None:
            return False
        has_priority = (member.destination is not None, member.id) > (
            coordinator.destination is not None,
            coordinator.id,
        )
        if member.blocked_for < (self.insist_checks if has_priority else self.least_checks):
            return False
        return coordinator.position.distance_to(member.position) < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: YieldingRobot, floor: FloorPlan, now: Instant
    ) -> YieldingRobot:
        """Let the member yield."""
        return member.request_back_out(floor, now)


@ensemble(every=seconds(3), max_age=seconds(5))
class SteppingAside:
    """A robot without target moves a short distance away from a blocked robot near it."""

    max_distance: float
    """Maximum distance between the robots, m."""

    def membership(self, coordinator: Cleaner, member: YieldingRobot) -> bool:
        """Return True if the coordinator is blocked near a member without target."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.target is None and apart < self.max_distance

    def at_member(self, coordinator: Cleaner, member: YieldingRobot, floor: FloorPlan) -> YieldingRobot:
        """Send the member to a place nearby."""
        return member.sent_to(nearby_place(member.position, floor))


def nearby_place(here: Point, floor: FloorPlan) -> Point:
    """Return a place outside of doors: the nearest of a few random places, m."""
    drawn = [floor.random_point() for _ in range(_DRAWS)]
    candidates = [
        place for place in drawn if floor.door(place) is None and place.distance_to(here) > 1.0
    ] or drawn
    far = [floor.length(place, here) for place in candidates]
    return min(zip(far, candidates, strict=True), key=lambda one: one[0] if one[0] is not None else 1e9)[1]
