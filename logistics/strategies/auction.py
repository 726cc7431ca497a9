"""Decentralised auction of orders by time, with energy and waiting for chargers; blocked robots give way.

Idea: each robot publishes the time that its orders take, including charging, and some orders that it has not
picked up; another robot takes an order over if that reduces the sum of squared times. Chargers are chosen by
distance and estimated waiting time; a robot charges before an order that it could not finish, and while idle.
Source: as the auction of the cleaning robots (`cleaning.strategies.auction`: CBBA); giving way as in
`cleaning.yielding` (PIBT). Limits: knowledge arrives by radio only; orders of a robot that is off are lost.
Settings: `AuctionParameters`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, NamedTuple, Self

from actors.geometry import Point
from actors.items import ItemKey
from actors.robot.behaviour import (
    Behaviour,
    FloorPlan,
    Navigation,
    Positioning,
    Start,
    TaskMonitor,
    from_settings,
    host,
)
from actors.robot.behaviour.ports import TYPICAL_SPEED
from deeco import (
    Duration,
    Instant,
    ModeChart,
    Resolution,
    Transition,
    adaptation,
    component,
    ensemble,
    milliseconds,
    periodic,
    replace,
    role,
    seconds,
)
from logistics.robot import FAR, Carrier, HeldOrder, distance
from logistics.strategies.threshold import ChargerExchange, ThresholdParameters, ThresholdRobot


@dataclass(frozen=True)
class AuctionParameters(ThresholdParameters):
    """Parameters of the auction; own choices, rates for a TurtleBot 2 with its camera."""

    low: float = 0.01
    """Charge that should remain when the robot arrives at a charger."""
    drain: float = 0.00019
    """Charge that driving takes per second."""
    gain: float = 0.00013
    """Charge that a charger gives per second."""
    share: float = 0.02
    """Charge above that of a waiting robot at which the robot leaves its charger."""
    full: float = 0.9
    """Charge at which an idle robot leaves its charger."""
    margin: float = 10.0
    """Least gain of a takeover, s."""
    most_offers: int = 3
    """Orders published at a time, in rotation."""
    distance: float = 2.5
    """Greatest distance between robots that give way, m: head-on in a door they stop up to 1.7 m apart."""
    patience: int = 3
    """Seconds after which a standing robot with a target is blocked."""
    insist: int = 8
    """The same for the robot with priority."""
    wait: float = 7.0
    """Time from backing out until a robot drives again, s."""
    change: float = 30.0
    """Time from one robot's charge to the next, s."""
    queue: float = 2.0
    """Distance from an occupied charger at which the next robot waits, m."""


class OrderOffer(NamedTuple):
    """An order that another robot may take over."""

    order: HeldOrder
    saving: Annotated[float, Resolution(1)]
    """Time that its holder would save, s."""


@role
class OrderBidder(Carrier):
    """A carrier that publishes its load and some of its orders."""

    load: Annotated[float, Resolution(1)] = 0.0
    """Time that its orders take, s."""
    offers: tuple[OrderOffer, ...] = ()


class Motion(Enum):
    """Modes of a robot."""

    DRIVING = "driving"
    YIELDING = "yielding"
    """It backs out, then waits."""


