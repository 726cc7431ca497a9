"""Behaviours in turn: `first>second@120` runs the first, and from 120 s on the second.

The second is made at the first step from that instant on, with the robot's own random stream as the first has
left it, the present pose estimate, and default settings except for those behind its name:
`first>second{"reach":0.5}@120`. Its component decides what it takes over of the first one's knowledge
(`Resumable`); the node continues its counters, so that peers take its knowledge as newer. Replicas are not
passed on: peers publish again. Pausing and masks of the first end.
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


class Turn(NamedTuple):
    """From when on another behaviour decides."""

    at_s: float
    name: str
    """Its entry string; in a scenario also a strategy's name."""
    settings: Mapping[str, Setting] = _NONE
    """Where they differ from its own."""


def split(text: str) -> tuple[str, tuple[Turn, ...]]:
    """The name that comes first, and those that follow it. Raises BehaviourError."""
    first, *others = text.split(_THEN)
    turns = tuple(_turn(text, other) for other in others)
    instants = [0.0, *(turn.at_s for turn in turns)]
    if any(later <= earlier for earlier, later in pairwise(instants)):
        raise BehaviourError(f"behaviour {text!r}: each instant should be later than the one before, and 0 s")
    return first, turns


def joined(first: str, turns: Sequence[Turn]) -> str:
    """What `split` takes apart."""
    said = (f"{_THEN}{turn.name}{_written(turn.settings)}{_AT}{turn.at_s!r}" for turn in turns)
    return "".join([first, *said])


def names(text: str) -> tuple[str, ...]:
    """All names in it, the first one first. Raises BehaviourError."""
    first, turns = split(text)
    return (first, *(turn.name for turn in turns))


def behaviour_of(text: str, start: Start) -> Behaviour:
    """The behaviour of one entry, or of several that follow one another; raises as `load_behaviour` does."""
    first, turns = split(text)
    return _Handover(start, first, turns) if turns else load_behaviour(first, start)


def dry_run(text: str, start: Start) -> None:
    """Make each behaviour once, and drop it; raises as `load_behaviour` does. `start` is used up."""
    first, turns = split(text)
    load_behaviour(first, start)
    for turn in turns:
        load_behaviour(turn.name, replace(start, settings=turn.settings))


class _Handover:
    """The behaviour whose turn it is."""

    def __init__(self, start: Start, first: str, turns: Sequence[Turn]) -> None:
        for turn in turns:
            entry_function(turn.name)  # what is missing is said before the first step
        self._start = start
        self._present = load_behaviour(first, start)
        self._left = deque(turns)
        self._begun = False
        self._paused = False
        self._masked = False

    @property
    def hosted(self) -> Behaviour:
        """The one whose turn it is."""
        return self._present

    def advance(self, view: View, until: Instant) -> Decision:
        """As the one whose turn it is."""
        relieved = False
        while self._left and seconds(self._left[0].at_s) <= view.instant:
            self._relieve(self._left.popleft(), view)
            relieved = True
        self._begun = True
        decision = self._present.advance(view, until)
        if relieved and self._paused and decision.paused is None:
            decision = replace(decision, paused=False)
        if relieved and self._masked and decision.peers is None:
            decision = replace(decision, peers=())
        if decision.paused is not None:
            self._paused = decision.paused
        if decision.peers is not None:
            self._masked = bool(decision.peers)
        return decision

    def outcome(self) -> dict[str, object]:
        """What the last one has to say; a node's counters are those of all."""
        say = getattr(self._present, "outcome", None)
        return {} if say is None else say()

    def _relieve(self, turn: Turn, view: View) -> None:
        """A robot that begins later than the turn has nothing to pass on."""
        start = self._start
        if self._begun:
            start = replace(start, pose=view.pose)
        heir = load_behaviour(turn.name, replace(start, settings=turn.settings))
        if self._begun:
            take_over(heir, self._present, turn.name)
        self._present = heir


def instant_of(text: str) -> float | None:
    """The s that a text such as "120" or "59.5" stands for; None if it stands for none, or not above 0."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _turn(text: str, other: str) -> Turn:
    named, at, instant = other.rpartition(_AT)
    name, brace, rest = named.partition("{")
    at_s = instant_of(instant)
    if not (name and at) or at_s is None:
        raise BehaviourError(
            f"behaviour {text!r}: it should look like 'first{_THEN}second{_AT}120', the instant in s"
        )
    if not brace:
        return Turn(at_s, name)
    try:
        return Turn(at_s, name, MappingProxyType(dict(_SETTINGS.decode(brace + rest))))
    except (ValueError, RecursionError):
        raise BehaviourError(
            f"behaviour {text!r}: what stands behind {name} should be its settings in JSON, such as "
            '{"reach": 0.5}'
        ) from None


def _written(settings: Mapping[str, Setting]) -> str:
    """In JSON, without the characters that separate behaviours."""
    if not settings:
        return ""
    text = msgspec.json.encode(dict(settings), order="deterministic").decode()
    return text.replace(_THEN, f"\\u{ord(_THEN):04x}").replace(_AT, f"\\u{ord(_AT):04x}")
