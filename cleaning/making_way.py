"""An ensemble beyond the chapter's: who is done gets out of the way of who is not."""

from actors.robot.behaviour import FloorPlan
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import Cleaner
from deeco import ensemble, seconds


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