@component
class BiddingCarrierRobot(ThresholdRobot, OrderBidder):
    """A robot that takes orders of others over, and gives way."""

    parameters: AuctionParameters = AuctionParameters()
    next_offer: int = 0
    before: Point | None = None
    still_for: int = 0
    """Time of standing with a target, s."""
    back: float = 0.0
    """Distance of backing out that is yet to be requested, m."""
    mode: Motion = Motion.DRIVING
    waypoint: Point | None = None
    """Point to which an idle robot makes way, m."""

    def must_back_out(self) -> bool:
        """Return True until navigation has received the request to back out."""
        return self.back > 0

    def has_backed_out(self) -> bool:
        """Return True if there is no such request."""
        return not self.back

    def waiting_time(self) -> Duration:
        """Return how long the robot waits."""
        return seconds(self.parameters.wait)

    modes = ModeChart(
        Transition(Motion.DRIVING, Motion.YIELDING, when=must_back_out),
        Transition(Motion.YIELDING, Motion.DRIVING, when=has_backed_out, after=waiting_time),
    )

    @adaptation
    @periodic(every=seconds(1), order=2)
    def offer(self, floor: FloorPlan) -> Self:
        """Publish the load and the next orders."""
        free = [one for one in self.orders if not one.is_loaded]
        load, count = self.time_for(floor, self.orders), min(self.parameters.most_offers, len(free))
        chosen = [free[(self.next_offer + step) % len(free)] for step in range(count)]
        offers = tuple(
            OrderOffer(one, load - self.time_for(floor, [two for two in self.orders if two != one]))
            for one in chosen
        )
        return replace(self, load=load, offers=offers, next_offer=self.next_offer + count)

    @adaptation
    @periodic(every=seconds(1), order=3)
    def detect_blocked(self) -> Self:
        """Count the time of standing with a target out of reach."""
        stands = self.before is not None and self.position.is_nearer(self.before, 0.05)
        wants = self.target is not None and not self.is_there() and self.mode is Motion.DRIVING
        still_for = self.still_for + 1 if stands and wants and not self._queues() else 0
        return replace(
            self, before=self.position, still_for=still_for, is_blocked=still_for >= self.parameters.patience
        )

    @adaptation
    @periodic(every=seconds(1), order=6)
    def give_way(self, navigation: Navigation) -> Self:
        """Back out; `drive` requests the target again after waiting."""
        if not self.back:
            return self
        navigation.stop()
        navigation.back_out(self.back)
        return replace(self, back=0.0, sent=None, still_for=0)

    def choose(self, floor: FloorPlan, positioning: Positioning, monitor: TaskMonitor, now: Instant) -> Self:
        """Choose as without auction; an idle robot that is in the way drives to its waypoint."""
        robot = super().choose(floor, positioning, monitor, now)
        if robot.target is not None or robot.waypoint is None:
            return replace(robot, waypoint=None)
        robot = replace(robot, target=robot.waypoint)
        return replace(robot, target=None, waypoint=None) if robot.is_there() else robot

    @periodic(every=milliseconds(500), order=4, modes=(Motion.DRIVING,))
    def drive(self, navigation: Navigation, now: Instant) -> Self:
        """Drive as without auction, but wait at a distance from an occupied charger."""
        if self._queues():
            if self.sent is not None:
                navigation.stop()
            return replace(self, sent=None)
        return super().drive(navigation, now)

    def needs_charge(self, floor: FloorPlan) -> bool:
        """Return True if idle, or if the next order and the way to a charger would take too much charge."""
        held, p = self.next_order(floor), self.parameters
        if held is None:
            return any(not self.rivals(charger) for charger in range(len(self.chargers)))
        way = self._length(floor, self.position, [held])
        home = min((distance(floor, self.stations[held.delivery], one) for one in self.chargers), default=0.0)
        wait = min(self.charger_costs().values(), default=0.0)
        least = p.low if self.charger < 0 else p.low + p.share / 2  # keeps the decision on the way
        return self.charge - p.drain * (way + home + wait) / TYPICAL_SPEED < least

    def has_enough(self) -> bool:
        """Return True if charged enough to work, or if idle to be full or to make room for another robot."""
        p = self.parameters
        waiting = [one.charge for one in self.users if one.charger == self.charger and one.charge < p.enough]
        enough = p.enough if self.orders or waiting else p.full
        if waiting:
            enough = min(enough, max(min(waiting), p.low) + p.share)
        return self.charge >= enough

    def charger_costs(self) -> Mapping[int, float]:
        """Return the estimated waiting time at each charger as a distance, m; idle robots do not wait."""
        p, costs = self.parameters, dict[int, float]()
        for charger in range(len(self.chargers)):
            rivals = self.rivals(charger)
            wait = math.fsum(p.change + self._charging_time(one.charge) for one in rivals)
            costs[charger] = FAR if rivals and not self.orders else wait * TYPICAL_SPEED
        return costs

    def time_for(self, floor: FloorPlan, orders: Sequence[HeldOrder]) -> float:
        """Return the time that orders take, s, with charging and waiting for it."""
        p, driving = self.parameters, self._length(floor, self.position, orders) / TYPICAL_SPEED
        lacking = driving * p.drain + p.low - self.charge
        wait = 0.0
        if self.charger >= 0:
            wait = self._charging_time(self.charge)
        elif lacking > 0:
            wait = lacking / p.gain + min(self.charger_costs().values(), default=FAR) / TYPICAL_SPEED
        return driving + wait + self.still_for

    def take_cheaper(self, peer: OrderBidder, floor: FloorPlan) -> Self:
        """Return the robot with those of the peer's orders that reduce the sum of squared times."""
        robot, theirs = self, peer.load
        for held, saving in peer.offers:
            if held.key in self.settled or any(one.key == held.key for one in robot.orders):
                continue
            taken = replace(robot, orders=(*robot.orders, held._replace(term=held.term + 1)))
            mine, after = robot.time_for(floor, robot.orders), robot.time_for(floor, taken.orders)
            left = max(0.0, theirs - saving)
            if left * left + after * after + 2 * self.parameters.margin * max(theirs, after) < (
                theirs * theirs + mine * mine
            ):
                robot, theirs = taken, left
        return robot

    def taken_by(self, peer: OrderBidder) -> frozenset[ItemKey]:
        """Return the orders that the peer holds with a higher term."""
        terms = {held.key: held.term for held, _ in peer.offers}
        return frozenset(
            one.key
            for one in self.orders
            if not one.is_loaded and one.key in terms and (terms[one.key], peer.id) > (one.term, self.id)
        )

    def should_give_way(self, peer: Carrier) -> bool:
        """Return True if the peer is blocked near by and this robot can move out of its way."""
        if not peer.is_blocked or not self.position.is_nearer(peer.position, self.parameters.distance):
            return False
        if self.charger >= 0 and self.is_there():
            return False
        p = self.parameters
        patience = p.patience if peer.id > self.id else p.insist
        return not self.back and (self.target is None or self._queues() or self.still_for >= patience)

    def giving_way(self, floor: FloorPlan) -> Self:
        """Return the robot with the decision to back out, or if idle to drive elsewhere."""
        if self.target is None:
            points = [floor.random_point() for _ in range(8)]
            return replace(self, waypoint=min(points, key=lambda one: distance(floor, self.position, one)))
        back = 1.0 if floor.door(self.position) is None else 2.0
        return replace(self, back=back)

    def _charging_time(self, charge: float) -> float:
        return max(0.0, self.parameters.enough - charge) / self.parameters.gain

    def _queues(self) -> bool:
        """Return True if another robot is at the charger, and this one near enough to wait."""
        if self.charger < 0 or self.is_there():
            return False
        here = self.chargers[self.charger]
        return self.position.is_nearer(here, self.parameters.queue) and any(
            one.position.is_nearer(here, 1.0) for one in self.rivals(self.charger)
        )

    def _length(self, floor: FloorPlan, here: Point, orders: Sequence[HeldOrder]) -> float:
        """Return the length of the way for orders, always the nearest next, m."""
        total, rest = 0.0, [*orders]
        while rest:
            nearest = min(
                rest, key=lambda one: (not one.is_loaded, distance(floor, here, self.stations[one.station]))
            )
            rest.remove(nearest)
            for station in dict.fromkeys((nearest.station, nearest.delivery)):
                total += distance(floor, here, self.stations[station])
                here = self.stations[station]
        return total


