"""The ensembles of the example adaptation: robots that block each other exchange their destinations.

After DestinationAdoptionEnsemble and AdoptedDestinationRemoveEnsemble of d3scomp/deeco-adaptation-testbed
(the chapter's Fig. 7.12), and so that no place is lost, whatever happens to messages:

Call a *taking* every entry of a place into a robot's route, and let it weigh (term, id of the robot), terms
first. Of all takings so far, let the heaviest be that of robot R.

1. A robot has a place no longer in its route for three reasons only: it has visited it; it has given it up;
   or a peer's published `adopted` shows a taking heavier than the robot's own.
2. What is published has happened: each `Claim` stands for a taking by who publishes it. Messages that are
   lost, late, repeated or out of order make no others.
3. So nobody ever shows R a taking heavier than its own, and R holds the place until it has visited it or
   given it up. It does not take it again while it holds it, nor after that.
4. At the start the owner's taking is the only one; whenever a heavier one comes, the same holds of who took.

Others may hold the place beside R, because of old messages. They drop it when they hear R, or visit it again.

A robot that is restarted forgets what it had adopted; its own places it takes anew (`place.assignments`).
"""

from actors.robot.behaviour import FloorPlan
from cleaning.adaptive import AdaptiveCleaningRobot, HeardPeer
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from deeco import Duration, Instant, ensemble, milliseconds, seconds


@ensemble(every=seconds(3), max_age=seconds(5))
class MakingWay:
    """A robot that wants nowhere goes somewhere else when another one near it is blocked."""

    max_distance: float
    """From nearer than this, m."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """The coordinator is blocked, the member has nothing to do, and they are near each other."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.target is None and apart < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, floor: FloorPlan
    ) -> AdaptiveCleaningRobot:
        """The member goes."""
        return member.sent_to(floor.random_place())


@ensemble(every=milliseconds(500), max_age=seconds(2))
class PeerMask:
    """A robot notes where those are that its range sensor may see."""

    max_distance: float
    """From nearer than this, m."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """They are near each other."""
        return coordinator.position.distance_to(member.position) < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """The member knows where the coordinator is."""
        return member.with_peer(HeardPeer(coordinator.id, coordinator.position, now))


@ensemble(every=seconds(3), max_age=seconds(5))
class DestinationAdoption:
    """Of two blocked robots near each other, each adopts the destination of the other.

    Knowledge older than 5 s, of which four publications got lost, says little of who is blocked; the original
    believes it for ever.
    """

    max_distance: float
    """Nearer to one another than this they adopt, m."""
    least_checks: int
    """A robot adopts once it has been blocked for so many seconds."""
    backoff: Duration
    """From one adoption of a robot to its next."""

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Both are blocked, and near each other."""
        return (
            coordinator.is_blocked()
            and member.is_blocked()
            and coordinator.position.distance_to(member.position) < self.max_distance
        )

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """The member takes over where the coordinator wants to go."""
        if coordinator.destination is None or member.blocked_for < self.least_checks:
            return member
        if member.adopted_at is not None and now - member.adopted_at < self.backoff:
            return member
        return member.adopting(coordinator.destination, now)


@ensemble(every=seconds(3))
class AdoptedDestinationRemove:
    """A robot drops the places that another one has taken over.

    However old: that somebody has taken a place over stays true.
    """

    exchange: bool
    """A robot that was heading for such a place takes the one which the other left for it."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """The coordinator has taken over what the member still has in its route."""
        return bool(member.taken_by(coordinator))

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """The member leaves it to the coordinator."""
        return member.leaving_to(coordinator, now, exchange=self.exchange)


def exchanges(parameters: AdaptationParameters) -> tuple[object, ...]:
    """The ensembles by which blocked robots exchange destinations."""
    p = parameters
    adoption = DestinationAdoption(p.adoption_distance, p.adoption_checks, p.adoption_backoff)
    return adoption, AdoptedDestinationRemove(p.exchange)
