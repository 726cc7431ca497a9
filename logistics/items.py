"""Items and reports of the logistics task: what robots are told, and what they report."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeAlias

import msgspec

from actors.geometry import Coordinate, Point
from actors.items import ItemKey
from actors.runtime.errors import AcrcError
from actors.topic import MessagePart

_Index = Annotated[int, msgspec.Meta(ge=0, le=1000)]
_Instant = Annotated[int, msgspec.Meta(ge=0, le=9 * 10**15)]


class Station(MessagePart, frozen=True, tag="station"):
    """A station between which orders are carried, m, map frame; its index counts the stations of the list."""

    x: Coordinate
    y: Coordinate


class Charger(MessagePart, frozen=True, tag="charger"):
    """A charger, m, map frame; its index counts the chargers of the list."""

    x: Coordinate
    y: Coordinate


class DeliveryOrder(MessagePart, frozen=True, tag="order"):
    """An order to carry a load from one station to another; given to one robot, which may pass it on."""

    pickup: _Index
    """Index of the station where the load waits."""
    delivery: _Index
    arrived: _Instant
    """Instant of arrival, µs."""
    deadline: _Instant


class FacilityStatus(MessagePart, frozen=True, tag="status"):
    """Status of a station or charger, given to a robot that comes near it and does not know the status."""

    is_charger: bool
    index: _Index
    works: bool
    """False: the station is closed, or the charger has failed."""


class OrderConfirmation(MessagePart, frozen=True, tag="confirmed"):
    """The reporting robot has truly picked up or delivered the load."""

    owner: str
    number: int
    """As in ItemKey."""
    pickup: _Index
    delivery: _Index
    is_delivered: bool

    @property
    def key(self) -> ItemKey:
        """Key of the order."""
        return ItemKey(self.owner, self.number)


Item: TypeAlias = Station | Charger | DeliveryOrder | FacilityStatus | OrderConfirmation


class PickupReport(MessagePart, frozen=True, tag="picked up"):
    """The robot stands at the order's first station and takes the load."""

    owner: str
    number: int
    """As in ItemKey."""
    instant: int


class DeliveryReport(MessagePart, frozen=True, tag="delivered"):
    """The robot stands at the order's second station and leaves the load there."""

    owner: str
    number: int
    """As in ItemKey."""
    instant: int


class ChargingRequest(MessagePart, frozen=True, tag="charging"):
    """The robot wants to be charged: it is, while it stands at this charger and no other robot uses it."""

    charger: Annotated[int, msgspec.Meta(ge=-1, le=1000)]
    """Index of the charger; -1: none any longer."""
    instant: int


Report: TypeAlias = PickupReport | DeliveryReport | ChargingRequest


def decoded(items: Sequence[Any]) -> tuple[Item, ...]:
    """Return items as structs. Raises AcrcError for items of another task."""
    try:
        return msgspec.convert(list(items), tuple[Item, ...])
    except msgspec.ValidationError as error:
        raise AcrcError(f"the robot has items of another task than logistics: {error}") from None


def facilities(items: Sequence[Item]) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """Return the points of stations and those of chargers, in the order of their items."""
    stations, chargers = (
        tuple(Point(item.x, item.y) for item in items if isinstance(item, kind))
        for kind in (Station, Charger)
    )
    return stations, chargers
