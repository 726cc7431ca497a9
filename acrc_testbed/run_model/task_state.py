"""Robots' reports about items of the task, and the state of all items over time."""

from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

from acrc_testbed.run_model.data import ItemEvent, Route, RunData, RunDescription
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.messages import Drive, ItemMark, TaskEvent

Routes = dict[str, frozenset[ItemKey]]
"""Items that each robot intends to do."""


def initial_routes(description: RunDescription) -> Routes:
    """Return the routes before robots report any: their own initial items."""
    counts = description.item_counts if description.task.lists_items else {}
    return {
        robot: frozenset(ItemKey(robot, number) for number in range(counts.get(robot, 0)))
        for robot in description.robots
    }


class ItemReports:
    """Accumulated reports of robots about items; a robot keeps its last route until it sends a new one."""

    def __init__(self, description: RunDescription) -> None:
        self._routes = initial_routes(description)
        self._lists_items = description.task.lists_items
        self.clear()

    def clear(self) -> None:
        """Clear the lists of events; routes are kept."""
        self.taken_over: list[ItemEvent] = []
        self.given_up: list[ItemEvent] = []
        self.routes: list[Route] = []

    def left_count(self, robot: str) -> int:
        """Return the number of items that a robot intends to do; 1 if the task's robots do not list them."""
        return len(self._routes[robot]) if self._lists_items else 1

    def extend(self, robot: str, drive: Drive, second: float) -> None:
        """Add the reports of one step that began at `second`."""
        self.given_up += [ItemEvent(robot, in_seconds(one.instant), one.key) for one in drive.given_up]
        if drive.route is not None:
            before = self._routes[robot]
            self.routes.append(Route(robot, second, drive.route))
            self.taken_over += [
                ItemEvent(robot, second, key)
                for key in drive.route
                if key not in before and key.owner != robot and key.owner in self._routes
            ]
            self._routes[robot] = frozenset(drive.route)


class ItemState(NamedTuple):
    """The state of one item."""

    x: float
    """m, map frame."""
    y: float
    state: str
    """A key of `TaskDeclaration.marks`; empty: the item is no longer shown."""
    by: str = ""
    """Robot that is responsible for the state."""
    holders: tuple[str, ...] = ()
    """Robots that intend to do it."""


class ItemChange(NamedTuple):
    """New states of items."""

    second: float
    states: dict[ItemKey, ItemState]


class ItemTable:
    """State of all items of a run over time."""

    def __init__(self) -> None:
        self.states: dict[ItemKey, ItemState] = {}
        """Items that are shown."""
        self._routes: Routes = {}

    def extend(self, run: RunData) -> Iterator[ItemChange]:
        """Add a run or its next part, and yield the changes in order of time, one for each instant."""
        if not self._routes:
            self._routes = initial_routes(run.description)
        changes: list[tuple[float, ItemMark | Route]] = [
            *run.marks,
            *((one.second, one) for one in run.routes),
        ]
        for second, group in groupby(sorted(changes, key=itemgetter(0)), itemgetter(0)):
            changed: dict[ItemKey, ItemState] = {}
            for _, one in group:
                changed |= self._mark(one) if isinstance(one, ItemMark) else self._follow(one)
            if changed:
                yield ItemChange(second, changed)

    def _mark(self, mark: ItemMark) -> dict[ItemKey, ItemState]:
        """Apply a mark; return the changed states."""
        key = mark.key
        holders = tuple(robot for robot, route in self._routes.items() if key in route)
        now = ItemState(mark.x, mark.y, mark.state, mark.by, holders)
        if not mark.state:
            return {} if self.states.pop(key, None) is None else {key: now}
        if self.states.get(key) == now:
            return {}
        self.states[key] = now
        return {key: now}

    def _follow(self, route: Route) -> dict[ItemKey, ItemState]:
        """Apply a route; return the changed states."""
        before, now = self._routes.get(route.robot, frozenset()), frozenset(route.items)
        self._routes[route.robot] = now
        changed = {}
        for key in sorted(now ^ before, key=lambda key: (key.owner, key.number)):
            if (state := self.states.get(key)) is not None:
                holders = tuple(robot for robot, keys in self._routes.items() if key in keys)
                self.states[key] = changed[key] = state._replace(holders=holders)
        return changed


class FirstEvents:
    """First events of each kind about each item, in order of time."""

    def __init__(self) -> None:
        self._known: set[tuple[str, ItemKey]] = set()

    def take(self, events: Iterable[TaskEvent]) -> list[TaskEvent]:
        """Return the events of the next part without repeated ones."""
        found = []
        for one in events:
            if one.key is None or (one.kind, one.key) not in self._known:
                found.append(one)
                if one.key is not None:
                    self._known.add((one.kind, one.key))
        return found
