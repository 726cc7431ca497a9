"""What the adaptation layer of a robot's component has decided, and when it held the robot to be blocked.

For measuring alone: it goes into the robot's last record and takes no part in what the robot does.
"""

import math
from collections.abc import Container
from dataclasses import dataclass
from typing import Annotated, Any, Final, Protocol, Self, runtime_checkable

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.message_limits import MessageLimits, frames_fault
from actors.robot.behaviour.ports import FARTHEST_BACK, Decision, GoalOrder
from actors.runtime.typed_json import Count, Counts, Listed, Metres, Name, Text
from actors.task.task import words_fault
from deeco import Knowledge
from deeco.component import processes_of
from deeco.local import Commit


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


_KEPT: Final = 1000
"""Decisions, and intervals of being blocked, listed one by one; later ones are counted only."""


class AdaptationDecision(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One decision of a robot's adaptation; instants and ages in µs."""

    instant: Count
    by: Name
    words: Text
    source: Name
    """Robot whose knowledge it is based on."""
    age: Count
    """Of that knowledge."""
    old: tuple[Metres, Metres] | None
    """Target before, m, map frame ..."""
    new: tuple[Metres, Metres] | None
    """... and after."""


class AdaptationReport(msgspec.Struct, forbid_unknown_fields=True):
    """All decisions of a robot's adaptation."""

    decisions: Listed[AdaptationDecision] = []
    decisions_unlisted: Count = 0
    blocked: Listed[tuple[Count, Count | None]] | None = None
    """Intervals in which the robot considered itself blocked, µs; None if its component never asks."""


_Bound = Annotated[int, msgspec.Meta(gt=0, le=1 << 53)]


class NodeReport(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of one robot's deeco node (`deeco.statistics.Statistics`) and of its radio link."""

    counters: Counts
    exchanges: Counts
    """By ensemble: exchanges that changed the local knowledge."""
    replica_age_ms: Annotated[dict[_Bound, Count], msgspec.Meta(max_length=10_000)]
    """Age of each replica at each own publication: count by the bin's upper bound, ms."""


@runtime_checkable
class Deciding(Protocol):
    """A component whose decisions can be told."""

    @property
    def target(self) -> Point | None:
        """Where it wants to be, m, map frame."""

    def decided_since(self, before: Self) -> str:
        """What it has decided since it was `before`, in words; empty if nothing."""


class DecisionLog:
    """Log of the decisions of one component and of its state `blocked`, one entry per commit."""

    def __init__(self, component: Knowledge, former: "DecisionLog | None" = None) -> None:
        """`former`: the log of the robot's component before this one; its lists go on here."""
        kind = type(component)
        adapts = any(process.adaptation for process in processes_of(kind))
        self._decides = isinstance(component, Deciding)
        self._diagnoses = adapts and callable(getattr(kind, "is_blocked", None))
        self._report: AdaptationReport = AdaptationReport() if former is None else former._report
        self._blocked: list[tuple[int, int | None]] = [] if former is None else former._blocked
        self._is_blocked: bool = former is not None and former._is_blocked

    def take(self, commit: Commit) -> None:
        """A change of the component's knowledge."""
        before: Any = commit.before
        after: Any = commit.after
        if self._diagnoses:
            self._diagnose(after.is_blocked(), commit.instant)
        if not (self._decides and commit.adaptation):
            return
        if words := after.decided_since(before):
            self._decide(commit, words, before.target, after.target)

    def report(self) -> AdaptationReport:
        """Return the decisions so far, for the run's result."""
        blocked = self._blocked if self._diagnoses or self._blocked else None
        return msgspec.structs.replace(self._report, blocked=blocked)

    def _decide(self, commit: Commit, words: str, old: Point | None, new: Point | None) -> None:
        report = self._report
        if len(report.decisions) == _KEPT:
            report.decisions_unlisted += 1
            return
        heard = commit.instant if commit.heard is None else commit.heard
        source, age = commit.peer or commit.after.id, commit.instant - heard
        report.decisions.append(AdaptationDecision(commit.instant, commit.by, words, source, age, old, new))

    def _diagnose(self, is_blocked: bool, now: Instant) -> None:
        """Intervals up to _KEPT; the last one kept stays open no longer than it was."""
        if is_blocked is self._is_blocked:
            return
        self._is_blocked = is_blocked
        if not is_blocked:
            if self._blocked and self._blocked[-1][1] is None:
                self._blocked[-1] = (self._blocked[-1][0], now)
        elif len(self._blocked) < _KEPT:
            self._blocked.append((now, None))
