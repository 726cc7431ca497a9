"""Ensembles of the example adaptation: robots that block each other exchange their destinations.

Based on DestinationAdoptionEnsemble and AdoptedDestinationRemoveEnsemble of
d3scomp/deeco-adaptation-testbed (the chapter's Fig. 7.12), extended so that no place is lost even if messages
are lost, late, repeated or reordered. Proof:

A *claim* is the insertion of a place into a robot's route. Claims are ordered by (term, robot id). Let robot
R have the highest claim so far.

1. A robot removes a place from its route only if it has visited the place, has given it up, or receives a
   peer's `adopted` with a claim higher than its own.
2. Each published `Takeover` corresponds to a claim of its publisher; faulty transmission creates no others.
3. Therefore no robot publishes a claim higher than R's, and R holds the place until it has visited the place
   or given it up. R does not claim the place again.
4. At the start the owner has the only claim. After each higher claim, the same applies to its robot.

Other robots may hold the place because of old messages. They remove it when they receive R's claim, or visit
it again. A restarted robot loses its adopted places and claims its own places again (`place.assignments`).
"""

from actors.robot.behaviour import FloorPlan
from cleaning.adaptive import AdaptiveCleaningRobot, PeerPosition
from cleaning.cleaner import Cleaner
from cleaning.parameters import AdaptationParameters
from deeco import Duration, Instant, ensemble, milliseconds, seconds


@ensemble(every=seconds(3), max_age=seconds(5))
class MakingWay:
    """A robot without target moves away from a blocked robot near it."""

    max_distance: float
    """Maximum distance between the robots, m."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """Return True if the coordinator is blocked near a member without target."""
        apart = coordinator.position.distance_to(member.position)
        return coordinator.is_blocked() and member.target is None and apart < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, floor: FloorPlan
    ) -> AdaptiveCleaningRobot:
        """Send the member to a random place."""
        return member.sent_to(floor.random_point())


@ensemble(every=milliseconds(500), max_age=seconds(2))
class PeerMask:
    """A robot stores the positions of robots within the range of its sensor."""

    max_distance: float
    """Maximum distance between the robots, m."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """Return True if the robots are near each other."""
        return coordinator.position.distance_to(member.position) < self.max_distance

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """Store the coordinator's position."""
        return member.with_peer(PeerPosition(coordinator.id, coordinator.position, now))


@ensemble(every=seconds(3), max_age=seconds(5))
class DestinationAdoption:
    """Two blocked robots near each other adopt each other's destination.

    Knowledge older than 5 s (four lost publications) is ignored; the original uses it without limit.
    """

    max_distance: float
    """Maximum distance between the robots, m."""
    least_checks: int
    """Minimum time of being blocked before an adoption, s."""
    backoff: Duration
    """Minimum time between two adoptions of a robot."""

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Return True if both are blocked and near each other."""
        return (
            coordinator.is_blocked()
            and member.is_blocked()
            and coordinator.position.distance_to(member.position) < self.max_distance
        )

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """Adopt the coordinator's destination."""
        if coordinator.destination is None or member.blocked_for < self.least_checks:
            return member
        if member.adopted_at is not None and now - member.adopted_at < self.backoff:
            return member
        return member.adopting(coordinator.destination, now)


@ensemble(every=seconds(3))
class AdoptedDestinationRemove:
    """A robot drops places that another robot has adopted; knowledge of any age is used."""

    exchange: bool
    """A robot that loses its destination adopts the other robot's former destination."""

    def membership(self, coordinator: Cleaner, member: AdaptiveCleaningRobot) -> bool:
        """Return True if the coordinator has adopted a place of the member's route."""
        return bool(member.places_taken_by(coordinator))

    def at_member(
        self, coordinator: Cleaner, member: AdaptiveCleaningRobot, now: Instant
    ) -> AdaptiveCleaningRobot:
        """Leave these places to the coordinator."""
        return member.leaving_to(coordinator, now, exchange=self.exchange)


def exchanges(parameters: AdaptationParameters) -> tuple[object, ...]:
    """Return the ensembles by which blocked robots exchange destinations."""
    p = parameters
    adoption = DestinationAdoption(p.adoption_distance, p.adoption_checks, p.adoption_backoff)
    return adoption, AdoptedDestinationRemove(p.exchange)
