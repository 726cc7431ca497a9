"""Judges, from ground truth, which places were really visited, and keeps who claimed what and when."""

from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport, TaskProgress, TaskWords
from actors.task.visits import visitors
from actors.wording import short_repr


class Verdict(Enum):
    """What has become of a place, in one word; a report counts more than giving up, whichever came first."""

    DONE = "done"
    """Reported, and true: some robot had been there by then."""
    CLAIMED = "claimed"
    """Reported, where nobody watched whether it is true: not in simulation."""
    MISTAKEN = "mistaken"
    """Reported, but nobody had been there by then."""
    GIVEN_UP = "given up"
    """Given up, and never reported."""
    LOST = "lost"
    """Neither, and no robot that takes part at the end means to visit it."""
    OPEN = "open"
    """Neither, and in the route of a robot that takes part at the end."""


class PlaceOutcome(msgspec.Struct, frozen=True):
    """What became of one place; instants in µs, None = never."""

    owner: str
    place: int
    x: float
    y: float
    reached_at: int | None
    """When ground truth first came within reach."""
    reached_by: str | None
    reported_at: int | None
    """When a robot first reported it."""
    reported_by: str | None
    given_up_at: int | None
    """When a robot first gave it up; some robot may have reported it all the same, before or after."""
    given_up_by: str | None
    reason: str | None
    """Why it was given up, in the words of `given_up_by`."""
    in_route_of: tuple[str, ...]
    """The robots with a process whose route holds it at the end, in the order of the scenario."""
    given_at: int = 0
    """When it was given to its owner: 0 at the start, else while the run went on."""

    @property
    def verdict(self) -> Verdict:
        """What has become of it, in one word."""
        if self.reported_at is not None:
            return Verdict.DONE if self.done else Verdict.MISTAKEN
        if self.given_up_at is not None:
            return Verdict.GIVEN_UP
        return Verdict.OPEN if self.in_route_of else Verdict.LOST

    @property
    def done(self) -> bool:
        """Reported, and true: some robot had been there by then."""
        return (
            self.reported_at is not None
            and self.reached_at is not None
            and self.reached_at <= self.reported_at
        )

    @property
    def settled_at(self) -> int | None:
        """When it was first reported or given up, whichever came first."""
        instants = [instant for instant in (self.reported_at, self.given_up_at) if instant is not None]
        return min(instants, default=None)


