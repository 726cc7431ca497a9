"""Strategies with a planted fault: one sleeps with places left, one cannot make up its mind."""

from dataclasses import replace
from typing import Final

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Start
from actors.robot.behaviour.goal import GoalOrder
from actors.robot.behaviour.ports import Decision, View
from cleaning.strategies import none

SLEEPING: Final = "benchmarks.causes.planted_strategies:sleeping"
DITHERING: Final = "benchmarks.causes.planted_strategies:dithering"


class _Sleeper:
    """Does as `none`, until it falls asleep."""

    def __init__(self, awake: Behaviour, at: Instant) -> None:
        self._awake, self._at = awake, at
        self._asleep = False

    def advance(self, view: View, until: Instant) -> Decision:
        """What the other one does; once it sleeps, nothing."""
        if self._asleep:
            return Decision()
        decided = self._awake.advance(view, until)
        self._asleep = view.instant >= self._at
        return replace(decided, goal=GoalOrder.CANCEL) if self._asleep else decided


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
    """Settings: `who` falls asleep, and when, `asleep_s`."""
    awake = none.behaviour(replace(start, settings={}))
    if start.robot != start.settings["who"]:
        return awake
    return _Sleeper(awake, Instant(_lasting(start, "asleep_s")))


def dithering(start: Start) -> Behaviour:
    """Setting `every_s`: after so long it turns round."""
    return _Ditherer(start, _lasting(start, "every_s"))


def _lasting(start: Start, name: str) -> int:
    value = start.settings[name]
    assert isinstance(value, float), "the situations say so"
    return seconds(value)
