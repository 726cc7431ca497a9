"""Referee: compares robots' reports of visited places with ground truth."""

from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport, TaskProgress, TaskReports
from actors.task.visits import find_visits
from actors.wording import short_repr


class PlaceVerdict(Enum):
    """Final state of a place; a report overrides giving up, whichever came first."""

    DONE = "done"
    """Reported after a robot had been within reach."""
    CLAIMED = "claimed"
    """Reported, without ground truth; not in simulation."""
    MISTAKEN = "mistaken"
    """Reported before any robot had been within reach."""
    GIVEN_UP = "given up"
    """Given up and never reported."""
    LOST = "lost"
    """Neither, and at the end in no route of a robot with a process."""
    OPEN = "open"
    """Neither, and at the end in the route of a robot with a process."""


class PlaceOutcome(msgspec.Struct, frozen=True):
    """Final state of one place; instants in µs, None = never."""

    owner: str
    place: int
    x: float
    y: float
    reached_at: int | None
    """First true visit."""
    reached_by: str | None
    reported_at: int | None
    """First report of a visit."""
    reported_by: str | None
    given_up_at: int | None
    """First time it was given up; it may have been reported before or after."""
    given_up_by: str | None
    reason: str | None
    """Reason given by `given_up_by`."""
    in_route_of: tuple[str, ...]
    """Robots with a process and with this place in their route at the end, in scenario order."""
    given_at: int = 0
    """When it was given to its owner; 0: at the start."""

    @property
    def verdict(self) -> PlaceVerdict:
        """Final state of the place."""
        if self.reported_at is not None:
            return PlaceVerdict.DONE if self.done else PlaceVerdict.MISTAKEN
        if self.given_up_at is not None:
            return PlaceVerdict.GIVEN_UP
        return PlaceVerdict.OPEN if self.in_route_of else PlaceVerdict.LOST

    @property
    def done(self) -> bool:
        """True if reported after a robot had been within reach."""
        return (
            self.reported_at is not None
            and self.reached_at is not None
            and self.reached_at <= self.reported_at
        )

    @property
    def settled_at(self) -> int | None:
        """First report or giving up, µs; None: neither."""
        instants = [instant for instant in (self.reported_at, self.given_up_at) if instant is not None]
        return min(instants, default=None)


