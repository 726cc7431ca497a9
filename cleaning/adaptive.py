"""The cleaning robot with the chapter's adaptation layer: it detects that it is blocked and recovers."""

from collections.abc import Iterable
from typing import Final, NamedTuple, Self

from numpy.random import Generator

from actors.geometry import Point
from actors.items import ItemKey
from actors.robot.behaviour import FloorPlan, Positioning, TaskMonitor
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters, UnblockTarget
from cleaning.place import LAST_TERM, Assignment, Takeover
from cleaning.robot import CleaningRobot
from deeco import Instant, adaptation, component, milliseconds, periodic, replace, seconds

_PEER_AGE: Final = seconds(3)
"""Age at which peers are dropped: three publications."""


class PeerPosition(NamedTuple):
    """Last received position of another robot."""

    id: str
    position: Point
    heard: Instant


@component
class AdaptiveCleaningRobot(CleaningRobot):
    """A robot that detects blocking, chooses another target, and can adopt places of other robots."""

    parameters: AdaptationParameters = AdaptationParameters()
    before: Point | None = None
    """Position at the previous check, m."""
    still_for: int = 0
    """Consecutive checks at which it had a target and stood still."""
    blocked_for: int = 0
    """Consecutive checks at which it was blocked."""
    tried: tuple[Takeover, ...] = ()
    """Destination at each unblocking since the last visit of a place; empty if it never gives up."""
    adopted_at: Instant | None = None
    """Time of the last adoption."""
    peers: tuple[PeerPosition, ...] = ()
    """Nearby robots whose echoes are ignored; see `peer_mask`."""

    def set_destination(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Set the destination as without adaptation; a visit resets `tried`."""
        robot = super().set_destination(monitor, now)
        return robot if len(robot.settled) == len(self.settled) else replace(robot, tried=())

    @adaptation
    @periodic(every=seconds(1), order=2)
    def detect_blocked(self) -> Self:
        """Detect blocking: the robot has a target out of reach and stands still for long enough."""
        target, p = self.target, self.parameters
        wants = target is not None and not self.reaches(target)
        stands = self.before is not None and self.position.distance_to(self.before) < p.still
        still_for = self.still_for + 1 if wants and stands else 0
        state = State.BLOCKED if still_for > p.still_checks else State.FREE
        return replace(self, before=self.position, still_for=still_for, state=state)

    @adaptation
    @periodic(every=seconds(1), order=3)
    def auto_unblock(
        self, floor: FloorPlan, generator: Generator, monitor: TaskMonitor, now: Instant
    ) -> Self:
        """Choose another target or give the place up after being blocked for long enough."""
        if not self.is_blocked():
            return replace(self, blocked_for=0)
        if self.blocked_for < self.parameters.blocked_checks:
            return replace(self, blocked_for=self.blocked_for + 1)
        robot = self._count_attempt(monitor, now)._choose_target(floor, generator)
        return replace(robot._reset_counters(), state=State.FREE)

    @adaptation
    @periodic(every=milliseconds(500), order=6)
    def disregard_peers(self, positioning: Positioning, now: Instant) -> Self:
        """Ignore echoes of other robots whose position is recent."""
        if not self.parameters.peer_mask:
            return self
        peers = tuple(peer for peer in self.peers if now - peer.heard <= _PEER_AGE)
        positioning.disregard([peer.position for peer in peers])
        return replace(self, peers=peers)

    def unblocked(self) -> Self:
        """Return the robot as not blocked, with both counters at 0."""
        return replace(self, state=State.FREE, still_for=0, blocked_for=0)

    def with_peer(self, peer: PeerPosition) -> Self:
        """Return the robot with an updated peer."""
        return replace(self, peers=(*(other for other in self.peers if other.id != peer.id), peer))

    def adopting(self, assignment: Assignment, now: Instant) -> Self:
        """Return the robot on its way to a place of another robot; itself if `insert_place` does."""
        robot = self.insert_place(assignment, len(self.route))
        if robot is self:
            return self
        robot = replace(robot.heading_for(robot.route[-1]), former=self.destination, adopted_at=now)
        return robot._reset_counters()

    def insert_place(self, assignment: Assignment, index: int) -> Self:
        """Return the robot with a place of another robot in its route at `index`, destination unchanged.

        Returns itself if it holds or has settled the place, or if the term is LAST_TERM.
        """
        if self.holds(assignment.key) or self.has_settled(assignment.key) or assignment.term >= LAST_TERM:
            return self
        taken = replace(assignment, term=assignment.term + 1)
        others = tuple(takeover for takeover in self.adopted if takeover.key != assignment.key)
        return replace(
            self,
            route=(*self.route[:index], taken, *self.route[index:]),
            adopted=(*others, taken.takeover)[-self.parameters.most_adopted :],
        )

    def places_taken_by(self, peer: Cleaner) -> frozenset[ItemKey]:
        """Return the places of its route that the peer has adopted with a higher term."""
        return self.places_claimed(peer.id, peer.adopted)

    def places_claimed(self, peer: str, claims: Iterable[Takeover | Assignment]) -> frozenset[ItemKey]:
        """Return the places of its route that a peer claims with a higher term."""
        terms = {claim.key: claim.term for claim in claims}
        return frozenset(
            mine.key
            for mine in self.route
            if mine.key in terms and (terms[mine.key], peer) > (mine.term, self.id)
        )

    def leaving_to(self, peer: Cleaner, now: Instant, *, exchange: bool) -> Self:
        """Return the robot without the places that the peer has adopted.

        If one was its destination, it adopts the peer's former destination (with `exchange`) or continues
        with the first place of its route.
        """
        taken = self.places_taken_by(peer)
        robot, mine = self.without(taken, settled=False), self.destination
        if mine is None or mine.key not in taken:
            return robot
        robot = robot.heading_for(robot.route[0] if robot.route else None)._reset_counters()
        is_theirs = peer.destination is not None and peer.destination.key == mine.key
        offered = peer.former if exchange and is_theirs else None
        return robot if offered is None else replace(robot.adopting(offered, now), former=None)

    def _count_attempt(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Return the robot with one more counted attempt; gives the destination up at the limit."""
        assignment, most = self.destination, self.parameters.attempts
        if assignment is None or not most:
            return self
        tried = (*self.tried, assignment.takeover)
        if tried.count(assignment.takeover) < most:
            return replace(self, tried=tried)
        reason = f"blocked on the way to it, {most} times without visiting any place meanwhile"
        return self.given_up(assignment, reason, monitor, now)

    def _choose_target(self, floor: FloorPlan, generator: Generator) -> Self:
        """Return the robot with another target, or with a new attempt."""
        left = len(self.route)
        if self.parameters.unblock is UnblockTarget.FLOOR and generator.random() * (left + 1) < max(left, 1):
            return self.sent_to(floor.random_point())
        if not left:
            return replace(self, attempt=self.attempt + 1)
        return self.heading_for(self.route[int(generator.integers(left))])

    def _reset_counters(self) -> Self:
        """Return the robot with the counters of a new destination."""
        return self.unblocked() if self.parameters.recount else replace(self, blocked_for=0)
