"""Demand and outages: settings of the table [logistics], and what is drawn from them and the seed."""

import math
from typing import Annotated, Final, NamedTuple

from msgspec import Meta

from actors.instant import Duration, seconds
from actors.portable.draws import exponentials
from actors.randomness import generator
from actors.settings import (
    Count,
    Interval,
    NotNegative,
    Place,
    Positive,
    PositiveInterval,
    RuleError,
    Settings,
    check_spans,
)
from logistics.items import DeliveryOrder

MOST_ORDERS: Final = 300
"""Orders of a run: with their confirmations, one robot could be told of all (`OrderLimits.items`)."""
_MOST_OUTAGES: Final = 20
"""Outages drawn for one station or charger."""
_Times = Annotated[
    tuple[NotNegative, NotNegative],
    Meta(description="two times [from, to] in s, at least 0, the first below the second"),
]
_Points = Annotated[tuple[Place, ...], Meta(max_length=100, description="a list of at most 100 points")]


class OutageTable(Settings, frozen=True, kw_only=True):
    """An outage: a station is closed, or a charger has failed, for some time."""

    station: Count | None = None
    """Index of the station."""
    charger: Count | None = None
    at: Interval
    """s."""
    until: Interval

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.station is None) == (self.charger is None) or self.at >= self.until:
            raise RuleError("have either a station or a charger, and an `until` after `at`")


class LogisticsTable(Settings, frozen=True):
    """[logistics]: stations, chargers, orders and outages."""

    stations: _Points = ()
    """Points between which orders are carried, m; empty: drawn from the seed."""
    chargers: _Points = ()
    station_count: Annotated[int, Meta(ge=2, le=100)] = 6
    """Number of stations that are drawn."""
    charger_count: Annotated[int, Meta(ge=0, le=100)] = 2
    rate: Annotated[float, Meta(gt=0, le=60)] = 2.0
    """Mean number of orders per minute; they arrive independently (Poisson process)."""
    orders: Annotated[int, Meta(ge=1, le=MOST_ORDERS)] | None = None
    """Number of orders after which no more arrive; the run ends once all are delivered. Absent: no limit."""
    deadline: _Times = (240.0, 480.0)
    """Bounds of the time that an order has from arrival to delivery, s; drawn uniformly."""
    capacity: Annotated[int, Meta(ge=1, le=20)] = 1
    """Orders that a robot can carry at a time."""
    power: NotNegative = 30.0
    """Power of a charger, W; a robot takes at most its model's `charging`."""
    sight: Positive = 3.0
    """Distance from which a robot sees whether a station or charger works, m."""
    outages: Annotated[tuple[OutageTable, ...], Meta(max_length=100)] = ()
    """Outages at given times."""
    station_closed_every: Interval = Duration(0)
    """Mean time from one outage of a station to the next, s; 0: only `outages`."""
    charger_fails_every: Interval = Duration(0)
    """The same for a charger."""
    outage: PositiveInterval = seconds(180)
    """Mean duration of a drawn outage, s."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_spans(self, "deadline")
        if len(self.stations) == 1:
            raise RuleError("have at least two stations")


class OutageEvent(NamedTuple):
    """Begin or end of an outage."""

    instant: int
    is_charger: bool
    number: int
    """Index of the station or charger."""
    change: int
    """1: an outage begins, -1: it ends; outages may overlap."""


class OrderArrival(NamedTuple):
    """An order, and the robot to which the dispatcher gives it."""

    robot: int
    """Index."""
    order: DeliveryOrder


def arrivals(settings: LogisticsTable, stations: int, robots: int, seed: int, end: int) -> list[OrderArrival]:
    """Return the orders that arrive before the instant `end`, µs; draws do not depend on `end`."""
    stream, most = generator(seed, "task", "orders"), settings.orders or MOST_ORDERS
    gaps = exponentials(stream, 60e6 / settings.rate, MOST_ORDERS).tolist()
    draws = stream.random((MOST_ORDERS, 4)).tolist()
    found, now = [], 0
    for gap, (first, second, owner, slack) in zip(gaps[:most], draws, strict=False):
        now += max(1, math.ceil(gap))
        if now >= end:
            break
        pickup = int(first * stations)
        delivery = (pickup + 1 + int(second * (stations - 1))) % stations
        low, high = settings.deadline
        order = DeliveryOrder(pickup, delivery, now, now + seconds(low + slack * (high - low)))
        found.append(OrderArrival(int(owner * robots), order))
    return found


def outage_events(settings: LogisticsTable, stations: int, chargers: int, seed: int) -> list[OutageEvent]:
    """Return begin and end of all outages, those of the settings and drawn ones, in order of time."""
    spans = [
        (one.charger is not None, one.station or one.charger or 0, int(one.at), int(one.until))
        for one in settings.outages
    ]
    kinds = (False, stations, settings.station_closed_every), (True, chargers, settings.charger_fails_every)
    for is_charger, count, mean in kinds:
        for number in range(count if mean else 0):
            stream, now = generator(seed, "task", f"{'charger' if is_charger else 'station'} {number}"), 0.0
            draws = exponentials(stream, 1.0, 2 * _MOST_OUTAGES).tolist()
            for gap, length in zip(draws[::2], draws[1::2], strict=True):
                begin = now + gap * mean
                now = begin + length * settings.outage
                spans.append((is_charger, number, int(begin), int(now)))
    events = [OutageEvent(begin, kind, number, 1) for kind, number, begin, _ in spans]
    return sorted(events + [OutageEvent(end, kind, number, -1) for kind, number, _, end in spans])
