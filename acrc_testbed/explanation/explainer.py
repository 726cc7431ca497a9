"""Explanations of robots' decisions, from causal traces."""

import re
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.explanation.causal_trace import CausalTrace, TraceError
from acrc_testbed.explanation.chain import (
    CauseLink,
    ChainBuilder,
    RadioTraffic,
    Second,
    TracedDecision,
    decisions,
)
from acrc_testbed.explanation.trace_replay import BOUNDS, trace
from acrc_testbed.recordings.record_replay import ReplayReport
from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.recordings.sandboxed_replay import ProgramLimits
from actors.instant import in_seconds
from actors.robot.behaviour.code_permit import Permit
from actors.runtime.errors import AcrcError, printable

_SAME_S: Final = 0.0501
"""Tolerance for the instant of a decision, s: half a step."""


class ExplanationError(AcrcError):
    """A request that cannot be answered."""


class ExplainRequest(NamedTuple):
    """Request to explain a robot's decision."""

    robot: str
    at_s: float | None
    """Simulated s; None: list all decisions."""


class DecisionRow(msgspec.Struct, frozen=True):
    """One decision in a list."""

    at_s: Second
    words: str
    by: str
    """Process or exchange that changed the knowledge; "behaviour" for an order."""


class Explanation(msgspec.Struct, frozen=True):
    """Causes of one decision."""

    robot: str
    asked_s: Second
    at_s: Second
    """Instant of the decision: the last one before `asked_s`, unless `exact`."""
    exact: bool
    decision: str
    by: str
    chain: tuple[CauseLink, ...]
    """The decision first; causes follow, one level deeper than their effects."""


def compare_decisions(actor: str, recorded: CausalTrace, replayed: CausalTrace) -> ReplayReport:
    """Compare decisions up to the end of `replayed`. Raises TraceError if it failed before a difference."""
    lists = [
        [
            f"{one.words} at {in_seconds(one.instant):g} s"
            for one in decisions(each)
            if one.instant <= replayed.end
        ]
        for each in (recorded, replayed)
    ]
    for old, new in zip_longest(*lists, fillvalue="none"):
        if old != new:
            return ReplayReport(actor, 0, decisions=f"first different decision: {new}; recorded: {old}")
    if replayed.fault:
        raise TraceError(replayed.fault)
    return ReplayReport(actor, 0, decisions=f"no different decision up to {in_seconds(replayed.end):g} s")


def parse_request(text: str) -> ExplainRequest:
    """Parse `r2@157`, the decision of r2 at 157 s, or `r2`, all of its decisions. Raises ExplanationError."""
    robot, at, instant = text.partition("@")
    if not at:
        return ExplainRequest(robot, None)
    if not robot or not re.fullmatch(r"[0-9]+(\.[0-9]*)?", instant):
        raise ExplanationError(
            f"{text}: must be a robot, such as r2, or a robot and simulated seconds, such as r2@157"
        )
    return ExplainRequest(robot, float(instant))


class Explainer:
    """Explanations of decisions of one robot, which is replayed."""

    def __init__(
        self, out: Path, robot: str, *, permit: Permit, isolate: bool, bounds: ProgramLimits = BOUNDS
    ) -> None:
        """`isolate`: see `actors.runtime.isolation.sandbox`. Raises ExplanationError."""
        self._out, self._robot = out, robot
        try:
            self._traces = [
                (actor, trace(out, actor, permit=permit, isolate=isolate, bounds=bounds))
                for actor in processes(out, robot)
            ]
        except TraceError as error:
            raise ExplanationError(printable(str(error))) from None

    def listed(self) -> tuple[DecisionRow, ...]:
        """Return all decisions, by process and time."""
        known = (one for _, found in self._traces for one in decisions(found))
        return tuple(DecisionRow(in_seconds(one.instant), one.words, one.by) for one in known)

    def explain(self, at_s: float) -> tuple[Explanation, ...]:
        """Return the decisions at an instant, or the last ones before it.

        Raises ExplanationError if there is none, or if the recording ends before.
        """
        end_s = in_seconds(self._traces[-1][1].end)
        if at_s > end_s + _SAME_S:
            raise ExplanationError(f"{self._robot}@{at_s:g}: the robot's recording ends at {end_s:g} s")
        earliest = None
        for actor, found_trace in reversed(self._traces):
            known = decisions(found_trace)
            if found := _decisions_at(known, at_s):
                chain = ChainBuilder(found_trace, RadioTraffic(self._out, actor))
                return tuple(_explanation(self._robot, at_s, one, chain) for one in found)
            earliest = in_seconds(known[0].instant) if known else earliest
        then = "it makes none" if earliest is None else f"its first decision is at {earliest:g} s"
        raise ExplanationError(f"{self._robot} made no decision before {at_s:g} s; {then}")


def _decisions_at(known: Sequence[TracedDecision], at_s: float) -> list[TracedDecision]:
    """Return the decisions at the instant, or those of the last instant before it."""
    earlier = [one for one in known if in_seconds(one.instant) <= at_s + _SAME_S]
    if not earlier:
        return []
    simultaneous = [one for one in earlier if abs(in_seconds(one.instant) - at_s) <= _SAME_S]
    return simultaneous or [one for one in earlier if one.instant == earlier[-1].instant]


def _explanation(robot: str, asked_s: float, decision: TracedDecision, chain: ChainBuilder) -> Explanation:
    at_s = in_seconds(decision.instant)
    exact = abs(at_s - asked_s) <= _SAME_S
    return Explanation(
        robot,
        asked_s,
        at_s,
        exact,
        decision.words,
        decision.by,
        tuple(chain.links(decision)),
    )


def processes(out: Path, robot: str) -> list[str]:
    """Return the processes of a robot, or the named process, in order of start.

    Raises ExplanationError if there is none.
    """
    files = all_recordings(out)
    found = [actor for actor, path in files.items() if path.parent.name == robot] or [
        actor for actor in files if actor == robot
    ]
    robots = sorted({path.parent.name for path in files.values()} - {"world", "radio"})
    if not found or robot in ("world", "radio"):
        raise ExplanationError(f"{robot}: not a robot of this run; choose from {', '.join(robots)}")
    return found


def sentences(explanation: Explanation) -> Iterator[str]:
    """Yield one line per link."""
    robot, asked_s, at_s = explanation.robot, explanation.asked_s, explanation.at_s
    if not explanation.exact:
        yield f"{robot} made no decision at {asked_s:g} s; its last one before that, at {at_s:g} s:"
    for link in explanation.chain:
        yield f"{link.at_s:9.3f} s  {'   ' * link.depth}{link.says}"