@ensemble(every=seconds(1), max_age=seconds(5))
class OrderAuction:
    """A robot takes orders over that it can deliver at lower cost."""

    def membership(self, coordinator: OrderBidder, member: BiddingCarrierRobot) -> bool:
        """Return True if the coordinator has offers and the member can move."""
        return bool(coordinator.offers) and not member.is_blocked

    def at_member(
        self, coordinator: OrderBidder, member: BiddingCarrierRobot, floor: FloorPlan
    ) -> BiddingCarrierRobot:
        """Take orders over."""
        return member.take_cheaper(coordinator, floor)


@ensemble(every=seconds(1))
class OrderHandover:
    """A robot drops orders that another robot holds with a higher term; knowledge of any age is used."""

    def membership(self, coordinator: OrderBidder, member: BiddingCarrierRobot) -> bool:
        """Return True if there are such orders."""
        return bool(member.taken_by(coordinator))

    def at_member(self, coordinator: OrderBidder, member: BiddingCarrierRobot) -> BiddingCarrierRobot:
        """Leave these orders to the coordinator."""
        return member.without(member.taken_by(coordinator), settled=False)


@ensemble(every=seconds(1), max_age=seconds(3))
class GivingWay:
    """One of two robots near each other gives way."""

    def membership(self, coordinator: Carrier, member: BiddingCarrierRobot) -> bool:
        """Return True if the member should give way."""
        return member.should_give_way(coordinator)

    def at_member(
        self, coordinator: Carrier, member: BiddingCarrierRobot, floor: FloorPlan
    ) -> BiddingCarrierRobot:
        """Let the member give way."""
        return member.giving_way(floor)


def behaviour(start: Start) -> Behaviour:
    """Auction orders by time, energy and waiting for chargers; reserve chargers by radio; give way."""
    robot = BiddingCarrierRobot.at_start(start, from_settings(AuctionParameters, start.settings))
    return host(start, robot, ChargerExchange(), OrderAuction(), OrderHandover(), GivingWay())
