"""Items of a task, such as places to visit or orders to deliver, and robots' reports about them."""

from collections.abc import Sequence
from typing import Any, Final, Protocol

import msgspec

from actors.topic import MessagePart
from actors.wording import short_repr

REASON_LIMIT: Final = 100
"""Maximum length of the reason for giving up an item, characters."""
ITEM_LIMIT: Final = 1000
"""Maximum encoded size of an item and of a report, bytes."""


class ItemKey(MessagePart, frozen=True):
    """Identifier of an item of the task."""

    owner: str
    """Robot to which the item was given; tasks may use other names for items without an owner."""
    number: int
    """Index in the owner's list; items given during the run are appended."""

    def __str__(self) -> str:
        """Return the key as text such as "r1/3"."""
        return f"{self.owner}/{self.number}"


class ItemGivenUp(MessagePart, frozen=True):
    """A robot's report that an item should not be tried again."""

    owner: str
    number: int
    """As in ItemKey."""
    instant: int
    reason: str
    """Text for readers, at most REASON_LIMIT characters."""

    @property
    def key(self) -> ItemKey:
        """Key of the item."""
        return ItemKey(self.owner, self.number)


class TaskReports(Protocol):
    """A robot's reports of one step about the task; part of `Decision` and `Drive`."""

    @property
    def reports(self) -> tuple[Any, ...]:
        """Reports of the task's own type: structs at the robot, plain values once received."""

    @property
    def given_up(self) -> tuple[ItemGivenUp, ...]:
        """Items given up."""

    @property
    def route(self) -> tuple[ItemKey, ...] | None:
        """Items that it still plans to do, in order; None: unchanged."""


class TaskLimits(msgspec.Struct, frozen=True):
    """Limits of a robot's task reports in one step; own choices, far above what a strategy needs."""

    reports: int = 1000
    """Reports of the task's own type."""
    given_up: int = 1000
    """Items given up; the scenario file's limit of items per robot."""
    route: int = 10_000
    """Items in a route: its own and adopted ones."""


_encode: Final = msgspec.msgpack.Encoder().encode


def plain_items(items: Sequence[Any]) -> tuple[Any, ...]:
    """Return items as a robot receives them: lists and dictionaries in place of tuples and structs."""
    return tuple(msgspec.json.decode(msgspec.json.encode(items)))


def task_reports_fault(answer: TaskReports, begin: int, end: int, limits: TaskLimits) -> str | None:
    """Return the first fault of the task reports of the step from `begin` to `end`, µs; None if valid."""
    if answer.reports and (fault := _reports_fault(answer.reports, begin, end, limits)):
        return fault
    if answer.given_up and (fault := _given_up_fault(answer.given_up, begin, end, limits)):
        return fault
    return None if answer.route is None else _route_fault(answer.route, limits)


def _reports_fault(reports: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(reports) > limits.reports:
        return f"sends {len(reports)} task reports in one step; the limit is {limits.reports}"
    for report in reports:
        if not isinstance(report, MessagePart | list):
            return f"reports {short_repr(report)}; must be a struct of the task, a subclass of MessagePart"
        try:
            size = len(_encode(report))
        except (TypeError, ValueError, OverflowError, RecursionError) as error:
            return f"reports {short_repr(report)}, which cannot be sent: {error}"
        if size > ITEM_LIMIT:
            return f"sends a task report of {size} bytes; the limit is {ITEM_LIMIT}"
        instant = getattr(report, "instant", begin)
        if fault := instant_fault("sends a task report", instant, begin, end):
            return fault
    return None


def _given_up_fault(given_up: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(given_up) > limits.given_up:
        return f"gives up {len(given_up)} items in one step; the limit is {limits.given_up}"
    for item in given_up:
        if not isinstance(item, ItemGivenUp) or not isinstance(item.reason, str):
            return f"gives up {short_repr(item)}; must be an ItemGivenUp with a text as reason"
        if not 0 < len(item.reason) <= REASON_LIMIT:
            return (
                f"gives up an item for a reason of {len(item.reason)} characters; "
                f"must have 1 to {REASON_LIMIT}"
            )
        if fault := instant_fault("gives up an item", item.instant, begin, end):
            return fault
    return None


def instant_fault(action: str, instant: object, begin: int, end: int) -> str | None:
    """Return the fault of an instant that must be in the step from `begin` to `end`, µs; None if valid."""
    if type(instant) is not int:
        return f"{action} at {short_repr(instant)} µs; must be a whole number"
    if not begin <= instant < end:
        return f"{action} at {instant} µs; must be from {begin} to {end - 1} µs"
    return None


def _route_fault(route: object, limits: TaskLimits) -> str | None:
    if not isinstance(route, tuple):
        return f"has the route {short_repr(route)}; must be a tuple of ItemKey, or None"
    if len(route) > limits.route:
        return f"has a route of {len(route)} items; the limit is {limits.route}"
    seen: set[ItemKey] = set()
    for item in route:
        if not isinstance(item, ItemKey):
            return f"has {short_repr(item)} in its route; must be an ItemKey"
        if item in seen:
            return f"has item {item.number} of {short_repr(item.owner)} twice in its route; must be unique"
        seen.add(item)
    return None
