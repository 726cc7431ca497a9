"""Strategies that stop giving goals, pause, or change goals too often."""

from dataclasses import replace
from typing import Any, Final

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Start
from actors.robot.behaviour.goal import GoalOrder
from actors.robot.behaviour.ports import Decision, View
from cleaning.strategies import none

SLEEPING: Final = "tests.experiments.planted_strategies:sleeping"
DITHERING: Final = "tests.experiments.planted_strategies:dithering"


class _Sleeper:
    """The strategy `none` until an instant; then one last decision, and none after it."""

    def __init__(self, awake: Behaviour, at: Instant, last: dict[str, Any]) -> None:
        self._awake, self._at, self._last = awake, at, last
        self._asleep = False

    def advance(self, view: View, until: Instant) -> Decision:
        if self._asleep:
            return Decision()
        decided = self._awake.advance(view, until)
        self._asleep = view.instant >= self._at
        return replace(decided, **self._last) if self._asleep else decided


class _Ditherer:
    """Alternates between two goals before it reaches either."""

    def __init__(self, start: Start, every: int) -> None:
        self._places, self._every = start.places, every
        self._last = -1

    def advance(self, view: View, until: Instant) -> Decision:
        number = view.instant // self._every
        if number == self._last:
            return Decision()
        self._last = number
        return Decision(self._places[number % 2])


def sleeping(start: Start) -> Behaviour:
    """Settings: robot `who`, instant `asleep_s`, and whether it is `paused` and keeps its goal."""
    awake = none.behaviour(replace(start, settings={}))
    if start.robot != start.settings["who"]:
        return awake
    last: dict[str, Any] = {"paused": True} if start.settings["paused"] else {"goal": GoalOrder.CANCEL}
    return _Sleeper(awake, Instant(_lasting(start, "asleep_s")), last)


def dithering(start: Start) -> Behaviour:
    """Setting `every_s`: period of the changes."""
    return _Ditherer(start, _lasting(start, "every_s"))


def _lasting(start: Start, name: str) -> int:
    value = start.settings[name]
    assert isinstance(value, float), "the situations say so"
    return seconds(value)
