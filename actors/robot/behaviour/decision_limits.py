"""What a behaviour may ask of its robot, and what is wrong with a decision that asks for more."""

import math
from collections.abc import Container
from dataclasses import dataclass

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.message_limits import MessageLimits, frames_fault
from actors.robot.behaviour.goal import GoalOrder
from actors.robot.behaviour.ports import FARTHEST_BACK, Decision
from actors.task.word_limits import words_fault


@dataclass(frozen=True)
class RobotLimits(MessageLimits):
    """How much a behaviour may ask for in one step: what a message may hold, and what stays on the robot."""

    peers: int = 1000
    """Other robots whose echoes are disregarded; more than a swarm has."""


def fault(decision: object, begin: Instant, end: Instant, limits: RobotLimits) -> str | None:
    """What is wrong with a behaviour's decision for the step from `begin` to `end`; None if nothing is."""
    if type(decision) is not Decision and not isinstance(decision, Decision):
        return f"gives a {type(decision).__name__} where a Decision is due"
    goal = decision.goal
    if goal is not GoalOrder.KEEP and not isinstance(goal, GoalOrder) and not _is_point(goal):
        return f"gives {decision.goal!r} for a goal; it should be a Point of finite numbers or a GoalOrder"
    if decision.paused not in (None, True, False):
        return f"gives {decision.paused!r} for paused; it should be True, False or None"
    if decision.back_out is not None and not _is_distance(decision.back_out):
        return (
            f"gives {decision.back_out!r} for back_out; it should be above 0 and at most {FARTHEST_BACK:g} m"
        )
    if decision.relocalise not in (True, False):
        return f"gives {decision.relocalise!r} for relocalise; it should be True or False"
    wrong = None
    if decision.reports or decision.given_up or decision.route is not None:
        wrong = words_fault(decision, begin, end, limits)
    if wrong is None and decision.peers:
        wrong = _peers_fault(decision.peers, limits)
    if wrong is None and decision.frames:
        wrong = frames_fault(decision.frames, begin, end, limits)
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


def _is_point(goal: object) -> bool:
    return isinstance(goal, Point) and math.isfinite(goal.x) and math.isfinite(goal.y)


def _is_distance(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= FARTHEST_BACK


def _peers_fault(peers: object, limits: RobotLimits) -> str | None:
    if not isinstance(peers, tuple):
        return f"gives {peers!r} for peers; it should be a tuple of Points, or None"
    if len(peers) > limits.peers:
        return f"gives {len(peers)} peers; at most {limits.peers} may be"
    for peer in peers:
        if not _is_point(peer):
            return f"has {peer!r} among its peers; it should be a Point of finite numbers"
    return None
