"""An ensemble beyond the chapter's: who hears where another robot is does not take it for a wall."""

from cleaning.adaptive import AdaptiveCleaningRobot, HeardPeer
from cleaning.cleaner import Cleaner
from deeco import Instant, ensemble, milliseconds, seconds


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
