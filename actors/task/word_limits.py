"""How much a robot may say of its task in one step, and what is wrong with words that are more or none.

Each function gives what is wrong, in words that follow the sender's name, or None if nothing is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from actors.task.words import REASON_LIMIT, PlaceGivenUp, PlaceKey, PlaceReport, TaskWords
from actors.wording import brief


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
            return f"gives {brief(report)} for a report; it should be a PlaceReport"
        if wrong := _instant_fault("reports a place", report.instant, begin, end):
            return wrong
    return None


def _given_up_fault(given_up: Sequence[object], begin: int, end: int, limits: TaskLimits) -> str | None:
    if len(given_up) > limits.given_up:
        return f"gives {len(given_up)} places up in one step; at most {limits.given_up} may be"
    for place in given_up:
        if not isinstance(place, PlaceGivenUp) or not isinstance(place.reason, str):
            return f"gives {brief(place)} up; it should be a PlaceGivenUp with a reason in words"
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
        return f"{what} at {brief(instant)} µs; it should be a whole number"
    if not begin <= instant < end:
        return f"{what} at {instant} µs; it should be from {begin} to {end - 1} µs"
    return None


def _route_fault(route: object, limits: TaskLimits) -> str | None:
    if not isinstance(route, tuple):
        return f"gives {brief(route)} for a route; it should be a tuple of PlaceKey, or None"
    if len(route) > limits.route:
        return f"has a route of {len(route)} places; at most {limits.route} may be"
    seen: set[tuple[str, int]] = set()
    for place in route:
        if not isinstance(place, PlaceKey):
            return f"has {brief(place)} in its route; it should be a PlaceKey"
        if (place.owner, place.place) in seen:
            return (
                f"has place {place.place} of {brief(place.owner)} twice in its route; each may be there once"
            )
        seen.add((place.owner, place.place))
    return None
