"""A door is held by one robot, or by one direction: `chapter`, and nobody meets head-on in a door.

Idea: prevent what the chapter cures; waiting for one robot takes 4 to 7 s, a blocking 15 to 30. Source:
own, after reservations of edges in multi-robot planning. Limits: robots that
do not hear each other through the wall both hold the door, and one backs out once they meet; open floor is
as it was. Settings: `LeasingParameters`.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

from actors.robot.behaviour import Behaviour, FloorPlan, Navigation, Start, host
from cleaning.adoption import exchanges
from cleaning.cleaner import Cleaner, State
from cleaning.place import Assignment
from cleaning.settings import from_settings
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
    """The chapter's numbers, those of giving way, and those of leases."""

    ask_distance: float = 3.0
    """From nearer than this to a door's middle, along the way, a robot asks for it, m."""
    stand_off: float = 2.0
    """Who may not go through waits where the door's middle is nearer than this, m: clear of who comes out."""
    lease: Duration = field(default=seconds(20))
    """So long a request counts, then it is made anew, behind all others: who holds a door and stands in vain
    does not hold it for good."""
    turn_away: Duration = field(default=seconds(8))
    """Who has waited for so long heads for a place with fewer doors before it, if there is one, and else goes
    in: it may itself stand where somebody wants to come out."""
    rival_age: Duration = field(default=seconds(4))
    """What others said of a door longer ago counts no more: four publications."""


class Claim(NamedTuple):
    """That a robot is about to go through a door."""

    door: int
    """Its index on the map."""
    into: int
    """The region that it goes to; the direction."""
    since: Instant
    """When it asked."""
    inside: bool
    """True once it is in the door, or next to it and going."""


class Rival(NamedTuple):
    """Another robot's claim, as it was last heard."""

    id: str
    claim: Claim
    heard: Instant


@role
class Lessee(Cleaner):
    """A cleaner that says which door it is about to go through."""

    claim: Claim | None = None


@component
class LeasingRobot(YieldingRobot, Lessee):
    """Asks for doors, and waits for its turn."""

    parameters: LeasingParameters = LeasingParameters()
    rivals: tuple[Rival, ...] = ()
    """Claims to doors that it has heard of lately."""
    held_since: Instant | None = None
    """Since when it has waited for a door; None while it does not."""
    goes_in: Claim | None = None
    """What it has waited for long enough."""

    @adaptation
    @periodic(every=milliseconds(500), order=5)
    def lease(self, floor: FloorPlan, navigation: Navigation, now: Instant) -> Self:
        """Ask for the next door; wait if somebody comes before, and go on once nobody does."""
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
            return robot._elsewhere(floor)
        navigation.pause()
        return replace(robot, held_since=since, state=State.FREE, still_for=0, blocked_for=0)

    def is_held_up(self, floor: FloorPlan) -> bool:
        """True near a door that somebody else has, unless it stands in another one itself."""
        if self.claim is None or self.claim.inside or self.comes_first():
            return False
        if floor.door(self.position) is not None or self.goes_in == self.claim._replace(inside=False):
            return False
        near = floor.length(self.position, floor.doors[self.claim.door].middle)
        return near is not None and near < self.parameters.stand_off

    def comes_first(self) -> bool:
        """True if no other robot that it has heard of has the door in another direction."""
        return all(self.precedes(rival.id, rival.claim) for rival in self.rivals)

    def precedes(self, peer: str, theirs: Claim) -> bool:
        """True if the peer's claim does not keep this robot from its door."""
        mine = self.claim
        if mine is None or mine.door != theirs.door or mine.into == theirs.into:
            return True
        return (not mine.inside, mine.since, self.id) < (not theirs.inside, theirs.since, peer)

    def hearing(self, peer: Lessee, now: Instant) -> Self:
        """The robot that knows of the peer's claim, or that it has none."""
        others = tuple(rival for rival in self.rivals if rival.id != peer.id)
        new = () if peer.claim is None else (Rival(peer.id, peer.claim, now),)
        return replace(self, rivals=others + new)

    def _elsewhere(self, floor: FloorPlan) -> Self:
        """The robot on its way to where fewer doors are before it; else through the door all the same."""
        mine = self.destination
        others = [place for place in self.route if place != mine]

        def doors(place: Assignment) -> int:
            return len(floor.doors_between(self.position, place.point) or ())

        best = min(others, key=doors, default=None)
        if mine is None or best is None or doors(best) >= doors(mine):
            return replace(self, held_since=None, goes_in=self.claim)
        return replace(self.heading_for(best), held_since=None, claim=None)

    def _claim(self, floor: FloorPlan, now: Instant) -> Claim | None:
        """The claim to the door that is next on its way; the one that it has, if it is that."""
        target, p = self.target, self.parameters
        if target is None or self.waits_until is not None:
            return None
        doors = floor.doors_between(self.position, target)
        if not doors:
            return None
        door, far = doors[0], floor.length(self.position, floor.doors[doors[0]].middle)
        if far is None or far > p.ask_distance:
            return None
        into = self._beyond(floor, door)
        inside, old = floor.door(self.position) == door, self.claim
        if old is None or (old.door, old.into) != (door, into) or now - old.since > p.lease:
            return Claim(door, into, now, inside)
        return old._replace(inside=inside)

    def _beyond(self, floor: FloorPlan, door: int) -> int:
        """The region behind the door on the way to the target; in it, the target's side counts."""
        assert self.target is not None
        way = floor.path(self.position, self.target) or ()
        passed = False
        for point in way:
            passed = passed or floor.door(point) == door
            region = floor.region(point)
            if passed and region is not None:
                return region
        return 0


@ensemble(every=milliseconds(500), max_age=seconds(4))
class DoorRivals:
    """Each robot notes who else is about to go through which door."""

    def membership(self, coordinator: Lessee, member: LeasingRobot) -> bool:
        """There is something to note."""
        return coordinator.claim is not None or any(rival.id == coordinator.id for rival in member.rivals)

    def at_member(self, coordinator: Lessee, member: LeasingRobot, now: Instant) -> LeasingRobot:
        """The member knows."""
        return member.hearing(coordinator, now)


@ensemble(every=seconds(1), max_age=seconds(4))
class DoorsCleared:
    """Of two robots that met in a door in spite of it all, who comes second backs out at once."""

    max_distance: float
    """Nearer to one another than this they have met, m."""

    def membership(self, coordinator: Lessee, member: LeasingRobot) -> bool:
        """Both are inside, in other directions, and the member comes second."""
        mine, theirs = member.claim, coordinator.claim
        if mine is None or theirs is None or not (mine.inside and theirs.inside):
            return False
        if member.waits_until is not None:  # it has given way already
            return False
        met = coordinator.position.distance_to(member.position) < self.max_distance
        return met and not member.precedes(coordinator.id, theirs)

    def at_member(
        self, coordinator: Lessee, member: LeasingRobot, floor: FloorPlan, now: Instant
    ) -> LeasingRobot:
        """The member gives way."""
        return member.yielding(floor, now)


def behaviour(start: Start) -> Behaviour:
    """As the chapter's, with doors that one direction has at a time, and robots that back out."""
    p = from_settings(LeasingParameters, start.settings)
    yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks), SteppingAside(p.yield_distance)
    doors = DoorRivals(), DoorsCleared(p.yield_distance)
    return host(start, LeasingRobot.at_start(start, p), *exchanges(p), *doors, *yielding)
