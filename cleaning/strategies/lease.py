"""The chapter's example with doors leased by one robot or one direction.

Idea: prevent blocking in doors; waiting for a robot takes 4 to 7 s, a blocking 15 to 30 s. Source: own, after
edge reservations in multi-robot planning. Limits: robots without radio contact may lease the same door, and
one backs out when they meet; no effect on open floor. Settings: `LeasingParameters`.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

from actors.robot.behaviour import Behaviour, FloorPlan, Navigation, Start, from_settings, host
from cleaning.adoption import exchanges
from cleaning.cleaner import Cleaner
from cleaning.place import Assignment
from cleaning.yielding import SteppingAside, Yielding, YieldingParameters, YieldingRobot
from deeco import (
    Duration,
    Instant,
    adaptation,
    component,
    ensemble,
    milliseconds,
    periodic,
    replace,
    role,
    seconds,
)


@dataclass(frozen=True)
class LeasingParameters(YieldingParameters):
    """Parameters of the chapter, of yielding and of leases."""

    ask_distance: float = 3.0
    """Path length to a door's middle below which a robot requests the door, m."""
    stand_off: float = 2.0
    """Path length to the door's middle below which a robot without lease waits, m: leaves space to exit."""
    lease: Duration = field(default=seconds(20))
    """Validity of a request; it is then renewed behind all others, so that a stuck robot loses the door."""
    turn_away: Duration = field(default=seconds(8))
    """Timeout of waiting: the robot chooses a place behind fewer doors, otherwise it enters, since it may
    itself block the exit."""
    rival_age: Duration = field(default=seconds(4))
    """Age at which claims of other robots are dropped: four publications."""


class Claim(NamedTuple):
    """A request for a door."""

    door: int
    """Index of the door on the map."""
    into: int
    """Region behind the door: the direction."""
    since: Instant
    """Time of the request."""
    inside: bool
    """True if the robot is in the door."""


class Rival(NamedTuple):
    """Last received claim of another robot."""

    id: str
    claim: Claim
    heard: Instant


@role
class Lessee(Cleaner):
    """A cleaner that publishes its door request."""

    claim: Claim | None = None


