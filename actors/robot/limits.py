"""What a behaviour may ask of its robot, and what is wrong with a decision that asks for more."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from actors.geometry import Point
from actors.instant import Instant
from actors.messages import FRAME_DATA_LIMIT, Outgoing, PlaceReport
from actors.robot.ports import Decision, GoalOrder

_TAGS: Final = 2**32


@dataclass(frozen=True)
class RobotLimits:
    """How much a behaviour may ask for in one step; own choices, far above what a strategy needs."""

    frames: int = 32
    """Frames to be sent; at 250 kbit/s a step of 0.1 s has air time for about as many of 80 bytes."""
    reports: int = 1000
    """Places reported as visited."""


def fault(decision: object, begin: Instant, end: Instant, limits: RobotLimits) -> str | None:
    """What is wrong with a behaviour's decision for the step from `begin` to `end`; None if nothing is."""
    if not isinstance(decision, Decision):
        return f"gives a {type(decision).__name__} where a Decision is due"
    if not isinstance(decision.tasks_left, int) or decision.tasks_left < 0:
        return f"gives {decision.tasks_left!r} for tasks_left; it should be a whole number from 0 on"
    if not isinstance(decision.goal, GoalOrder) and not _is_point(decision.goal):
        return f"gives {decision.goal!r} for a goal; it should be a Point of finite numbers or a GoalOrder"
    if decision.reports and (wrong := _reports_fault(decision.reports, limits)):
        return wrong
    return _frames_fault(decision.frames, begin, end, limits) if decision.frames else None


def _is_point(goal: object) -> bool:
    return isinstance(goal, Point) and math.isfinite(goal.x) and math.isfinite(goal.y)


def _reports_fault(reports: Sequence[object], limits: RobotLimits) -> str | None:
    if len(reports) > limits.reports:
        return f"reports {len(reports)} places in one step; at most {limits.reports} may be"
    wrong = [report for report in reports if not isinstance(report, PlaceReport)]
    return f"gives {wrong[0]!r} for a report; it should be a PlaceReport" if wrong else None


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
