"""Strategies with planted behaviour: one sleeps with places left, one pauses, one changes goals too often."""

from dataclasses import replace
from typing import Any, Final

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Start
from actors.robot.behaviour.goal import GoalOrder
from actors.robot.behaviour.ports import Decision, View
from cleaning.strategies import none

SLEEPING: Final = "benchmarks.causes.planted_strategies:sleeping"
DITHERING: Final = "benchmarks.causes.planted_strategies:dithering"


class _Sleeper:
    """Acts as `none` until it falls asleep, with one last decision."""

    def __init__(self, awake: Behaviour, at: Instant, last: dict[str, Any]) -> None:
        self._awake, self._at, self._last = awake, at, last
        self._asleep = False

    def advance(self, view: View, until: Instant) -> Decision:
        """What the other one does; once it sleeps, nothing."""
        if self._asleep:
            return Decision()
        decided = self._awake.advance(view, until)
        self._asleep = view.instant >= self._at
        return replace(decided, **self._last) if self._asleep else decided


class _Ditherer:
    """Goes to one of its two places, and to the other one before it is there."""

    def __init__(self, start: Start, every: int) -> None:
        self._places, self._every = start.places, every
        self._last = -1

    def advance(self, view: View, until: Instant) -> Decision:
        """A new goal now and then."""
        number = view.instant // self._every
        if number == self._last:
            return Decision()
        self._last = number
        return Decision(self._places[number % 2])


def sleeping(start: Start) -> Behaviour:
    """Settings: `who` falls asleep, when, `asleep_s`, and whether `paused`, so that it keeps its goal."""
    awake = none.behaviour(replace(start, settings={}))
    if start.robot != start.settings["who"]:
        return awake
    last: dict[str, Any] = {"paused": True} if start.settings["paused"] else {"goal": GoalOrder.CANCEL}
    return _Sleeper(awake, Instant(_lasting(start, "asleep_s")), last)


def dithering(start: Start) -> Behaviour:
    """Setting `every_s`: after so long it turns round."""
    return _Ditherer(start, _lasting(start, "every_s"))


def _lasting(start: Start, name: str) -> int:
    value = start.settings[name]
    assert isinstance(value, float), "the situations say so"
    return seconds(value)
