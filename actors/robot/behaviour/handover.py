"""Behaviours in sequence: `first>second@120` runs the first, and from 120 s the second.

The second is created at the first step from that time, with the current pose estimate, the continued random
stream and default settings, unless its name has settings: `first>second{"reach":0.5}@120`. Its component
decides which knowledge of the first it resumes (`Resumable`). The node continues its counters, so that peers
accept its knowledge as newer. Replicas are dropped, since peers publish again; pausing and masks end.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec

from actors.instant import Instant, seconds
from actors.robot.behaviour.loading import BehaviourError, entry_function, load_behaviour
from actors.robot.behaviour.node_host import take_over
from actors.robot.behaviour.ports import Behaviour, Decision, Setting, Start, View

_THEN: Final = ">"
_AT: Final = "@"
_SETTINGS: Final = msgspec.json.Decoder(dict[str, Setting])
_NONE: Final[Mapping[str, Setting]] = MappingProxyType({})


class BehaviourChange(NamedTuple):
    """Start of the next behaviour."""

    at_s: float
    name: str
    """Entry string; in a scenario also a strategy's name."""
    settings: Mapping[str, Setting] = _NONE
    """Settings that differ from its defaults."""


def split(text: str) -> tuple[str, tuple[BehaviourChange, ...]]:
    """Return the first name and the handovers that follow it. Raises BehaviourError."""
    first, *others = text.split(_THEN)
    handovers = tuple(_parse_handover(text, other) for other in others)
    instants = [0.0, *(handover.at_s for handover in handovers)]
    if any(later <= earlier for earlier, later in pairwise(instants)):
        raise BehaviourError(f"behaviour {text!r}: instants should be above 0 s and in ascending order")
    return first, handovers


def join(first: str, handovers: Sequence[BehaviourChange]) -> str:
    """Return the text that `split` parses into these."""
    others = (
        f"{_THEN}{handover.name}{_as_text(handover.settings)}{_AT}{handover.at_s!r}" for handover in handovers
    )
    return "".join([first, *others])


def names(text: str) -> tuple[str, ...]:
    """Return all names in order. Raises BehaviourError."""
    first, handovers = split(text)
    return (first, *(handover.name for handover in handovers))


def behaviour_of(text: str, start: Start) -> Behaviour:
    """Return the behaviour of one entry or of a sequence; raises as `load_behaviour` does."""
    first, handovers = split(text)
    return _BehaviourSequence(start, first, handovers) if handovers else load_behaviour(first, start)


def dry_run(text: str, start: Start) -> None:
    """Create each behaviour once and discard it; raises as `load_behaviour` does. Consumes `start`."""
    first, handovers = split(text)
    load_behaviour(first, start)
    for handover in handovers:
        load_behaviour(handover.name, replace(start, settings=handover.settings))


class _BehaviourSequence:
    """A sequence of behaviours."""

    def __init__(self, start: Start, first: str, handovers: Sequence[BehaviourChange]) -> None:
        for handover in handovers:
            entry_function(handover.name)  # report missing functions before the first step
        self._start = start
        self._present = load_behaviour(first, start)
        self._left = deque(handovers)
        self._is_started = False
        self._paused = False
        self._masked = False

    @property
    def hosted(self) -> Behaviour:
        """Return the current behaviour."""
        return self._present

    def advance(self, view: View, until: Instant) -> Decision:
        """Advance the current behaviour."""
        switched = False
        while self._left and seconds(self._left[0].at_s) <= view.instant:
            self._switch(self._left.popleft(), view)
            switched = True
        self._is_started = True
        decision = self._present.advance(view, until)
        if switched and self._paused and decision.paused is None:
            decision = replace(decision, paused=False)
        if switched and self._masked and decision.peers is None:
            decision = replace(decision, peers=())
        if decision.paused is not None:
            self._paused = decision.paused
        if decision.peers is not None:
            self._masked = bool(decision.peers)
        return decision

    def outcome(self) -> dict[str, object]:
        """Return the outcome of the last behaviour; a node's counters cover all."""
        outcome = getattr(self._present, "outcome", None)
        return {} if outcome is None else outcome()

    def _switch(self, handover: BehaviourChange, view: View) -> None:
        """Switch to the next behaviour; it resumes nothing if the robot has just started."""
        start = self._start
        if self._is_started:
            start = replace(start, pose=view.pose)
        successor = load_behaviour(handover.name, replace(start, settings=handover.settings))
        if self._is_started:
            take_over(successor, self._present, handover.name)
        self._present = successor


def instant_of(text: str) -> float | None:
    """Return the time in s of a text such as "120" or "59.5"; None for other texts and for 0 or less."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _parse_handover(text: str, other: str) -> BehaviourChange:
    named, at, instant = other.rpartition(_AT)
    name, brace, rest = named.partition("{")
    at_s = instant_of(instant)
    if not (name and at) or at_s is None:
        raise BehaviourError(
            f"behaviour {text!r}: it should look like 'first{_THEN}second{_AT}120', the instant in s"
        )
    if not brace:
        return BehaviourChange(at_s, name)
    try:
        return BehaviourChange(at_s, name, MappingProxyType(dict(_SETTINGS.decode(brace + rest))))
    except (ValueError, RecursionError):
        raise BehaviourError(
            f'behaviour {text!r}: the text after {name} should be settings in JSON, such as {{"reach": 0.5}}'
        ) from None


def _as_text(settings: Mapping[str, Setting]) -> str:
    """Return settings as JSON, with the separators of behaviours escaped."""
    if not settings:
        return ""
    text = msgspec.json.encode(dict(settings), order="deterministic").decode()
    return text.replace(_THEN, f"\\u{ord(_THEN):04x}").replace(_AT, f"\\u{ord(_AT):04x}")
