"""Judge of the logistics task: gives orders, moves loads, operates chargers, and checks reports."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from actors.array_types import Floats
from actors.geometry import Point
from actors.instant import Instant, in_seconds
from actors.items import ItemKey, TaskReports
from actors.task.task import Column, Judge, JudgeSetup, TaskError, TaskOutcome, TaskProgress, Value
from actors.wording import short_repr
from logistics.demand import LogisticsTable, arrivals, outage_events
from logistics.items import (
    ChargingRequest,
    DeliveryOrder,
    FacilityStatus,
    Item,
    OrderConfirmation,
    PickupReport,
    Report,
    facilities,
)

REACH: Final = 0.5
"""Greatest distance of a robot from a station or charger that it uses, m."""
STANDING: Final = 0.05
"""Greatest speed of a robot that loads, unloads or is charged, m/s."""
_MOST_STATUS: Final = 90
"""Statuses told to a robot; with all orders and confirmations fewer than `OrderLimits.items`."""
_SPREAD: Final = 0.25
"""Distance between marks of orders at one station, m."""
COLUMNS: Final = (
    Column("owner", "text", "Robot to which the dispatcher gave the order"),
    Column("order", "integer", "Index in the owner's list of items"),
    Column("pickup", "integer", "Station where the load waits"),
    Column("delivery", "integer", "Station to which it must be carried"),
    Column("state", "text", "Final state: `waiting`, `carried` or `delivered`"),
    Column("arrived_s", "number", "When it arrived, s"),
    Column("deadline_s", "number", "When it should be delivered, s"),
    Column("picked_up_s", "number", "When it was picked up, s"),
    Column("carrier", "text", "Robot that picked it up"),
    Column("delivered_s", "number", "When it was delivered, s"),
)


@dataclass
class OrderState:
    """State of one order and its load: at its first station, on the carrier, or delivered."""

    key: ItemKey
    order: DeliveryOrder
    picked_up: int | None = None
    carrier: str | None = None
    delivered: int | None = None
    is_late: bool = False

    @property
    def name(self) -> str:
        """The state's name."""
        if self.delivered is not None:
            return "delivered"
        return "waiting" if self.carrier is None else "carried"

    def row(self) -> dict[str, Value]:
        """Return the row of the table of orders, by column of COLUMNS."""
        order = self.order
        values = (
            *(self.key.owner, self.key.number, order.pickup, order.delivery, self.name),
            *map(_seconds, (order.arrived, order.deadline, self.picked_up)),
            *(self.carrier, _seconds(self.delivered)),
        )
        return {column.name: value for column, value in zip(COLUMNS, values, strict=True)}


@dataclass
class RobotState:
    """State of one robot."""

    items: int
    """Number of items that it was given."""
    known: dict[tuple[bool, int], bool]
    """Status of stations and chargers that it was told last."""
    statuses: int = 0
    request: int = -1
    """Charger by which it wants to be charged; -1: none."""
    cause: str = ""
    charging_us: int = 0
    queueing_us: int = 0
    refused: int = 0
    empty: int | None = None
    """First instant at which its battery was empty."""


