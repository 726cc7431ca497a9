"""Places go to whom they cost least: a decentralised auction by the length of ways, with a charge for doors.

Idea: prevent instead of cure; when each office and each stretch of the corridor is one robot's, few meet.
Source: Choi, Brunet, How 2009 (CBBA) and Johnson et al. 2011 (ACBBA). Limits:
it knows of others only what arrives by radio, balances loads and does not see who will meet whom; a robot
that is killed keeps its places. Settings: `BiddingParameters`.
"""

from dataclasses import dataclass
from typing import Annotated, Self

from actors.robot.behaviour import Behaviour, FloorPlan, PlaceMonitor, Start, host
from actors.task.task import PlaceKey
from cleaning.cleaner import Cleaner
from cleaning.place import Assignment
from cleaning.settings import from_settings
from cleaning.strategies.tour import Ways
from cleaning.yielding import SteppingAside, Yielding, YieldingParameters, YieldingRobot
from deeco import Instant, Resolution, adaptation, component, ensemble, periodic, replace, role, seconds


@dataclass(frozen=True)
class BiddingParameters(YieldingParameters):
    """The chapter's numbers, and those of the auction."""

    make_way: bool = True
    """Own choice: who is done goes aside; here not to anywhere, but not far."""
    most_adopted: int = 2
    """Bids say the same of what a robot still holds; these are for what it has visited since."""
    door_charge: float = 4.0
    """What going through a door counts for beside its length, m. Own choice: half a minute's wait, shared."""
    margin: float = 1.0
    """So much a robot must do better than another one to take a place over, m: what their knowledge errs."""
    commitment: float = 2.0
    """So much shorter another order must be before a robot turns on its way to a place, m."""
    stuck_charge: float = 0.5
    """What each second in which a robot is blocked adds to its load, and to what each of its places costs it,
    m: what it could have driven meanwhile."""
    most_bids: int = 3
    """So many places a robot tells of at a time, one after the other: with three, knowledge fits a frame."""


@dataclass(frozen=True)
class Bid:
    """A place that a robot holds, and what is in it for the robot to lose it."""

    assignment: Assignment
    saving: Annotated[float, Resolution(10)]
    """So much shorter its tour would be, m."""


@role
class Bidder(Cleaner):
    """A cleaner that lets others know what it has to do."""

    load: Annotated[float, Resolution(10)] = 0.0
    """What it has before it, m: its tour, with charges for doors and for the time it has been stuck."""
    bids: tuple[Bid, ...] = ()
    """Some of its places; others follow the next time."""


@component
class BiddingRobot(YieldingRobot, Bidder):
    """Visits its places in a short order, tells of them, and takes over what it can do for less."""

    parameters: BiddingParameters = BiddingParameters()
    next_bid: int = 0
    """Index in its route of what it tells of next."""
    stuck_for: int = 0
    """Seconds that it has been blocked since it last visited a place."""

    def set_destination(self, monitor: PlaceMonitor, now: Instant) -> Self:
        """As ever; who visits a place is no longer stuck."""
        robot = super().set_destination(monitor, now)
        return robot if len(robot.settled) == len(self.settled) else replace(robot, stuck_for=0)

    @adaptation
    @periodic(every=seconds(1), order=1)
    def plan(self, floor: FloorPlan) -> Self:
        """Put the places in a short order, and tell of the next few."""
        stuck_for = self.stuck_for + 1 if self.is_blocked() else self.stuck_for
        robot = replace(self, stuck_for=stuck_for)
        ways = Ways(floor, self.parameters.door_charge)
        return robot._ordered(ways)._with_bids(ways)

    def taken_by(self, peer: Cleaner) -> frozenset[PlaceKey]:
        """Also what the peer tells that it holds by a later word than this robot's own."""
        gone = super().taken_by(peer)
        if not isinstance(peer, Bidder):
            return gone
        heard = {bid.assignment.key: bid.assignment.term for bid in peer.bids}
        return gone | {
            mine.key
            for mine in self.route
            if mine.key in heard and (heard[mine.key], peer.id) > (mine.term, self.id)
        }

    def bidding(self, peer: Bidder, floor: FloorPlan, now: Instant) -> Self:
        """The robot with what it can do for so much less than the peer that both together gain."""
        robot, p = self, self.parameters
        ways, theirs = Ways(floor, p.door_charge), peer.load
        load = ways.tour(self.position, self.route) + p.stuck_charge * self.stuck_for
        for bid in peer.bids:
            offered = bid.assignment
            if robot.holds(offered.key) or robot.has_settled(offered.key):
                continue
            added, index = ways.insertion(robot.position, robot.route, offered.point)
            left = max(0.0, theirs - bid.saving)
            before, after = theirs * theirs + load * load, left * left + (load + added) * (load + added)
            if after + 2 * p.margin * max(theirs, load + added) >= before:
                continue
            taken = robot.taking(offered, index)
            if taken is not robot:
                robot, load, theirs = taken, load + added, left
        return robot

    def _ordered(self, ways: Ways) -> Self:
        """The robot with its places in a short order; what it is on the way to stays first, if it may."""
        if not self.route or self.waypoint is not None:
            return self
        route = ways.shortened(self.position, self.route)
        mine = self.destination
        if mine is None or mine == route[0]:
            return replace(self, route=route)
        first = (mine, *(place for place in self.route if place != mine))
        kept = ways.shortened(self.position, first, fixed=1)
        there, here = ways.tour(self.position, route), ways.tour(self.position, kept)
        if self.is_blocked() or here - there < self.parameters.commitment:
            return replace(self, route=kept)
        return replace(self.heading_for(route[0]), route=route)

    def _with_bids(self, ways: Ways) -> Self:
        """The robot with what it tells next."""
        p, count = self.parameters, len(self.route)
        stuck = p.stuck_charge * self.stuck_for
        load = ways.tour(self.position, self.route) + stuck
        indices = [(self.next_bid + step) % count for step in range(min(p.most_bids, count))]
        bids = tuple(
            Bid(self.route[index], ways.saving(self.position, self.route, index) + stuck) for index in indices
        )
        return replace(self, load=load, bids=bids, next_bid=(self.next_bid + p.most_bids) % max(1, count))


@ensemble(every=seconds(1), max_age=seconds(5))
class Auction:
    """Each robot looks through what others hold, and takes over what it can do for less."""

    def membership(self, coordinator: Bidder, member: BiddingRobot) -> bool:
        """Somebody holds something, and the member can move."""
        return bool(coordinator.bids) and not member.is_blocked()

    def at_member(
        self, coordinator: Bidder, member: BiddingRobot, floor: FloorPlan, now: Instant
    ) -> BiddingRobot:
        """The member takes over what is worth it."""
        return member.bidding(coordinator, floor, now)


@ensemble(every=seconds(1))
class Outbid:
    """A robot drops the places that another one holds by a later word, however old the news."""

    def membership(self, coordinator: Bidder, member: BiddingRobot) -> bool:
        """There are such places."""
        return bool(member.taken_by(coordinator))

    def at_member(self, coordinator: Bidder, member: BiddingRobot, now: Instant) -> BiddingRobot:
        """The member leaves them to the coordinator."""
        return member.leaving_to(coordinator, now, exchange=False)


def behaviour(start: Start) -> Behaviour:
    """Auction places by the length of ways with a charge for doors, again and again, also when stuck."""
    p = from_settings(BiddingParameters, start.settings)
    yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks)
    further = [SteppingAside(p.yield_distance)] if p.make_way else []
    return host(start, BiddingRobot.at_start(start, p), Auction(), Outbid(), yielding, *further)