class Owner(Protocol):
    """A robot, as far as its places go."""

    @property
    def id(self) -> str:
        """Its name."""

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The places that it was given, m, map frame."""


class Referee:
    """The task of visiting places: watches true positions, and every word on what has come of a place."""

    def __init__(self, robots: Sequence[Owner], reach: float) -> None:
        self._ids = tuple(robot.id for robot in robots)
        self._keys = [PlaceKey(robot.id, index) for robot in robots for index in range(len(robot.places))]
        self._numbers = {(key.owner, key.place): number for number, key in enumerate(self._keys)}
        flat = [place for robot in robots for place in robot.places]
        self._places: NDArray[np.float64] = np.array(flat, dtype=np.float64).reshape(-1, 2)
        self._reach = reach
        self._open = np.arange(len(flat))
        self._reached: dict[int, tuple[int, str]] = {}
        self._reported: dict[int, tuple[int, str]] = {}
        self._given_up: dict[int, tuple[int, str, str]] = {}
        self._unsettled = set(range(len(flat)))
        self._given = {
            robot.id: tuple(PlaceKey(robot.id, index) for index in range(len(robot.places)))
            for robot in robots
        }
        self._given_at: dict[int, int] = {}
        self._routes = dict(self._given)

    @property
    def settled(self) -> bool:
        """True once every place has been reported or given up; never if there is none."""
        return bool(self._keys) and not self._unsettled

    def knows(self, place: PlaceKey | PlaceReport | PlaceGivenUp) -> bool:
        """True if there is such a place."""
        return (place.owner, place.place) in self._numbers

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Take in the robots' true positions, (n, 2) m, in the order of the set-up."""
        if not self._open.size:
            return
        found = visitors(self._places, self._open, positions, self._reach)
        if len(found):
            for number, robot in found.tolist():
                self._reached[number] = (instant, self._ids[robot])
            self._open = np.setdiff1d(self._open, found[:, 0], assume_unique=True)

    def report(self, robot: str, report: PlaceReport) -> None:
        """Take in a robot's report of a place that there is; the first of a place counts."""
        number = self._numbers[report.owner, report.place]
        self._reported.setdefault(number, (report.instant, robot))
        self._unsettled.discard(number)

    def give_up(self, robot: str, given_up: PlaceGivenUp) -> None:
        """Take in that a robot gives up a place that there is; the first word on a place counts."""
        number = self._numbers[given_up.owner, given_up.place]
        self._given_up.setdefault(number, (given_up.instant, robot, given_up.reason))
        self._unsettled.discard(number)

    def take(self, robot: str, words: TaskWords) -> str | None:
        """Take in what a robot says in a step; what it says of a place that there is not, in words."""
        for report in words.reports:
            if not self.knows(report):
                return _unknown("reports", report)
            self.report(robot, report)
        for given_up in words.given_up:
            if not self.knows(given_up):
                return _unknown("gives up", given_up)
            self.give_up(robot, given_up)
        if words.route is not None:
            for place in words.route:
                if not self.knows(place):
                    return _unknown("has in its route", place)
            self._routes[robot] = words.route
        return None

    def restart(self, robot: str) -> None:
        """A robot's process has begun anew: it means to visit the places that it was given."""
        self._routes[robot] = self._given[robot]

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        """A robot is given further places; they count from now on, and it is taken to mean to visit them."""
        first, own = len(self._keys), len(self._given[robot])
        keys = tuple(PlaceKey(robot, own + number) for number in range(len(places)))
        self._keys += keys
        numbers = range(first, first + len(keys))
        self._numbers |= {(key.owner, key.place): number for key, number in zip(keys, numbers, strict=True)}
        self._places = np.concatenate([self._places, np.array(places, np.float64).reshape(-1, 2)])
        self._open = np.concatenate([self._open, np.array(numbers, self._open.dtype)])
        self._unsettled.update(numbers)
        self._given_at |= dict.fromkeys(numbers, int(instant))
        self._given[robot] += keys
        self._routes[robot] = (*self._routes[robot], *keys)

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Places in the routes of those who take part, and places that have been reported."""
        routes = (self._routes[robot] for robot in present)
        left = {(place.owner, place.place) for route in routes for place in route}
        return TaskProgress(len(left), len(self._reported))

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        """`places`: what has become of every place."""
        return {"places": self.places(present)}

    def places(self, present: Collection[str]) -> tuple[PlaceOutcome, ...]:
        """What has become of every place so far, in the order of the robots and of their lists."""
        return self.outcomes({robot: self._routes[robot] for robot in self._given if robot in present})

    def outcomes(self, routes: Mapping[str, Sequence[PlaceKey]]) -> tuple[PlaceOutcome, ...]:
        """What became of every place, in the order of the robots and of their lists.

        `routes`: where each robot that takes part still means to go, by its id.
        """
        holders: dict[tuple[str, int], list[str]] = {}
        for robot, route in routes.items():
            for key in route:
                holders.setdefault((key.owner, key.place), []).append(robot)
        owners = {robot: number for number, robot in enumerate(self._ids)}
        ordered = sorted(enumerate(self._keys), key=lambda item: (owners[item[1].owner], item[1].place))
        return tuple(
            self._outcome(number, tuple(holders.get((key.owner, key.place), ()))) for number, key in ordered
        )

    def _outcome(self, number: int, in_route_of: tuple[str, ...]) -> PlaceOutcome:
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


def _unknown(verb: str, place: PlaceKey | PlaceReport | PlaceGivenUp) -> str:
    return f"{verb} place {place.place} of {short_repr(place.owner)}, which nobody was given"
