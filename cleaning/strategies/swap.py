"""Two robots that block each other swap destinations, and only if both agree that it is worth it.

Idea: as the chapter's exchange, in two phases and with a sense of the map: one offers, the other accepts,
and the sum of the ways must fall. Source: own, after the unilateral adoption of the chapter's Fig. 7.12.
Limits: it takes two messages more than an adoption; robots with goals on the same side never swap, and only
unblock themselves. No place is lost: both takings go by terms, as `cleaning.adoption` has it. None is
doubled but for the second in which an answer travels; if that is lost, who has accepted holds both places.
Settings: `SwapParameters`.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

from actors.robot.behaviour import Behaviour, FloorPlan, Start, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from cleaning.place import Assignment
from cleaning.settings import from_settings
from cleaning.strategies.tour import Ways
from deeco import Duration, Instant, component, ensemble, replace, role, seconds


@dataclass(frozen=True)
class SwapParameters(AdaptationParameters):
    """The chapter's numbers, and those of the swap."""

    margin: float = 0.5
    """So much the sum of both ways must fall, m."""
    patience: Duration = field(default=seconds(4))
    """So long an offer stands: it is answered within two publications, or not at all."""


class Offer(NamedTuple):
    """What a robot would swap, and with whom."""

    number: int
    """Of this robot's offers."""
    to: str
    give: Assignment
    want: Assignment


class Answer(NamedTuple):
    """That an offer was accepted."""

    to: str
    number: int


@role
class Swapper(Cleaner):
    """A cleaner with an offer, or an answer to one."""

    offer: Offer | None = None
    answer: Answer | None = None


@component
class SwappingRobot(AdaptiveCleaningRobot, Swapper):
    """Offers and accepts."""

    parameters: SwapParameters = SwapParameters()
    offered_at: Instant | None = None
    offers: int = 0
    """So many it has made."""

    def worth(self, give: Assignment, want: Assignment, peer: Cleaner, floor: FloorPlan) -> bool:
        """True if this robot at `want` and the peer at `give` have less to go than the other way round."""
        ways = Ways(floor)
        now = ways.cost(self.position, give.point) + ways.cost(peer.position, want.point)
        then = ways.cost(self.position, want.point) + ways.cost(peer.position, give.point)
        return then + self.parameters.margin < now

    def offering(self, peer: Cleaner, floor: FloorPlan, now: Instant) -> Self:
        """The robot with an offer to the peer; itself if none is worth it, or another one stands."""
        give, want = self.destination, peer.destination
        if give is None or want is None or self.holds(want.key) or self.has_settled(want.key):
            return self
        if self.offered_at is not None and now - self.offered_at < self.parameters.patience:
            return self
        if not self.worth(give, want, peer, floor):
            return replace(self, offer=None)
        if self.offer is not None and self.offer[1:] == (peer.id, give, want):  # an answer may be under way
            return replace(self, offered_at=now)
        offer = Offer(self.offers + 1, peer.id, give, want)
        return replace(self, offer=offer, offered_at=now, offers=self.offers + 1)

    def accepting(self, peer: Swapper, floor: FloorPlan, now: Instant) -> Self:
        """The robot that has taken what it is offered, and says so; itself if it is not worth it any more."""
        offer, mine = peer.offer, self.destination
        if offer is None or mine is None or mine.key != offer.want.key:
            return self
        answer = Answer(peer.id, offer.number)
        if self.answer == answer or not self.worth(mine, offer.give, peer, floor):
            return self
        robot = self.adopting(offer.give, now)
        return self if robot is self else replace(robot, answer=answer, offer=None)

    def concluding(self, now: Instant) -> Self:
        """The robot whose offer was accepted, on its way to what it wanted."""
        if self.offer is None:
            return self
        return replace(self.adopting(self.offer.want, now), offer=None)


@ensemble(every=seconds(1), max_age=seconds(3))
class Offers:
    """Of two blocked robots near each other the one with the lesser id makes an offer."""

    max_distance: float
    """Nearer to one another than this, m."""

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Both are blocked, and near each other."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.is_blocked() and apart < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: SwappingRobot, floor: FloorPlan, now: Instant
    ) -> SwappingRobot:
        """The member offers."""
        return member.offering(coordinator, floor, now) if member.id < coordinator.id else member


@ensemble(every=seconds(1), max_age=seconds(3))
class Accepts:
    """Who is offered a swap that is worth it takes what it is offered."""

    def membership(self, coordinator: Swapper, member: Cleaner) -> bool:
        """There is an offer to the member."""
        return coordinator.offer is not None and coordinator.offer.to == member.id

    def at_member(
        self, coordinator: Swapper, member: SwappingRobot, floor: FloorPlan, now: Instant
    ) -> SwappingRobot:
        """The member accepts."""
        return member.accepting(coordinator, floor, now)


@ensemble(every=seconds(1))
class Concludes:
    """Who has been accepted takes what it wanted, however late, if its offer still stands."""

    def membership(self, coordinator: Swapper, member: Swapper) -> bool:
        """The coordinator answers the member's offer."""
        if member.offer is None or member.offer.to != coordinator.id:
            return False
        return coordinator.answer == Answer(member.id, member.offer.number)

    def at_member(self, coordinator: Swapper, member: SwappingRobot, now: Instant) -> SwappingRobot:
        """The member takes it."""
        return member.concluding(now)


def behaviour(start: Start) -> Behaviour:
    """As the chapter's, but destinations are swapped by offer and answer, and only for shorter ways."""
    p = from_settings(SwapParameters, start.settings)
    robot = SwappingRobot.at_start(start, p)
    remove = AdoptedDestinationRemove(exchange=False)
    return host(start, robot, Offers(p.adoption_distance), Accepts(), Concludes(), remove)
