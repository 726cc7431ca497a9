"""What a behaviour may ask of its robot, and what is wrong with a decision that asks for more."""

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.messages import (
    FRAME_DATA_LIMIT,
    REASON_LIMIT,
    Outgoing,
    PlaceGivenUp,
    PlaceKey,
    PlaceReport,
)  # fmt: skip
from actors.robot.ports import Decision, GoalOrder

_TAGS: Final = 2**63


@dataclass(frozen=True)
class RobotLimits:
    """How much a behaviour may ask for in one step; own choices, far above what a strategy needs.

    What it says about places must also fit one message (actors.runtime.codec.MESSAGE_LIMIT).
    """

    frames: int = 32
    """Frames to be sent; at 250 kbit/s a step of 0.1 s has air time for about as many of 80 bytes."""
    reports: int = 1000
    """Places reported as visited."""
    given_up: int = 1000
    """Places given up; no robot is given more places (as a scenario file allows)."""
    route: int = 10_000
    """Places that a robot still means to visit: its own, and those that it takes over from others."""
    peers: int = 1000
    """Other robots whose echoes are disregarded; more than a swarm has."""


def fault(decision: object, begin: Instant, end: Instant, limits: RobotLimits) -> str | None:
    """What is wrong with a behaviour's decision for the step from `begin` to `end`; None if nothing is."""
    if not isinstance(decision, Decision):
        return f"gives a {type(decision).__name__} where a Decision is due"
    if not isinstance(decision.goal, GoalOrder) and not _is_point(decision.goal):
        return f"gives {decision.goal!r} for a goal; it should be a Point of finite numbers or a GoalOrder"
    if decision.paused not in (None, True, False):
        return f"gives {decision.paused!r} for paused; it should be True, False or None"
    wrong = _word_fault(decision, begin, end, limits)
    if wrong is None and decision.peers:
        wrong = _peers_fault(decision.peers, limits)
    if wrong is None and decision.frames:
        wrong = _frames_fault(decision.frames, begin, end, limits)
    return wrong


def outcome_fault(outcome: object, taken: Container[str]) -> str | None:
    """What is wrong with what a behaviour has to say about its run; None if nothing is.

    `taken`: subjects that the robot itself speaks about.
    """
    if not isinstance(outcome, dict) or not all(isinstance(subject, str) for subject in outcome):
        return f"gives {outcome!r} for its outcome; it should be a dict by subject"
    for subject, value in outcome.items():
        if subject in taken:
            return f"has an outcome under {subject!r}, where the robot's own stands"
        try:
            msgspec.json.encode(value)
        except (TypeError, ValueError) as error:
            return f"has an outcome that is no JSON, under {subject!r}: {error}"
    return None


def _word_fault(decision: Decision, begin: Instant, end: Instant, limits: RobotLimits) -> str | None:
    """What is wrong with what is said about places."""
    if decision.reports and (wrong := _reports_fault(decision.reports, begin, end, limits)):
        return wrong
    if decision.given_up and (wrong := _given_up_fault(decision.given_up, begin, end, limits)):
        return wrong
    return None if decision.route is None else _route_fault(decision.route, limits)


def _is_point(goal: object) -> bool:
    return isinstance(goal, Point) and math.isfinite(goal.x) and math.isfinite(goal.y)


def _reports_fault(
    reports: Sequence[object], begin: Instant, end: Instant, limits: RobotLimits
) -> str | None:
    if len(reports) > limits.reports:
        return f"reports {len(reports)} places in one step; at most {limits.reports} may be"
    for report in reports:
        if not isinstance(report, PlaceReport):
            return f"gives {report!r} for a report; it should be a PlaceReport"
        if not begin <= report.instant < end:
            return _elsewhen("reports a place", report.instant, begin, end)
    return None


def _given_up_fault(
    given_up: Sequence[object], begin: Instant, end: Instant, limits: RobotLimits
) -> str | None:
    if len(given_up) > limits.given_up:
        return f"gives {len(given_up)} places up in one step; at most {limits.given_up} may be"
    for place in given_up:
        if not isinstance(place, PlaceGivenUp) or not isinstance(place.reason, str):
            return f"gives {place!r} up; it should be a PlaceGivenUp with a reason in words"
        if not 0 < len(place.reason) <= REASON_LIMIT:
            return (
                f"gives a place up for a reason of {len(place.reason)} characters; "
                f"it should have 1 to {REASON_LIMIT}"
            )
        if not begin <= place.instant < end:
            return _elsewhen("gives a place up", place.instant, begin, end)
    return None


def _elsewhen(what: str, instant: int, begin: Instant, end: Instant) -> str:
    return f"{what} at {instant} µs; it should be from {begin} to {end - 1} µs"


def _route_fault(route: object, limits: RobotLimits) -> str | None:
    if not isinstance(route, tuple):
        return f"gives {route!r} for a route; it should be a tuple of PlaceKey, or None"
    if len(route) > limits.route:
        return f"has a route of {len(route)} places; at most {limits.route} may be"
    seen: set[tuple[str, int]] = set()
    for place in route:
        if not isinstance(place, PlaceKey):
            return f"has {place!r} in its route; it should be a PlaceKey"
        if (place.owner, place.place) in seen:
            return f"has place {place.place} of {place.owner!r} twice in its route; each may be there once"
        seen.add((place.owner, place.place))
    return None


def _peers_fault(peers: object, limits: RobotLimits) -> str | None:
    if not isinstance(peers, tuple):
        return f"gives {peers!r} for peers; it should be a tuple of Points, or None"
    if len(peers) > limits.peers:
        return f"gives {len(peers)} peers; at most {limits.peers} may be"
    for peer in peers:
        if not _is_point(peer):
            return f"has {peer!r} among its peers; it should be a Point of finite numbers"
    return None


def _frames_fault(
    frames: Sequence[Outgoing], begin: Instant, end: Instant, limits: RobotLimits
) -> str | None:
    if len(frames) > limits.frames:
        return f"sends {len(frames)} frames in one step; at most {limits.frames} may be"
    earliest = begin
    for frame in frames:
        if wrong := _frame_fault(frame, earliest, end):
            return wrong
        earliest = Instant(frame.instant)
    return None


def _frame_fault(frame: object, earliest: Instant, end: Instant) -> str | None:
    if not isinstance(frame, Outgoing) or not isinstance(frame.data, bytes):
        return f"sends {frame!r}; it should be an Outgoing with bytes"
    if not 0 < len(frame.data) <= FRAME_DATA_LIMIT:
        return f"sends a frame of {len(frame.data)} bytes; it should have 1 to {FRAME_DATA_LIMIT}"
    if not earliest <= frame.instant < end:
        return f"sends a frame at {frame.instant} µs; it should be sent from {earliest} to {end - 1} µs"
    if not 0 <= frame.tag < _TAGS:
        return f"sends a frame with the tag {frame.tag}; it should be 0 to {_TAGS - 1}"
    return None
