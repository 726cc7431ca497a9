"""Robots' reports about places, and the status of all places over time."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from acrc_testbed.run_model.data import PlaceEvent, Points, Route, RunData
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.messages import Drive


class PlaceReports:
    """Accumulated reports of robots about places.

    A robot keeps its last route until it sends a new one; before its first route it has its own places.
    """

    def __init__(self, places: Mapping[str, Points]) -> None:
        """`places`: initial places of each robot."""
        self._routes = {robot: {ItemKey(robot, n) for n in range(len(own))} for robot, own in places.items()}
        self.clear()

    def clear(self) -> None:
        """Clear the lists of events; routes are kept."""
        self.reported: list[PlaceEvent] = []
        self.taken_over: list[PlaceEvent] = []
        self.given_up: list[PlaceEvent] = []
        self.routes: list[Route] = []

    def left_count(self, robot: str) -> int:
        """Return the number of places that a robot intends to visit."""
        return len(self._routes.get(robot, ()))

    def extend(self, robot: str, drive: Drive, second: float) -> None:
        """Add the reports of one step that began at `second`."""
        for visit in drive.reports:
            key = ItemKey(visit.owner, visit.place)
            self.reported.append(PlaceEvent(robot, in_seconds(visit.instant), key))
        for abandoned in drive.given_up:
            key = ItemKey(abandoned.owner, abandoned.place)
            self.given_up.append(PlaceEvent(robot, in_seconds(abandoned.instant), key))
        if drive.route is not None:
            before = self._routes.get(robot, set())
            self.routes.append(Route(robot, second, drive.route))
            self.taken_over += [
                PlaceEvent(robot, second, key)
                for key in drive.route
                if key not in before and key.owner != robot
            ]
            self._routes[robot] = set(drive.route)


def first_reports(events: Sequence[PlaceEvent], known: set[ItemKey]) -> list[PlaceEvent]:
    """Return the first report of each place that is not in `known`, and add these places to it."""
    found = []
    for one in events:
        if one.place not in known:
            known.add(one.place)
            found.append(one)
    return found


class PlaceStatus(NamedTuple):
    """The state of one place."""

    x: float
    """m, map frame."""
    y: float
    done: bool = False
    """Reported as cleaned."""
    given_up: bool = False
    holders: tuple[str, ...] = ()
    """Robots that intend to visit it."""


class PlaceChange(NamedTuple):
    """New states of places."""

    second: float
    states: dict[ItemKey, PlaceStatus]


class _Report(NamedTuple):
    second: float
    kind: str
    """done, given_up or route; also the order at one instant."""
    robot: str
    places: tuple[ItemKey, ...]


class PlaceTable:
    """Status of all places of a run over time.

    A place that was added during the run is listed from the first report about it.
    """

    def __init__(self) -> None:
        self.states: dict[ItemKey, PlaceStatus] = {}
        self._routes: dict[str, frozenset[ItemKey]] = {}

    def extend(self, run: RunData) -> Iterator[PlaceChange]:
        """Add a run or its next part, and yield the changes in order of time."""
        if not self.states:
            own = {
                ItemKey(owner, number): PlaceStatus(x, y, holders=(owner,))
                for owner, points in run.description.own_places.items()
                for number, (x, y) in enumerate(points)
            }
            self.states |= own
            for robot in run.robots:
                self._routes[robot] = frozenset(key for key in own if key.owner == robot)
            yield PlaceChange(0.0, dict(own))
        for report in _reports(run):
            changed = {
                key: state for key in self._affected(report) if (state := self._status(run, key, report))
            }
            changed = {key: state for key, state in changed.items() if state != self.states.get(key)}
            if changed:
                self.states |= changed
                yield PlaceChange(report.second, changed)

    def _affected(self, report: _Report) -> list[ItemKey]:
        if report.kind != "route":
            return list(report.places)
        now = frozenset(report.places)
        before, self._routes[report.robot] = self._routes.get(report.robot, frozenset()), now
        return sorted(now ^ before, key=lambda key: (key.owner, key.place))

    def _status(self, run: RunData, key: ItemKey, report: _Report) -> PlaceStatus | None:
        """Return the state after a report; None for an unknown place."""
        points = run.places.get(key.owner, ())
        if not 0 <= key.place < len(points):
            return None
        state = self.states.get(key) or PlaceStatus(*points[key.place], holders=(key.owner,))
        if report.kind == "done":
            return state._replace(done=True)
        if report.kind == "given_up":
            return state._replace(given_up=True)
        return state._replace(holders=tuple(one for one in run.robots if key in self._routes.get(one, ())))


def _reports(run: RunData) -> list[_Report]:
    """Return all reports in order of time; at one instant, visits come before routes."""
    found = [_Report(one.second, "done", one.robot, (one.place,)) for one in run.reported]
    found += [_Report(one.second, "given_up", one.robot, (one.place,)) for one in run.given_up]
    found += [_Report(one.second, "route", one.robot, one.places) for one in run.routes]
    return sorted(found, key=lambda one: (one.second, one.kind))
