"""The logistics robot: carries its orders, nearest first, and charges when its battery is low.

Strategies derive from `DeliveryRobot` and replace `next_order`, `needs_charge` and `charger_costs`.
"""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple, Self

from msgspec import Meta

from actors.geometry import Point
from actors.items import ItemKey
from actors.robot.behaviour import (
    BatteryMeter,
    FloorPlan,
    GoalStatus,
    Navigation,
    Positioning,
    Start,
    TaskList,
    TaskMonitor,
)
from deeco import Instant, Knowledge, Resolution, component, milliseconds, periodic, replace, role, seconds
from logistics.items import (
    ChargingRequest,
    DeliveryOrder,
    DeliveryReport,
    FacilityStatus,
    Item,
    OrderConfirmation,
    PickupReport,
    decoded,
    facilities,
)

FAR: Final = 1e6
"""Cost of what cannot be reached, m."""
RESTART_TERM: Final = 2**20
"""Term added to a restarted robot's own orders, above all takeovers before; as for cleaning robots."""


@dataclass(frozen=True)
class DeliveryParameters:
    """Parameters of the logistics robots; own choices."""

    reach: Annotated[float, Meta(gt=0, le=0.5)] = 0.4
    """Distance at which the robot stops at a station or charger, m; the judge allows 0.5 m."""
    low: Annotated[float, Meta(ge=0, le=1)] = 0.02
    """Charge below which the robot drives to a charger: 2 % of a TurtleBot's are 40 m."""
    enough: Annotated[float, Meta(ge=0, le=1)] = 0.06
    """Charge at which it leaves the charger."""
    attempts: Annotated[int, Meta(ge=1)] = 10
    """Reports of a pickup, one per half second, after which it drops the order: the load is not there."""


class HeldOrder(NamedTuple):
    """An order that the robot intends to deliver."""

    key: ItemKey
    pickup: int
    delivery: int
    deadline: int = 0
    """µs; 0: unknown."""
    term: int = 0
    """Number of takeovers known to the holder; the highest term, then the greatest robot id, holds it."""
    is_loaded: bool = False

    @property
    def station(self) -> int:
        """Station to which the robot must drive for it."""
        return self.delivery if self.is_loaded else self.pickup


def distance(floor: FloorPlan, here: Point, there: Point) -> float:
    """Return the length of the path, m."""
    length = floor.length(here, there)
    return FAR if length is None else length


@role
class Carrier(Knowledge):
    """Published state of a logistics robot."""

    position: Annotated[Point, Resolution(1000)]
    """Estimated position, m, map frame."""
    charge: Annotated[float, Resolution(10_000)] = 1.0
    """Charge of its battery, 0 to 1; 1 if unknown."""
    charger: int = -1
    """Index of the charger that it uses or wants; -1: none."""
    is_blocked: bool = False
    """It has a target and does not move."""


