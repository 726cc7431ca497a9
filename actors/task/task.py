"""Interface between the world and the robots' task; implement `Task` for another model problem."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.topic import MessagePart
from actors.wording import short_repr

REASON_LIMIT: Final = 100
"""Maximum length of the reason for giving up a place, characters."""


class PlaceKey(MessagePart, frozen=True):
    """Identifier of a place to visit."""

    owner: str
    """Robot to which the place was given."""
    place: int
    """Index in the owner's list; places given during the run are appended."""


class PlaceReport(MessagePart, frozen=True):
    """A robot's report that it visited a place."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int


class PlaceGivenUp(MessagePart, frozen=True):
    """A robot's report that a place should not be tried again."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int
    reason: str
    """Text for readers, at most REASON_LIMIT characters."""


class TaskReports(Protocol):
    """A robot's task reports of one step; part of `Decision` and `Drive`."""

    @property
    def reports(self) -> tuple[PlaceReport, ...]:
        """Places reported as visited."""

    @property
    def given_up(self) -> tuple[PlaceGivenUp, ...]:
        """Places given up."""

    @property
    def route(self) -> tuple[PlaceKey, ...] | None:
        """Places that it still plans to visit; None: unchanged."""


class Metric(NamedTuple):
    """A quantity of a run by which strategies are compared."""

    name: str
    description: str
    unit: str
    column: str
    """Column with its value in the table of results; names of nested values are joined by a dot."""
    better: Literal["more", "less"] = "more"
    event: str = ""
    """For a time that is censored at the end of the run: state of the run after the event. Empty: not
    censored."""
    rank: int | None = None
    """Position in the order in which metrics decide a comparison; None: not in it."""
    worst: float | None = None
    """Value of a failed run; None: unknown, or the worst possible time of an event."""
    margin: float | None = None
    """Equivalence margin of the mean; None: equivalence is not tested."""


class TaskProgress(NamedTuple):
    """Progress of a task, for display."""

    left: int
    """Items that running robots still plan to do."""
    done: int
    """Items reported as done."""


class Task(Protocol):
    """Task of a run's robots, evaluated from ground truth and the robots' reports.

    The world passes it the true positions and reports of every step, in a fixed order. It must be a function
    of these: no clock, no randomness. An exception ends the run.
    """

    @property
    def settled(self) -> bool:
        """True once the task is finished, which ends the run; False for an empty task."""

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Process the robots' true positions, (n, 2) m, in the order of the set-up."""

    def take(self, robot: str, answer: TaskReports) -> str | None:
        """Process a robot's reports of a step, whose form has been checked (`task_reports_fault`).

        Return an error that continues the robot's name, such as for an unknown place; None if valid.
        """

    def restart(self, robot: str) -> None:
        """Process the restart of a robot, which loses its state except the places given to it."""

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        """Give further places, m, to a robot during the run."""

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Return the progress; `present`: robots with a process."""

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        """Return the results by subject, for the final record; `present`: robots with a process."""


@dataclass(frozen=True)
class TaskLimits:
    """Limits of a robot's task reports in one step; own choices, far above what a strategy needs."""

    reports: int = 1000
    """Places reported as visited."""
    given_up: int = 1000
    """Places given up; the scenario file's limit of places per robot."""
    route: int = 10_000
    """Places in a route: its own and adopted ones."""


def task_reports_fault(answer: TaskReports, begin: int, end: int, limits: TaskLimits) -> str | None:
    """Return the first fault of the task reports of the step from `begin` to `end`, µs; None if valid."""
    if answer.reports and (fault := _reports_fault(answer.reports, begin, end, limits)):
        return fault
    if answer.given_up and (fault := _given_up_fault(answer.given_up, begin, end, limits)):
        return fault
    return None if answer.route is None else _route_fault(answer.route, limits)


def _reports_fault(reports: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(reports) > limits.reports:
        return f"reports {len(reports)} places in one step; the limit is {limits.reports}"
    for report in reports:
        if not isinstance(report, PlaceReport):
            return f"reports {short_repr(report)}; must be a PlaceReport"
        if fault := _instant_fault("reports a place", report.instant, begin, end):
            return fault
    return None


def _given_up_fault(given_up: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(given_up) > limits.given_up:
        return f"gives up {len(given_up)} places in one step; the limit is {limits.given_up}"
    for place in given_up:
        if not isinstance(place, PlaceGivenUp) or not isinstance(place.reason, str):
            return f"gives up {short_repr(place)}; must be a PlaceGivenUp with a text as reason"
        if not 0 < len(place.reason) <= REASON_LIMIT:
            return (
                f"gives up a place for a reason of {len(place.reason)} characters; "
                f"must have 1 to {REASON_LIMIT}"
            )
        if fault := _instant_fault("gives up a place", place.instant, begin, end):
            return fault
    return None


def _instant_fault(action: str, instant: object, begin: int, end: int) -> str | None:
    if type(instant) is not int:
        return f"{action} at {short_repr(instant)} µs; must be a whole number"
    if not begin <= instant < end:
        return f"{action} at {instant} µs; must be from {begin} to {end - 1} µs"
    return None


def _route_fault(route: object, limits: TaskLimits) -> str | None:
    if not isinstance(route, tuple):
        return f"has the route {short_repr(route)}; must be a tuple of PlaceKey, or None"
    if len(route) > limits.route:
        return f"has a route of {len(route)} places; the limit is {limits.route}"
    seen: set[tuple[str, int]] = set()
    for place in route:
        if not isinstance(place, PlaceKey):
            return f"has {short_repr(place)} in its route; must be a PlaceKey"
        if (place.owner, place.place) in seen:
            return f"has place {place.place} of {short_repr(place.owner)} twice in its route; must be unique"
        seen.add((place.owner, place.place))
    return None
