"""Auction in which the robots of an office form a group with a doorkeeper.

Idea: an office is a region with one door, in which robots block each other. The robot in it coordinates the
group of its office: it admits the robot that has most places there and adopts all of them at once if that is
cheaper, which bids for single places miss. Robots that are not admitted visit their other places first.
Source: own, after ensembles with cardinality (DEECo) and bundles of places (CBBA). Limits: as `auction`;
robots out of radio range enter. Settings: `OfficeBiddingParameters`.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Annotated, Self

from actors.robot.behaviour import Behaviour, FloorPlan, Start, from_settings
from cleaning.place import Assignment
from cleaning.strategies.auction import Bidder, BiddingParameters, BiddingRobot, hosted
from cleaning.strategies.tour import PathCosts
from deeco import (
    GroupCoordinator,
    GroupMember,
    Resolution,
    component,
    ensemble,
    group,
    one_of,
    replace,
    role,
    seconds,
)


@dataclass(frozen=True)
class OfficeBiddingParameters(BiddingParameters):
    """Parameters of the auction and of offices."""

    most_bundled: int = 4
    """Number of places of an office that are offered together; 0: none."""
    admit: bool = True
    """Robots that are not admitted visit their other places first."""


@role
class OfficeBidder(Bidder, GroupCoordinator, GroupMember):
    """A bidder that publishes its office and its places in one office."""

    office: int | None = None
    """Region of the office in which it is, or in whose door; None in no office."""
    bundle_office: int | None = None
    """Region of the bundle."""
    bundle: tuple[Assignment, ...] = ()
    """Its places in the office with most of them; those in its own office only if all are there."""
    bundle_saving: Annotated[float, Resolution(10)] = 0.0
    """Length saved by removing the bundle from its tour, m."""


@component
class OfficeRobot(BiddingRobot, OfficeBidder):
    """A bidding robot that coordinates the group of its office and joins those of other offices."""

    parameters: OfficeBiddingParameters = OfficeBiddingParameters()
    queues: tuple[tuple[str, int], ...] = ()
    """Doorkeepers that have not admitted it, each with its office."""

    def adopt_bundle(self, peer: OfficeBidder, floor: FloorPlan) -> Self:
        """Return the robot with the peer's bundle if that reduces the sum of squared loads."""
        p, robot, added = self.parameters, self, 0.0
        costs = PathCosts(floor, p.door_charge)
        for place in peer.bundle:
            cost, index = costs.insertion(robot.position, robot.route, place.point)
            taken = robot.insert_place(place, index)
            added += cost if taken is not robot else 0.0
            robot = taken
        load, left = self.load + added, max(0.0, peer.load - peer.bundle_saving)
        gain = peer.load * peer.load + self.load * self.load - left * left - load * load
        return replace(robot, load=load) if gain > 2 * p.margin * max(peer.load, load) else self

    def _in_tour_order(self, costs: PathCosts) -> Self:
        """Return the robot with its places in a short tour, those in offices of other doorkeepers last."""
        floor, full = costs.floor, {office for _, office in self.queues} - {self.office}
        later = tuple(place for place in self.route if floor.region(place.point) in full)
        first = tuple(place for place in self.route if place not in later)
        if not (first and later and self.parameters.admit):
            return super()._in_tour_order(costs)
        robot = replace(self, route=first)
        if self.destination in later:
            robot = robot.heading_for(costs.two_opt(self.position, first)[0])
        robot = super(OfficeRobot, robot)._in_tour_order(costs)
        return replace(robot, route=(*robot.route, *costs.two_opt(robot.route[-1].point, later)))

    def _with_bids(self, costs: PathCosts) -> Self:
        """Return the robot with its load, next bids, office and bundle."""
        floor, robot = costs.floor, super()._with_bids(costs)
        offices = _offices(floor)
        door = floor.door(self.position)
        regions = floor.doors[door].regions if door is not None else (floor.region(self.position),)
        office = next((region for region in regions if region in offices), None)
        counts = Counter(region for place in self.route if (region := floor.region(place.point)) in offices)
        chosen = max(counts, key=lambda one: (one != office, counts[one], one), default=None)
        bundle = tuple(
            place for place in self.route if chosen in offices and floor.region(place.point) == chosen
        )
        if not 0 < len(bundle) <= self.parameters.most_bundled:
            return replace(robot, office=office, bundle_office=chosen, bundle=(), bundle_saving=0.0)
        others = [place for place in self.route if place not in bundle]
        saving = costs.tour(self.position, self.route) - costs.tour(self.position, others)
        return replace(robot, office=office, bundle_office=chosen, bundle=bundle, bundle_saving=saving)


@group(coordinator=OfficeBidder, every=seconds(1), max_age=seconds(5))
class Office:
    """A doorkeeper admits one robot to its office and adopts its places there if that is cheaper."""

    guests = one_of(OfficeBidder)

    def select_guests(self, coordinator: OfficeBidder, member: OfficeBidder) -> bool:
        """Return True if the member has places in the coordinator's office and is not its doorkeeper."""
        if coordinator.office is None or member.bundle_office != coordinator.office:
            return False
        return member.office != coordinator.office or coordinator.id < member.id

    def utility_guests(self, coordinator: OfficeBidder, member: OfficeBidder) -> float:
        """Return the number of the member's places in the office."""
        return len(member.bundle)

    def at_coordinator(self, coordinator: OfficeRobot, member: OfficeBidder, floor: FloorPlan) -> OfficeRobot:
        """Adopt the member's places in the office."""
        return coordinator.adopt_bundle(member, floor)


@ensemble(every=seconds(1), max_age=seconds(5))
class OfficeQueue:
    """A robot that the doorkeeper has not admitted visits its other places first."""

    def membership(self, coordinator: OfficeBidder, member: OfficeRobot) -> bool:
        """Return True if the coordinator is in an office and has not admitted the member."""
        confirmed = {one.coordinator for one in member.group_confirmations}
        return coordinator.office is not None and coordinator.id not in confirmed

    def at_member(self, coordinator: OfficeBidder, member: OfficeRobot) -> OfficeRobot:
        """Store the doorkeeper."""
        assert coordinator.office is not None
        others = {one for one in member.queues if one[0] != coordinator.id}
        return replace(member, queues=tuple(sorted({*others, (coordinator.id, coordinator.office)})))

    def at_member_end(self, coordinator: OfficeBidder, member: OfficeRobot) -> OfficeRobot:
        """Drop the doorkeeper."""
        return replace(member, queues=tuple(one for one in member.queues if one[0] != coordinator.id))


def _offices(floor: FloorPlan) -> frozenset[int]:
    """Return the regions with one door."""
    counts = Counter(region for door in floor.doors for region in door.regions)
    return frozenset(region for region, count in counts.items() if count == 1)


def behaviour(start: Start) -> Behaviour:
    """Extend `auction`: the robot in an office admits others and adopts their places there together."""
    p = from_settings(OfficeBiddingParameters, start.settings)
    return hosted(start, OfficeRobot.at_start(start, p), Office(), OfficeQueue())
