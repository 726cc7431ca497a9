"""Decentralised auction of places by path length, with a charge for doors.

Idea: prevent blocking; if each office and each part of the corridor belongs to one robot, few robots meet.
Source: Choi, Brunet, How 2009 (CBBA) and Johnson et al. 2011 (ACBBA). Limits: knowledge arrives by radio
only; the auction balances loads and does not predict encounters; a killed robot keeps its places. Settings:
`BiddingParameters`.
"""

from dataclasses import dataclass
from typing import Annotated, Self

from actors.items import ItemKey
from actors.robot.behaviour import Behaviour, FloorPlan, Start, TaskMonitor, from_settings, host
from cleaning.cleaner import Cleaner
from cleaning.place import Assignment
from cleaning.strategies.tour import PathCosts
from cleaning.yielding import SteppingAside, Yielding, YieldingParameters, YieldingRobot
from deeco import Instant, Resolution, adaptation, component, ensemble, periodic, replace, role, seconds


@dataclass(frozen=True)
class BiddingParameters(YieldingParameters):
    """Parameters of yielding and of the auction."""

    make_way: bool = True
    """A finished robot moves a short distance aside; own choice."""
    most_adopted: int = 2
    """Number of published adoptions; bids cover places still held, so these are for visited ones."""
    door_charge: float = 4.0
    """Additional cost of a door, m. Own choice: half a minute of waiting, shared."""
    margin: float = 1.0
    """Minimum gain for adopting a place, m: the error of the robots' knowledge of each other."""
    commitment: float = 2.0
    """Minimum gain for changing the destination on the way, m."""
    stuck_charge: float = 0.5
    """Cost per second of being blocked, added to the robot's load and to each of its places, m: the distance
    that it could have driven."""
    most_bids: int = 3
    """Number of places published at a time, in rotation: with three, knowledge fits one frame."""


@dataclass(frozen=True)
class Bid:
    """A place in a robot's route and its cost."""

    assignment: Assignment
    saving: Annotated[float, Resolution(10)]
    """Length saved by removing the place from the tour, m."""


@role
class Bidder(Cleaner):
    """A cleaner that publishes its load and places."""

    load: Annotated[float, Resolution(10)] = 0.0
    """Cost of its tour, m, with charges for doors and for being blocked."""
    bids: tuple[Bid, ...] = ()
    """Some of its places, in rotation."""


@component
class BiddingRobot(YieldingRobot, Bidder):
    """A robot that orders its places in a short tour and adopts places that it can visit at lower cost."""

    parameters: BiddingParameters = BiddingParameters()
    next_bid: int = 0
    """Index in its route of the next published place."""
    stuck_for: int = 0
    """Time of being blocked since the last visit of a place, s."""

    def set_destination(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Set the destination; a visit resets `stuck_for`."""
        robot = super().set_destination(monitor, now)
        return robot if len(robot.settled) == len(self.settled) else replace(robot, stuck_for=0)

    @adaptation
    @periodic(every=seconds(1), order=1)
    def plan(self, floor: FloorPlan) -> Self:
        """Order the places in a short tour and publish the next bids."""
        stuck_for = self.stuck_for + 1 if self.is_blocked() else self.stuck_for
        robot = replace(self, stuck_for=stuck_for)
        costs = PathCosts(floor, self.parameters.door_charge)
        return robot._in_tour_order(costs)._with_bids(costs)

    def places_taken_by(self, peer: Cleaner) -> frozenset[ItemKey]:
        """Return also places that the peer holds, by its bids, with a higher term."""
        bids = peer.bids if isinstance(peer, Bidder) else ()
        return super().places_taken_by(peer) | self.places_claimed(peer.id, (bid.assignment for bid in bids))

    def adopt_cheaper(self, peer: Bidder, floor: FloorPlan) -> Self:
        """Return the robot with those of the peer's places that reduce the sum of squared loads."""
        robot, p = self, self.parameters
        costs, theirs = PathCosts(floor, p.door_charge), peer.load
        load = costs.tour(self.position, self.route) + p.stuck_charge * self.stuck_for
        for bid in peer.bids:
            offered = bid.assignment
            if robot.holds(offered.key) or robot.has_settled(offered.key):
                continue
            added, index = costs.insertion(robot.position, robot.route, offered.point)
            left = max(0.0, theirs - bid.saving)
            before, after = theirs * theirs + load * load, left * left + (load + added) * (load + added)
            if after + 2 * p.margin * max(theirs, load + added) >= before:
                continue
            taken = robot.insert_place(offered, index)
            if taken is not robot:
                robot, load, theirs = taken, load + added, left
        return robot

    def _in_tour_order(self, costs: PathCosts) -> Self:
        """Return the robot with its places in a short tour; prefers to keep the destination first."""
        if not self.route or self.waypoint is not None:
            return self
        route = costs.two_opt(self.position, self.route)
        mine = self.destination
        if mine is None or mine == route[0]:
            return replace(self, route=route)
        first = (mine, *(place for place in self.route if place != mine))
        kept = costs.two_opt(self.position, first, fixed=1)
        there, here = costs.tour(self.position, route), costs.tour(self.position, kept)
        if self.is_blocked() or here - there < self.parameters.commitment:
            return replace(self, route=kept)
        return replace(self.heading_for(route[0]), route=route)

    def _with_bids(self, costs: PathCosts) -> Self:
        """Return the robot with its load and next bids."""
        p, count = self.parameters, len(self.route)
        stuck = p.stuck_charge * self.stuck_for
        load = costs.tour(self.position, self.route) + stuck
        indices = [(self.next_bid + step) % count for step in range(min(p.most_bids, count))]
        bids = tuple(
            Bid(self.route[index], costs.saving(self.position, self.route, index) + stuck)
            for index in indices
        )
        return replace(self, load=load, bids=bids, next_bid=(self.next_bid + p.most_bids) % max(1, count))


@ensemble(every=seconds(1), max_age=seconds(5))
class Auction:
    """A robot adopts places of other robots that it can visit at lower cost."""

    def membership(self, coordinator: Bidder, member: BiddingRobot) -> bool:
        """Return True if the coordinator has bids and the member can move."""
        return bool(coordinator.bids) and not member.is_blocked()

    def at_member(self, coordinator: Bidder, member: BiddingRobot, floor: FloorPlan) -> BiddingRobot:
        """Adopt places that the member can visit at lower cost."""
        return member.adopt_cheaper(coordinator, floor)


@ensemble(every=seconds(1))
class HigherBid:
    """A robot drops places that another robot holds with a higher term; knowledge of any age is used."""

    def membership(self, coordinator: Bidder, member: BiddingRobot) -> bool:
        """Return True if there are such places."""
        return bool(member.places_taken_by(coordinator))

    def at_member(self, coordinator: Bidder, member: BiddingRobot, now: Instant) -> BiddingRobot:
        """Leave these places to the coordinator."""
        return member.leaving_to(coordinator, now, exchange=False)


def hosted(start: Start, robot: BiddingRobot, *further: object) -> Behaviour:
    """Return the behaviour of a bidding robot with the auction and further ensembles."""
    p = robot.parameters
    yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks)
    aside = [SteppingAside(p.yield_distance)] if p.make_way else []
    return host(start, robot, Auction(), HigherBid(), *further, yielding, *aside)


def behaviour(start: Start) -> Behaviour:
    """Auction places repeatedly by path length, with a charge for doors; blocked robots back out."""
    return hosted(start, BiddingRobot.at_start(start, from_settings(BiddingParameters, start.settings)))
