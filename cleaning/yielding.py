"""Of two robots that stand in each other's way one backs out along its own trail, and waits for the other.

After priority inheritance with backtracking (PIBT, Okumura 2019, arXiv 1901.11282), for pairs: a robot that
has somewhere to go comes before one that has not, else the greater id. Robots less than 0.45 m apart have
no valid trajectory, and without backing out stand to the end of the run.
"""

from dataclasses import dataclass, field
from typing import Final, Self

from actors.geometry import Point
from actors.robot.behaviour import FARTHEST_BACK, FloorPlan, Navigation
from actors.settings import check_range
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters
from deeco import Duration, Instant, adaptation, component, ensemble, periodic, replace, seconds

_DRAWS: Final = 8
"""Of so many random places the nearest is where a robot goes that only has to go away."""


@dataclass(frozen=True)
class YieldingParameters(AdaptationParameters):
    """The chapter's numbers, and those of giving way."""

    yield_distance: float = 1.5
    """Of two blocked robots nearer to each other than this one gives way, m: head-on they stop at 1.4 m."""
    yield_checks: int = 2
    """It does so once it has been blocked for so many seconds, ..."""
    insist_checks: int = 5
    """... and the other one, should that not have helped, after so many."""
    back_out: float = 1.0
    """So far it backs out, m, ..."""
    back_out_of_door: float = 2.0
    """... and so far if it stands in a door."""
    wait: Duration = field(default=seconds(8))
    """So long it lets the other one pass, backing out included."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("back_out", "back_out_of_door"):
            check_range(f"strategy.{name}", getattr(self, name), 0.0, FARTHEST_BACK)


@component
class YieldingRobot(AdaptiveCleaningRobot):
    """Gives way by backing out."""

    parameters: YieldingParameters = YieldingParameters()
    backs_by: float = 0.0
    """So far it is yet to tell navigation to back out, m."""
    waits_until: Instant | None = None
    """It has given way until then."""

    @adaptation
    @periodic(every=seconds(1), order=6)
    def give_way(self, navigation: Navigation, now: Instant) -> Self:
        """Back out if it is to, and wait; then ask navigation anew."""
        if self.backs_by:
            navigation.stop()
            navigation.back_out(self.backs_by)
            return replace(self, backs_by=0.0)
        if self.waits_until is None:
            return self
        if now < self.waits_until:
            return replace(self, state=State.FREE, still_for=0, blocked_for=0)
        return replace(self, waits_until=None, attempt=self.attempt + 1)

    @adaptation
    @periodic(every=seconds(2), order=6)
    def leave_door(self, floor: FloorPlan) -> Self:
        """Who wants nowhere does not stand in a door."""
        if self.target is not None or floor.door(self.position) is None:
            return self
        return self.sent_to(aside(self.position, floor))

    def yielding(self, floor: FloorPlan, now: Instant) -> Self:
        """The robot that is to back out."""
        p = self.parameters
        far = p.back_out if floor.door(self.position) is None else p.back_out_of_door
        return replace(self, backs_by=far, waits_until=Instant(now + p.wait))


@ensemble(every=seconds(1), max_age=seconds(5))
class Yielding:
    """Of two blocked robots near each other one gives way."""

    max_distance: float
    """Nearer to one another than this, m."""
    least_checks: int
    """Who comes second gives way once it has been blocked for so many seconds,"""
    insist_checks: int
    """and who comes first after so many."""

    def membership(self, coordinator: Cleaner, member: YieldingRobot) -> bool:
        """They block each other, and the member has not given way yet."""
        if not (coordinator.is_blocked() and member.is_blocked()) or member.waits_until is not None:
            return False
        first = (member.destination is not None, member.id) > (
            coordinator.destination is not None,
            coordinator.id,
        )
        if member.blocked_for < (self.insist_checks if first else self.least_checks):
            return False
        return coordinator.position.distance_to(member.position) < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: YieldingRobot, floor: FloorPlan, now: Instant
    ) -> YieldingRobot:
        """The member gives way."""
        return member.yielding(floor, now)


@ensemble(every=seconds(3), max_age=seconds(5))
class SteppingAside:
    """A robot that wants nowhere goes a little way when another one near it is blocked."""

    max_distance: float
    """From nearer than this, m."""

    def membership(self, coordinator: Cleaner, member: YieldingRobot) -> bool:
        """The coordinator is blocked, the member has nothing to do, and they are near each other."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.target is None and apart < self.max_distance

    def at_member(self, coordinator: Cleaner, member: YieldingRobot, floor: FloorPlan) -> YieldingRobot:
        """The member goes."""
        return member.sent_to(aside(member.position, floor))


def aside(here: Point, floor: FloorPlan) -> Point:
    """A place out of all doors that is not far, m: the nearest of a few random ones."""
    drawn = [floor.random_place() for _ in range(_DRAWS)]
    out = [place for place in drawn if floor.door(place) is None and place.distance_to(here) > 1.0] or drawn
    far = [floor.length(place, here) for place in out]
    return min(zip(far, out, strict=True), key=lambda one: one[0] if one[0] is not None else 1e9)[1]
