"""Validation of a behaviour's decisions, and the log of adaptation decisions for results.

The log is written to the robot's last record and does not influence the robot.
"""

import math
from collections.abc import Container
from typing import Annotated, Any, Final, Protocol, Self, runtime_checkable

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.items import task_reports_fault
from actors.message_limits import MessageLimits, frames_fault
from actors.robot.behaviour.ports import MAX_BACK_OUT, Decision, GoalOrder
from actors.runtime.typed_json import BoundedList, Count, Counts, Metres, Name, Text
from deeco import Knowledge
from deeco.component import processes_of
from deeco.local import Commit


class RobotLimits(MessageLimits, frozen=True):
    """Limits of a decision: those of messages and those of data that stays on the robot."""

    peers: int = 1000
    """Robots in Decision.peers; more than any swarm has."""


def fault(decision: object, begin: Instant, end: Instant, limits: RobotLimits) -> str | None:
    """Return the fault of a decision for the step from `begin` to `end`; None if it is valid."""
    if type(decision) is not Decision and not isinstance(decision, Decision):
        return f"returned a {type(decision).__name__} instead of a Decision"
    goal = decision.goal
    if goal is not GoalOrder.KEEP and not isinstance(goal, GoalOrder) and not _is_point(goal):
        return f"returned goal={decision.goal!r}; it should be a Point of finite numbers or a GoalOrder"
    if decision.paused not in (None, True, False):
        return f"returned paused={decision.paused!r}; it should be True, False or None"
    if decision.back_out is not None and not _is_distance(decision.back_out):
        return f"returned back_out={decision.back_out!r}; it should be above 0 and at most {MAX_BACK_OUT:g} m"
    if decision.relocalise not in (True, False):
        return f"returned relocalise={decision.relocalise!r}; it should be True or False"
    wrong = None
    if decision.reports or decision.given_up or decision.route is not None:
        wrong = task_reports_fault(decision, begin, end, limits)
    if wrong is None and decision.peers:
        wrong = _peers_fault(decision.peers, limits)
    if wrong is None and decision.frames:
        wrong = frames_fault(decision.frames, begin, end, limits)
    return wrong


def outcome_fault(outcome: object, taken: Container[str]) -> str | None:
    """Return the fault of a behaviour's outcome; None if it is valid. `taken`: reserved names."""
    if not isinstance(outcome, dict) or not all(isinstance(subject, str) for subject in outcome):
        return f"returned the outcome {outcome!r}; it should be a dict with names as keys"
    for subject, value in outcome.items():
        if subject in taken:
            return f"returned an outcome with the reserved name {subject!r}; choose another name"
        try:
            msgspec.json.encode(value)
        except (TypeError, ValueError) as error:
            return f"returned an outcome that is not valid JSON, under {subject!r}: {error}"
    return None


def _is_point(goal: object) -> bool:
    return isinstance(goal, Point) and math.isfinite(goal.x) and math.isfinite(goal.y)


def _is_distance(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= MAX_BACK_OUT


def _peers_fault(peers: object, limits: RobotLimits) -> str | None:
    if not isinstance(peers, tuple):
        return f"returned peers={peers!r}; it should be a tuple of Points, or None"
    if len(peers) > limits.peers:
        return f"returned {len(peers)} peers; at most {limits.peers} are allowed"
    for peer in peers:
        if not _is_point(peer):
            return f"returned {peer!r} in peers; it should be a Point of finite numbers"
    return None


_MAX_LISTED: Final = 1000
"""Maximum number of listed decisions and of blocked intervals; later decisions are only counted."""


class AdaptationDecision(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One decision of a robot's adaptation; instants and ages in µs."""

    instant: Count
    by: Name
    words: Text
    source: Name
    """Robot whose knowledge caused the decision."""
    age: Count
    """Age of that knowledge."""
    old: tuple[Metres, Metres] | None
    """Target before the decision, m, map frame."""
    new: tuple[Metres, Metres] | None
    """Target after the decision, m, map frame."""


class AdaptationReport(msgspec.Struct, forbid_unknown_fields=True):
    """Decisions of a robot's adaptation."""

    decisions: BoundedList[AdaptationDecision] = []
    decisions_unlisted: Count = 0
    blocked: BoundedList[tuple[Count, Count | None]] | None = None
    """Intervals in which the robot detected that it was blocked, µs; None if its component does not."""


_Bound = Annotated[int, msgspec.Meta(gt=0, le=1 << 53)]


class NodeReport(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of one robot's deeco node (`deeco.statistics.Statistics`) and of its radio link."""

    counters: Counts
    exchanges: Counts
    """By ensemble: exchanges that changed the local knowledge."""
    replica_age_ms: Annotated[dict[_Bound, Count], msgspec.Meta(max_length=10_000)]
    """Histogram of the replicas' age at each publication: count by the bin's upper bound, ms."""


@runtime_checkable
class DecisionSource(Protocol):
    """A component that can describe its decisions."""

    @property
    def target(self) -> Point | None:
        """Current target, m, map frame."""

    def decided_since(self, before: Self) -> str:
        """Return a description of the decisions since `before`; empty if there are none."""


class DecisionLog:
    """Log of the decisions of one component and of its state `blocked`."""

    def __init__(self, component: Knowledge, former: "DecisionLog | None" = None) -> None:
        """Create an empty log, or continue `former`, the log of the robot's previous component."""
        kind = type(component)
        adapts = any(process.adaptation for process in processes_of(kind))
        self._decides = isinstance(component, DecisionSource)
        self._diagnoses = adapts and callable(getattr(kind, "is_blocked", None))
        self._report: AdaptationReport = AdaptationReport() if former is None else former._report
        self._blocked: list[tuple[int, int | None]] = [] if former is None else former._blocked
        self._is_blocked: bool = former is not None and former._is_blocked

    def take(self, commit: Commit) -> None:
        """Record a change of the component's knowledge."""
        before: Any = commit.before
        after: Any = commit.after
        if self._diagnoses:
            self._record_blocked(after.is_blocked(), commit.instant)
        if not (self._decides and commit.adaptation):
            return
        if words := after.decided_since(before):
            self._record_decision(commit, words, before.target, after.target)

    def report(self) -> AdaptationReport:
        """Return the decisions so far, for the run's result."""
        blocked = self._blocked if self._diagnoses or self._blocked else None
        return msgspec.structs.replace(self._report, blocked=blocked)

    def _record_decision(self, commit: Commit, words: str, old: Point | None, new: Point | None) -> None:
        report = self._report
        if len(report.decisions) == _MAX_LISTED:
            report.decisions_unlisted += 1
            return
        heard = commit.instant if commit.heard is None else commit.heard
        source, age = commit.peer or commit.after.id, commit.instant - heard
        report.decisions.append(AdaptationDecision(commit.instant, commit.by, words, source, age, old, new))

    def _record_blocked(self, is_blocked: bool, now: Instant) -> None:
        """Open or close an interval; at most _MAX_LISTED are listed."""
        if is_blocked is self._is_blocked:
            return
        self._is_blocked = is_blocked
        if not is_blocked:
            if self._blocked and self._blocked[-1][1] is None:
                self._blocked[-1] = (self._blocked[-1][0], now)
        elif len(self._blocked) < _MAX_LISTED:
            self._blocked.append((now, None))
