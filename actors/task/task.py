"""The seam between a world and what its robots are to do: another model problem brings another of these."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.topic import MessagePart
from actors.wording import short_repr

REASON_LIMIT: Final = 100
"""Characters of the reason for which a place is given up."""


class PlaceKey(MessagePart, frozen=True):
    """Names a place to be cleaned."""

    owner: str
    """The robot that the place was given to."""
    place: int
    """Its index in the owner's list, which grows where places come while the run goes on."""


class PlaceReport(MessagePart, frozen=True):
    """The robot holds that it has visited a place to be cleaned."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int


class PlaceGivenUp(MessagePart, frozen=True):
    """The robot holds that nobody should try for a place any more."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int
    reason: str
    """For people; at most REASON_LIMIT characters."""


class TaskWords(Protocol):
    """What a robot says of its task in one step: part of a Drive, and of the decision that it comes from."""

    @property
    def reports(self) -> tuple[PlaceReport, ...]:
        """Places reported as visited."""

    @property
    def given_up(self) -> tuple[PlaceGivenUp, ...]:
        """Places given up."""

    @property
    def route(self) -> tuple[PlaceKey, ...] | None:
        """Where it still means to go; None: as it last said."""


class TaskProgress(NamedTuple):
    """How far a task is, for people who watch the run."""

    left: int
    """What robots that take part still mean to do."""
    done: int
    """What robots have said to have done."""


class Task(Protocol):
    """What the robots of a run are to do, followed and judged from ground truth and from their own words.

    The world shows it every step's true positions and every word, in one order for all processors; it must be
    a function of these: no clock, no randomness. What it raises ends the run.
    """

    @property
    def settled(self) -> bool:
        """True once nothing is left to be done, which ends the run; never where nothing was asked."""

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Take in the robots' true positions, (n, 2) m, in the order of the set-up."""

    def take(self, robot: str, words: TaskWords) -> str | None:
        """Take in what a robot says in a step, whose form has been checked (`word_limits`).

        What cannot be true, such as a place that there is not, is told in words that follow the robot's name;
        None if nothing is.
        """

    def restart(self, robot: str) -> None:
        """Take in that a robot's process has begun anew, and knows of nothing but what it was given."""

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        """Take in that a robot is given further places, m, while the run goes on."""

    def progress(self, present: Collection[str]) -> TaskProgress:
        """How far it is; `present`: the robots that take part."""

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        """What it comes to, by subject, for the last record; `present`: the robots that take part."""


@dataclass(frozen=True)
class TaskLimits:
    """How much a robot may say of places in one step; own choices, far above what a strategy needs."""

    reports: int = 1000
    """Places reported as visited."""
    given_up: int = 1000
    """Places given up; no robot is given more places (as a scenario file allows)."""
    route: int = 10_000
    """Places that a robot still means to visit: its own, and those that it takes over from others."""


def words_fault(words: TaskWords, begin: int, end: int, limits: TaskLimits) -> str | None:
    """What is wrong with what is said about places in the step from `begin` to `end`, µs."""
    if words.reports and (wrong := _reports_fault(words.reports, begin, end, limits)):
        return wrong
    if words.given_up and (wrong := _given_up_fault(words.given_up, begin, end, limits)):
        return wrong
    return None if words.route is None else _route_fault(words.route, limits)


def _reports_fault(reports: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(reports) > limits.reports:
        return f"reports {len(reports)} places in one step; at most {limits.reports} may be"
    for report in reports:
        if not isinstance(report, PlaceReport):
            return f"gives {short_repr(report)} for a report; it should be a PlaceReport"
        if wrong := _instant_fault("reports a place", report.instant, begin, end):
            return wrong
    return None


def _given_up_fault(given_up: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(given_up) > limits.given_up:
        return f"gives {len(given_up)} places up in one step; at most {limits.given_up} may be"
    for place in given_up:
        if not isinstance(place, PlaceGivenUp) or not isinstance(place.reason, str):
            return f"gives {short_repr(place)} up; it should be a PlaceGivenUp with a reason in words"
        if not 0 < len(place.reason) <= REASON_LIMIT:
            return (
                f"gives a place up for a reason of {len(place.reason)} characters; "
                f"it should have 1 to {REASON_LIMIT}"
            )
        if wrong := _instant_fault("gives a place up", place.instant, begin, end):
            return wrong
    return None


def _instant_fault(what: str, instant: object, begin: int, end: int) -> str | None:
    if type(instant) is not int:
        return f"{what} at {short_repr(instant)} µs; it should be a whole number"
    if not begin <= instant < end:
        return f"{what} at {instant} µs; it should be from {begin} to {end - 1} µs"
    return None


def _route_fault(route: object, limits: TaskLimits) -> str | None:
    if not isinstance(route, tuple):
        return f"gives {short_repr(route)} for a route; it should be a tuple of PlaceKey, or None"
    if len(route) > limits.route:
        return f"has a route of {len(route)} places; at most {limits.route} may be"
    seen: set[tuple[str, int]] = set()
    for place in route:
        if not isinstance(place, PlaceKey):
            return f"has {short_repr(place)} in its route; it should be a PlaceKey"
        if (place.owner, place.place) in seen:
            return f"has place {place.place} of {short_repr(place.owner)} twice in its route"
        seen.add((place.owner, place.place))
    return None