@component
class DeliveryRobot(Carrier):
    """A robot that delivers its orders."""

    parameters: DeliveryParameters = DeliveryParameters()
    epoch: int = 0
    stations: tuple[Point, ...] = ()
    chargers: tuple[Point, ...] = ()
    orders: tuple[HeldOrder, ...] = ()
    settled: tuple[ItemKey, ...] = ()
    """Orders delivered or dropped."""
    read: int = 0
    """Number of items of the task read."""
    closed: tuple[int, ...] = ()
    """Stations known to be closed."""
    failed: tuple[int, ...] = ()
    """Chargers known to have failed."""
    current: ItemKey | None = None
    """Order that it works on."""
    reports: int = 0
    """Consecutive reports about it that were not confirmed."""
    target: Point | None = None
    sent: Point | None = None
    """Goal of navigation."""

    @classmethod
    def at_start(cls, start: Start, parameters: DeliveryParameters) -> Self:
        """Return the robot at its start pose."""
        stations, chargers = facilities(decoded(start.items))
        return cls(
            id=start.robot,
            position=start.pose.point,
            parameters=parameters,
            epoch=start.epoch,
            stations=stations,
            chargers=chargers,
        )

    @periodic(every=milliseconds(100), order=0)
    def sense(self, positioning: Positioning, meter: BatteryMeter) -> Self:
        """Update position and charge."""
        charge = 1.0 if meter.charge is None else meter.charge
        return replace(self, position=positioning.pose.point, charge=charge)

    @periodic(every=milliseconds(500), order=0)
    def take_on(self, tasks: TaskList) -> Self:
        """Read new items: orders, confirmations, and the status of stations and chargers."""
        robot = self
        for number, item in enumerate(decoded(tasks.items[self.read :]), start=self.read):
            robot = robot.told(item, number)
        return replace(robot, read=len(tasks.items))

    @periodic(every=milliseconds(500), order=1)
    def choose(self, floor: FloorPlan, positioning: Positioning, monitor: TaskMonitor, now: Instant) -> Self:
        """Choose charger or order, and report what is done at the target."""
        robot = self._with_charger(floor, monitor, now)
        if robot.charger >= 0:
            return replace(robot, target=robot.chargers[robot.charger], current=None)
        held = robot.next_order(floor)
        if held is None:
            return replace(robot, target=None, current=None)
        reports = robot.reports if held.key == robot.current else 0
        robot = replace(robot, current=held.key, target=robot.stations[held.station], reports=reports)
        if not robot.is_there() or positioning.moving:
            return robot
        kind = DeliveryReport if held.is_loaded else PickupReport
        monitor.report(kind(held.key.owner, held.key.number, now))
        if robot.reports >= robot.parameters.attempts and not held.is_loaded:
            return robot.without({held.key}, settled=True)
        return replace(robot, reports=robot.reports + 1)

    @periodic(every=milliseconds(500), order=4)
    def drive(self, navigation: Navigation, now: Instant) -> Self:
        """Request a new target; stop at it; request an aborted goal again."""
        if self.target is None or self.is_there():
            if self.sent is not None:
                navigation.stop()
            return replace(self, sent=None)
        goal = navigation.goal
        if self.target != self.sent or (goal is not None and goal.status is GoalStatus.ABORTED):
            navigation.go_to(self.target)
        return replace(self, sent=self.target)

    @periodic(every=seconds(1), order=5)
    def report_status(self, monitor: TaskMonitor) -> Self:
        """Report the orders that it holds."""
        monitor.remaining([one.key for one in self.orders])
        return self

    def next_order(self, floor: FloorPlan) -> HeldOrder | None:
        """Return the order to work on: a loaded one, else that with the nearest load, or None."""
        possible = [one for one in self.orders if one.station not in self.closed]
        loaded = [one for one in possible if one.is_loaded]
        if loaded or any(one.is_loaded for one in self.orders):
            return next(iter(loaded), None)
        return min(
            possible, key=lambda one: distance(floor, self.position, self.stations[one.pickup]), default=None
        )

    def needs_charge(self, floor: FloorPlan) -> bool:
        """Return True if the robot should drive to a charger."""
        return self.charge < self.parameters.low

    def has_enough(self) -> bool:
        """Return True if the robot should leave its charger."""
        return self.charge >= self.parameters.enough

    def charger_costs(self) -> Mapping[int, float]:
        """Return the cost of each charger to consider, beside the way to it, m."""
        return dict.fromkeys(range(len(self.chargers)), 0.0)

    def best_charger(self, floor: FloorPlan) -> int:
        """Return the charger with the least sum of distance and cost that may work; -1: there is none."""
        costs = [
            (cost + distance(floor, self.position, self.chargers[index]), index)
            for index, cost in self.charger_costs().items()
            if index not in self.failed
        ]
        return min(costs, default=(0.0, -1))[1]

    def is_there(self) -> bool:
        """Return True at the target."""
        return self.target is not None and self.position.is_nearer(self.target, self.parameters.reach)

    def told(self, item: Item, number: int) -> Self:
        """Return the robot with the content of an item."""
        match item:
            case DeliveryOrder(pickup, delivery, _, deadline):
                key = ItemKey(self.id, number)
                held = HeldOrder(key, pickup, delivery, deadline, self.epoch * RESTART_TERM)
                return replace(self, orders=(*self.orders, held))
            case OrderConfirmation() if item.is_delivered:
                return self.without({item.key}, settled=True)
            case OrderConfirmation():  # also of another robot's order, after a restart
                held = HeldOrder(item.key, item.pickup, item.delivery)
                held = next((one for one in self.orders if one.key == item.key), held)
                rest = tuple(one for one in self.orders if one.key != item.key)
                return replace(self, orders=(*rest, held._replace(is_loaded=True)), reports=0)
            case FacilityStatus(is_charger, index, works):
                out = self.failed if is_charger else self.closed
                out = (*(one for one in out if one != index), *(() if works else (index,)))
                return replace(self, failed=out) if is_charger else replace(self, closed=out)
        return self

    def without(self, keys: Container[ItemKey], *, settled: bool) -> Self:
        """Return the robot without these orders."""
        dropped = tuple(one.key for one in self.orders if one.key in keys)
        return replace(
            self,
            orders=tuple(one for one in self.orders if one.key not in keys),
            settled=self.settled + dropped if settled else self.settled,
            current=None if self.current in dropped else self.current,
        )

    def _with_charger(self, floor: FloorPlan, monitor: TaskMonitor, now: Instant) -> Self:
        """Return the robot with the charger that it should use, or none."""
        charger = self.charger
        if self.has_enough():
            charger = -1
        elif charger < 0 or charger in self.failed or not self.is_there():
            charger = self.best_charger(floor) if self.needs_charge(floor) else -1
        if charger != self.charger:
            monitor.report(ChargingRequest(charger, now))
        return replace(self, charger=charger)
