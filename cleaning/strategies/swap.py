"""The chapter's exchange of destinations in two phases, if it shortens the sum of the paths.

Idea: one robot offers, the other accepts, and both check the path lengths on the map. Source: own, after the
unilateral adoption of the chapter's Fig. 7.12. Limits: needs two messages more than an adoption; robots with
goals on the same side never swap and only unblock themselves. No place is lost, since both adoptions use
terms as in `cleaning.adoption`. Both robots hold a place only while the answer is in transit; if it is lost,
the accepting robot holds both places. Settings: `SwapParameters`.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

from actors.robot.behaviour import Behaviour, FloorPlan, Start, from_settings, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from cleaning.place import Assignment
from cleaning.strategies.tour import PathCosts
from deeco import Duration, Instant, component, ensemble, replace, role, seconds


@dataclass(frozen=True)
class SwapParameters(AdaptationParameters):
    """Parameters of the chapter and of the swap."""

    margin: float = 0.5
    """Minimum reduction of the sum of both paths, m."""
    patience: Duration = field(default=seconds(4))
    """Validity of an offer; answers arrive within two publications."""


class Offer(NamedTuple):
    """An offer to swap destinations."""

    number: int
    """Number of this robot's offer."""
    to: str
    give: Assignment
    want: Assignment


class Answer(NamedTuple):
    """Acceptance of an offer."""

    to: str
    number: int


@role
class Swapper(Cleaner):
    """A cleaner that publishes an offer or an answer."""

    offer: Offer | None = None
    answer: Answer | None = None


@component
class SwappingRobot(AdaptiveCleaningRobot, Swapper):
    """A robot that offers and accepts swaps."""

    parameters: SwapParameters = SwapParameters()
    offered_at: Instant | None = None
    offers: int = 0
    """Number of offers made."""

    def is_worthwhile(self, give: Assignment, want: Assignment, peer: Cleaner, floor: FloorPlan) -> bool:
        """Return True if the swap shortens the sum of both robots' paths by more than the margin."""
        costs = PathCosts(floor)
        now = costs.cost(self.position, give.point) + costs.cost(peer.position, want.point)
        then = costs.cost(self.position, want.point) + costs.cost(peer.position, give.point)
        return then + self.parameters.margin < now

    def make_offer(self, peer: Cleaner, floor: FloorPlan, now: Instant) -> Self:
        """Return the robot with an offer to the peer; itself if an earlier offer is still valid."""
        give, want = self.destination, peer.destination
        if give is None or want is None or self.holds(want.key) or self.has_settled(want.key):
            return self
        if self.offered_at is not None and now - self.offered_at < self.parameters.patience:
            return self
        if not self.is_worthwhile(give, want, peer, floor):
            return replace(self, offer=None)
        if self.offer is not None and self.offer[1:] == (peer.id, give, want):  # an answer may be under way
            return replace(self, offered_at=now)
        offer = Offer(self.offers + 1, peer.id, give, want)
        return replace(self, offer=offer, offered_at=now, offers=self.offers + 1)

    def accept_offer(self, peer: Swapper, floor: FloorPlan, now: Instant) -> Self:
        """Return the robot that accepts the peer's offer; itself if the swap is no longer worth it."""
        offer, mine = peer.offer, self.destination
        if offer is None or mine is None or mine.key != offer.want.key:
            return self
        answer = Answer(peer.id, offer.number)
        if self.answer == answer or not self.is_worthwhile(mine, offer.give, peer, floor):
            return self
        robot = self.adopting(offer.give, now)
        return self if robot is self else replace(robot, answer=answer, offer=None)

    def conclude_offer(self, now: Instant) -> Self:
        """Return the robot with the wanted place after its offer was accepted."""
        if self.offer is None:
            return self
        return replace(self.adopting(self.offer.want, now), offer=None)


@ensemble(every=seconds(1), max_age=seconds(3))
class Offers:
    """The robot with the lesser id of two blocked robots near each other makes an offer."""

    max_distance: float
    """Maximum distance between the robots, m."""

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Return True if both are blocked and near each other."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.is_blocked() and apart < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: SwappingRobot, floor: FloorPlan, now: Instant
    ) -> SwappingRobot:
        """Make an offer if the member's id is less."""
        return member.make_offer(coordinator, floor, now) if member.id < coordinator.id else member


@ensemble(every=seconds(1), max_age=seconds(3))
class OfferAcceptance:
    """A robot accepts an offer that is worth it."""

    def membership(self, coordinator: Swapper, member: Cleaner) -> bool:
        """Return True if the coordinator has an offer to the member."""
        return coordinator.offer is not None and coordinator.offer.to == member.id

    def at_member(
        self, coordinator: Swapper, member: SwappingRobot, floor: FloorPlan, now: Instant
    ) -> SwappingRobot:
        """Accept the offer if it is worth it."""
        return member.accept_offer(coordinator, floor, now)


@ensemble(every=seconds(1))
class OfferConclusion:
    """A robot whose offer was accepted adopts the wanted place, at any time while the offer is current."""

    def membership(self, coordinator: Swapper, member: Swapper) -> bool:
        """Return True if the coordinator answers the member's current offer."""
        if member.offer is None or member.offer.to != coordinator.id:
            return False
        return coordinator.answer == Answer(member.id, member.offer.number)

    def at_member(self, coordinator: Swapper, member: SwappingRobot, now: Instant) -> SwappingRobot:
        """Adopt the wanted place."""
        return member.conclude_offer(now)


def behaviour(start: Start) -> Behaviour:
    """Extend `chapter`: swap destinations by offer and answer, if it shortens the sum of the paths."""
    p = from_settings(SwapParameters, start.settings)
    robot = SwappingRobot.at_start(start, p)
    remove = AdoptedDestinationRemove(exchange=False)
    return host(start, robot, Offers(p.adoption_distance), OfferAcceptance(), OfferConclusion(), remove)