class LogisticsJudge(Judge):
    """Judge of orders, loads and chargers."""

    def __init__(self, setup: JudgeSetup) -> None:
        super().__init__()
        if setup.world is None:
            raise TaskError("the task logistics has simulated loads; it cannot run on real robots")
        self._world, self._ids = setup.world, setup.robots
        self._settings: LogisticsTable = setup.settings
        lists = [setup.items[robot] for robot in setup.robots]
        if different := [robot for robot, one in zip(setup.robots, lists, strict=True) if one != lists[0]]:
            raise TaskError(
                f"{different[0]} has other stations or chargers than {self._ids[0]}; give all robots the same"
            )
        self._stations, self._chargers = facilities(lists[0])
        self._facilities = {
            (is_charger, index): point
            for is_charger, points in ((False, self._stations), (True, self._chargers))
            for index, point in enumerate(points)
        }
        counts = len(self._stations), len(self._chargers)
        orders = arrivals(self._settings, counts[0], len(self._ids), setup.seed, setup.duration_us)
        self._arrivals, self._outages = orders[::-1], outage_events(self._settings, *counts, setup.seed)[::-1]
        self._out = Counter[tuple[bool, int]]()
        self._users: list[str] = [""] * counts[1]
        """Robot that uses each charger."""
        self._orders: dict[ItemKey, OrderState] = {}
        self._robots = {robot: RobotState(len(lists[0]), {}) for robot in self._ids}
        self._positions: Floats = np.zeros((len(self._ids), 2))
        self._now = 0
        for facility in self._facilities:
            self._show_facility(*facility)

    @property
    def settled(self) -> bool:
        """True once all orders of a limited number are delivered."""
        everyone = self._settings.orders is not None and not self._arrivals
        return everyone and all(one.delivered is not None for one in self._orders.values())

    def watch(self, instant: Instant, positions: Floats) -> None:
        """Process the true positions at the start of a step: orders, outages, what robots see, chargers."""
        passed, self._now, self._positions = instant - self._now, instant, positions
        while self._arrivals and self._arrivals[-1].order.arrived <= instant:
            arrival = self._arrivals.pop()
            self._give(self._ids[arrival.robot], arrival.order)
        while self._outages and self._outages[-1].instant <= instant:
            event = self._outages.pop()
            self._out[event.is_charger, event.number] += event.change
            self._show_facility(event.is_charger, event.number)
        self._tell_statuses()
        self._operate_chargers(passed)
        for one in self._orders.values():
            if not one.is_late and one.delivered is None and one.order.deadline < instant:
                one.is_late = True
                self.note(one.carrier or one.key.owner, one.order.deadline, "late", one.key)

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Process a robot's reports; return an error for an unknown order or charger, else None.

        A report that ground truth does not confirm is counted, and has no effect.
        """
        for report in answer.reports:
            if fault := self._report(robot, report):
                return fault
        for key in (*(one.key for one in answer.given_up), *(answer.route or ())):
            if key not in self._orders:
                return f"gives up {key} or has it in its route, which does not exist"
        return None

    def restart(self, robot: str) -> None:
        """Process a restart: loads stay on the robot, and its confirmations tell it again."""
        self._robots[robot].request = -1

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Count undelivered and delivered orders."""
        done = sum(one.delivered is not None for one in self._orders.values())
        return TaskProgress(len(self._orders) - done, done)

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        """Return the state of all orders, in the order of arrival."""
        orders, robots = [*self._orders.values()], self._robots.values()
        values = _values(orders, robots, end)
        delivered = [one.delivered for one in orders if one.delivered is not None]
        values |= {
            "orders_total": len(orders),
            "robots_empty": sum(one.empty is not None for one in robots),
            "first_empty_s": _seconds(
                min((one.empty for one in robots if one.empty is not None), default=None)
            ),
            "completion_s": _seconds(max(delivered)) if self.settled else None,
        }
        by_robot = {
            robot: {
                "orders_total": sum(one.key.owner == robot for one in orders),
                **_values([one for one in orders if one.carrier == robot], [state], end),
            }
            for robot, state in self._robots.items()
        }
        refused = values["reports_refused"]
        return TaskOutcome(
            f"delivered {values['orders_delivered']} of {len(orders)} orders, {values['orders_late']} late",
            values,
            by_robot,
            tuple(one.row() for one in orders),
            (f"{refused} reports were refused: ground truth did not confirm them.",) if refused else (),
        )

    def _give(self, robot: str, order: DeliveryOrder) -> None:
        key = ItemKey(robot, self._robots[robot].items)
        self._orders[key] = state = OrderState(key, order)
        self._tell(robot, order)
        self._show(state)

    def _tell(self, robot: str, item: Item) -> None:
        self._world.give(robot, (item,))
        self._robots[robot].items += 1

    def _tell_statuses(self) -> None:
        """Tell robots about stations and chargers in sight whose status they do not know."""
        for key in sorted(self._out):
            point, works = self._facilities[key], not self._out[key]
            for index, (robot, state) in enumerate(self._robots.items()):
                is_news = state.known.get(key, True) != works and state.statuses < _MOST_STATUS
                if is_news and self._is_near(index, point, self._settings.sight):
                    state.known[key] = works
                    state.statuses += 1
                    self._tell(robot, FacilityStatus(*key, works))

    def _operate_chargers(self, passed: int) -> None:
        """Let each working charger charge one robot that wants it and stands there; the first one stays."""
        world, states = self._world, self._robots
        for robot, state in states.items():
            if world.battery(robot) == 0:
                state.request, state.empty = -1, self._now if state.empty is None else state.empty
        for charger, user in enumerate(self._users):
            here = [
                robot
                for index, (robot, state) in enumerate(states.items())
                if state.request == charger and self._stands_at(index, True, charger)
            ]
            self._users[charger] = chosen = user if user in here else next(iter(here), "")
            if chosen:
                world.charge(chosen, self._settings.power)
                states[chosen].charging_us += passed
            if chosen != user:
                self._show_facility(True, charger)
        for robot, state in states.items():
            is_waiting = state.request >= 0 and robot not in self._users and world.speed(robot) < STANDING
            state.queueing_us += passed * is_waiting
            cause = "charging" if robot in self._users else "waiting for a charger" * is_waiting
            if cause != state.cause:
                state.cause = cause
                self.note(robot, self._now, cause)

    def _report(self, robot: str, report: Report) -> str | None:
        state, index = self._robots[robot], self._ids.index(robot)
        if isinstance(report, ChargingRequest):
            if report.charger >= len(self._chargers):
                return f"wants charger {report.charger}, which does not exist"
            state.request = report.charger
            return None
        key = ItemKey(report.owner, report.number)
        one = self._orders.get(key)
        if one is None:
            return f"reports order {report.number} of {short_repr(report.owner)}, which does not exist"
        is_pickup = isinstance(report, PickupReport)
        station = one.order.pickup if is_pickup else one.order.delivery
        load = sum(int(other.carrier == robot and other.delivered is None) for other in self._orders.values())
        is_there = self._stands_at(index, False, station)
        if is_pickup and one.carrier is None and load < self._settings.capacity and is_there:
            one.picked_up, one.carrier = self._now, robot
        elif not is_pickup and one.carrier == robot and one.delivered is None and is_there:
            one.delivered = self._now
        else:
            state.refused += 1
            return None
        self._tell(
            robot,
            OrderConfirmation(key.owner, key.number, one.order.pickup, one.order.delivery, not is_pickup),
        )
        self.note(robot, report.instant, "picked up" if is_pickup else "delivered", one.key)
        self._show(one)
        return None

    def _is_near(self, index: int, point: Point, distance: float) -> bool:
        x, y = self._positions[index].tolist()
        return Point(x, y).is_nearer(point, distance)

    def _stands_at(self, index: int, is_charger: bool, number: int) -> bool:
        """Return True if a robot stands at a station or charger that works."""
        key = is_charger, number
        is_there = not self._out[key] and self._is_near(index, self._facilities[key], REACH)
        return is_there and self._world.speed(self._ids[index]) < STANDING

    def _show(self, one: OrderState) -> None:
        """Show a load that waits at its station; a carried one at its destination."""
        waits = one.carrier is None
        x, y = self._stations[one.order.pickup if waits else one.order.delivery]
        column = one.key.number % 5 - 2
        state = "" if one.delivered is not None else one.name
        point = x + column * _SPREAD, y + (_SPREAD if waits else -_SPREAD)
        self.mark(one.key, point, state, one.carrier or "")

    def _show_facility(self, is_charger: bool, index: int) -> None:
        kind, user = ("charger", self._users[index]) if is_charger else ("station", "")
        state = f"{kind} out of order" if self._out[is_charger, index] else kind + " in use" * bool(user)
        self.mark(ItemKey(kind, index), self._facilities[is_charger, index], state, user)


def _seconds(instant: int | None) -> float | None:
    return None if instant is None else in_seconds(Instant(instant))


def _values(orders: Collection[OrderState], robots: Collection[RobotState], end: int) -> dict[str, Any]:
    """Return counts of some orders and sums over some robots; times in s."""
    late = [max(0, min(one.delivered or end, end) - one.order.deadline) for one in orders]
    return {
        "orders_delivered": sum(one.delivered is not None for one in orders),
        "orders_late": sum(one > 0 for one in late),
        "lateness_s": round(sum(int(one) for one in late) / 1e6, 3),
        "charging_s": round(sum(int(one.charging_us) for one in robots) / 1e6, 3),
        "queueing_s": round(sum(int(one.queueing_us) for one in robots) / 1e6, 3),
        "reports_refused": sum(int(one.refused) for one in robots),
    }