class PlaceOwner(Protocol):
    """A robot with places to visit."""

    @property
    def id(self) -> str:
        """Name of the robot."""

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Places given to the robot, m, map frame."""


class Referee:
    """The task of visiting places, evaluated from true positions and robots' reports."""

    def __init__(self, robots: Sequence[PlaceOwner], reach: float) -> None:
        self._ids = tuple(robot.id for robot in robots)
        self._keys = [PlaceKey(robot.id, index) for robot in robots for index in range(len(robot.places))]
        self._number_of_key = {(key.owner, key.place): number for number, key in enumerate(self._keys)}
        points = [place for robot in robots for place in robot.places]
        self._places: NDArray[np.float64] = np.array(points, dtype=np.float64).reshape(-1, 2)
        self._reach = reach
        self._unreached = np.arange(len(points))
        self._reached: dict[int, tuple[int, str]] = {}
        self._reported: dict[int, tuple[int, str]] = {}
        self._given_up: dict[int, tuple[int, str, str]] = {}
        self._unsettled = set(range(len(points)))
        self._assigned = {
            robot.id: tuple(PlaceKey(robot.id, index) for index in range(len(robot.places)))
            for robot in robots
        }
        self._given_at: dict[int, int] = {}
        self._routes = dict(self._assigned)

    @property
    def settled(self) -> bool:
        """True once every place was reported or given up; False without places."""
        return bool(self._keys) and not self._unsettled

    def has_place(self, place: PlaceKey | PlaceReport | PlaceGivenUp) -> bool:
        """Return whether the place exists."""
        return (place.owner, place.place) in self._number_of_key

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Process the robots' true positions, (n, 2) m, in the order of the set-up."""
        if not self._unreached.size:
            return
        found = find_visits(self._places, self._unreached, positions, self._reach)
        if len(found):
            for number, robot in found.tolist():
                self._reached[number] = (instant, self._ids[robot])
            self._unreached = np.setdiff1d(self._unreached, found[:, 0], assume_unique=True)

    def report(self, robot: str, report: PlaceReport) -> None:
        """Record a robot's report of an existing place; the first report counts."""
        number = self._number_of_key[report.owner, report.place]
        self._reported.setdefault(number, (report.instant, robot))
        self._unsettled.discard(number)

    def give_up(self, robot: str, given_up: PlaceGivenUp) -> None:
        """Record that a robot gives up an existing place; the first time counts."""
        number = self._number_of_key[given_up.owner, given_up.place]
        self._given_up.setdefault(number, (given_up.instant, robot, given_up.reason))
        self._unsettled.discard(number)

    def take(self, robot: str, answer: TaskReports) -> str | None:
        """Process a robot's reports of a step; return an error for an unknown place, else None."""
        for report in answer.reports:
            if not self.has_place(report):
                return _unknown_place("reports", report)
            self.report(robot, report)
        for given_up in answer.given_up:
            if not self.has_place(given_up):
                return _unknown_place("gives up", given_up)
            self.give_up(robot, given_up)
        if answer.route is not None:
            for place in answer.route:
                if not self.has_place(place):
                    return _unknown_place("has in its route", place)
            self._routes[robot] = answer.route
        return None

    def restart(self, robot: str) -> None:
        """Reset the route of a restarted robot to the places that it was given."""
        self._routes[robot] = self._assigned[robot]

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        """Give further places to a robot and append them to its route."""
        first, count = len(self._keys), len(self._assigned[robot])
        keys = tuple(PlaceKey(robot, count + number) for number in range(len(places)))
        self._keys += keys
        numbers = range(first, first + len(keys))
        self._number_of_key |= {
            (key.owner, key.place): number for key, number in zip(keys, numbers, strict=True)
        }
        self._places = np.concatenate([self._places, np.array(places, np.float64).reshape(-1, 2)])
        self._unreached = np.concatenate([self._unreached, np.array(numbers, self._unreached.dtype)])
        self._unsettled.update(numbers)
        self._given_at |= dict.fromkeys(numbers, int(instant))
        self._assigned[robot] += keys
        self._routes[robot] = (*self._routes[robot], *keys)

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Count places in routes of the robots in `present`, and reported places."""
        routes = (self._routes[robot] for robot in present)
        open_places = {(place.owner, place.place) for route in routes for place in route}
        return TaskProgress(len(open_places), len(self._reported))

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        """Return the state of all places under the key `places`."""
        return {"places": self.places(present)}

    def places(self, present: Collection[str]) -> tuple[PlaceOutcome, ...]:
        """Return the current state of every place, in the order of the robots and their lists."""
        return self.outcomes({robot: self._routes[robot] for robot in self._assigned if robot in present})

    def outcomes(self, routes: Mapping[str, Sequence[PlaceKey]]) -> tuple[PlaceOutcome, ...]:
        """Return the final state of every place, in the order of the robots and their lists.

        `routes`: places that each running robot still plans to visit, by its id.
        """
        holders: dict[tuple[str, int], list[str]] = {}
        for robot, route in routes.items():
            for key in route:
                holders.setdefault((key.owner, key.place), []).append(robot)
        owners = {robot: number for number, robot in enumerate(self._ids)}
        ordered = sorted(enumerate(self._keys), key=lambda item: (owners[item[1].owner], item[1].place))
        return tuple(
            self._place_outcome(number, tuple(holders.get((key.owner, key.place), ())))
            for number, key in ordered
        )

    def _place_outcome(self, number: int, in_route_of: tuple[str, ...]) -> PlaceOutcome:
        x, y = (float(value) for value in self._places[number])
        reached_at, reached_by = self._reached.get(number, (None, None))
        reported_at, reported_by = self._reported.get(number, (None, None))
        given_up_at, given_up_by, reason = self._given_up.get(number, (None, None, None))
        return PlaceOutcome(
            owner=self._keys[number].owner,
            place=self._keys[number].place,
            x=x,
            y=y,
            reached_at=reached_at,
            reached_by=reached_by,
            reported_at=reported_at,
            reported_by=reported_by,
            given_up_at=given_up_at,
            given_up_by=given_up_by,
            reason=reason,
            in_route_of=in_route_of,
            given_at=self._given_at.get(number, 0),
        )


def _unknown_place(verb: str, place: PlaceKey | PlaceReport | PlaceGivenUp) -> str:
    return f"{verb} place {place.place} of {short_repr(place.owner)}, which does not exist"