@component
class LeasingRobot(YieldingRobot, Lessee):
    """A robot that requests doors and waits for them."""

    parameters: LeasingParameters = LeasingParameters()
    rivals: tuple[Rival, ...] = ()
    """Recent claims of other robots."""
    held_since: Instant | None = None
    """Start of waiting for a door; None if it does not wait."""
    goes_in: Claim | None = None
    """Claim with which it enters after the timeout."""

    @adaptation
    @periodic(every=milliseconds(500), order=5)
    def lease(self, floor: FloorPlan, navigation: Navigation, now: Instant) -> Self:
        """Request the next door; wait while another robot has priority."""
        p = self.parameters
        rivals = tuple(rival for rival in self.rivals if now - rival.heard <= p.rival_age)
        robot = replace(self, rivals=rivals, claim=self._claim(floor, now))
        if not robot.is_held_up(floor):
            if self.held_since is not None:
                navigation.resume()
            return replace(robot, held_since=None)
        since = self.held_since or now
        if now - since > p.turn_away:
            navigation.resume()
            return robot._avoid_door(floor)
        navigation.pause()
        return replace(robot.unblocked(), held_since=since)

    def is_held_up(self, floor: FloorPlan) -> bool:
        """Return True near a door leased by another robot, unless this robot stands in a door."""
        if self.claim is None or self.claim.inside or self.has_lease():
            return False
        if floor.door(self.position) is not None or self.goes_in == self.claim._replace(inside=False):
            return False
        near = floor.length(self.position, floor.doors[self.claim.door].middle)
        return near is not None and near < self.parameters.stand_off

    def has_lease(self) -> bool:
        """Return True if no rival leases the door in another direction."""
        return all(self.has_priority(rival.id, rival.claim) for rival in self.rivals)

    def has_priority(self, peer: str, theirs: Claim) -> bool:
        """Return True if this robot's claim has priority over the peer's, or they do not conflict."""
        mine = self.claim
        if mine is None or mine.door != theirs.door or mine.into == theirs.into:
            return True
        return (not mine.inside, mine.since, self.id) < (not theirs.inside, theirs.since, peer)

    def with_claim_of(self, peer: Lessee, now: Instant) -> Self:
        """Return the robot with the peer's current claim."""
        others = tuple(rival for rival in self.rivals if rival.id != peer.id)
        new = () if peer.claim is None else (Rival(peer.id, peer.claim, now),)
        return replace(self, rivals=others + new)

    def _avoid_door(self, floor: FloorPlan) -> Self:
        """Return the robot with a destination behind fewer doors, otherwise entering the door."""
        mine = self.destination
        others = [place for place in self.route if place != mine]

        def doors(place: Assignment) -> int:
            return len(floor.doors_between(self.position, place.point) or ())

        best = min(others, key=doors, default=None)
        if mine is None or best is None or doors(best) >= doors(mine):
            return replace(self, held_since=None, goes_in=self.claim)
        return replace(self.heading_for(best), held_since=None, claim=None)

    def _claim(self, floor: FloorPlan, now: Instant) -> Claim | None:
        """Return the claim for the next door on the path; keeps a valid one."""
        target, p = self.target, self.parameters
        if target is None or self.waits_until is not None:
            return None
        doors = floor.doors_between(self.position, target)
        if not doors:
            return None
        door, far = doors[0], floor.length(self.position, floor.doors[doors[0]].middle)
        if far is None or far > p.ask_distance:
            return None
        into = self._region_beyond(floor, door)
        inside, old = floor.door(self.position) == door, self.claim
        if old is None or (old.door, old.into) != (door, into) or now - old.since > p.lease:
            return Claim(door, into, now, inside)
        return old._replace(inside=inside)

    def _region_beyond(self, floor: FloorPlan, door: int) -> int:
        """Return the region behind the door on the path to the target."""
        assert self.target is not None
        passed = False
        for point in floor.path(self.position, self.target) or ():
            passed = passed or floor.door(point) == door
            region = floor.region(point)
            if passed and region is not None:
                return region
        return 0


@ensemble(every=milliseconds(500), max_age=seconds(4))
class RivalClaims:
    """A robot stores the claims of other robots."""

    def membership(self, coordinator: Lessee, member: LeasingRobot) -> bool:
        """Return True if the coordinator has a claim or had one."""
        return coordinator.claim is not None or any(rival.id == coordinator.id for rival in member.rivals)

    def at_member(self, coordinator: Lessee, member: LeasingRobot, now: Instant) -> LeasingRobot:
        """Store the coordinator's claim."""
        return member.with_claim_of(coordinator, now)


@ensemble(every=seconds(1), max_age=seconds(4))
class DoorClearing:
    """The robot without priority backs out if two meet in a door."""

    max_distance: float
    """Distance below which they meet, m."""

    def membership(self, coordinator: Lessee, member: LeasingRobot) -> bool:
        """Return True if both are inside in different directions and the member has no priority."""
        mine, theirs = member.claim, coordinator.claim
        if mine is None or theirs is None or not (mine.inside and theirs.inside):
            return False
        if member.waits_until is not None:  # it has given way already
            return False
        meet = coordinator.position.distance_to(member.position) < self.max_distance
        return meet and not member.has_priority(coordinator.id, theirs)

    def at_member(
        self, coordinator: Lessee, member: LeasingRobot, floor: FloorPlan, now: Instant
    ) -> LeasingRobot:
        """Let the member yield."""
        return member.request_back_out(floor, now)


def behaviour(start: Start) -> Behaviour:
    """Extend `chapter`: a door is leased by one direction at a time, and blocked robots back out."""
    p = from_settings(LeasingParameters, start.settings)
    yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks), SteppingAside(p.yield_distance)
    doors = RivalClaims(), DoorClearing(p.yield_distance)
    return host(start, LeasingRobot.at_start(start, p), *exchanges(p), *doors, *yielding)
