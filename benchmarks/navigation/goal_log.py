"""A behaviour that lets another one decide, and keeps a log of the goals that it gives to navigation.

The other one's entry stands in the setting `logged`; all other settings are its own. What it does, and so the
digest of the run, stays the same.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Final

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Goal, GoalOrder, GoalStatus, Start, View
from actors.robot.behaviour.entry import load_behaviour

ENTRY: Final = "benchmarks.navigation.goal_log:behaviour"
SUBJECT: Final = "goals"
"""Under which the log stands in the outcome."""
LOGGED: Final = "logged"
SUCCEEDED: Final = "succeeded"
REPLACED: Final = "replaced"
CANCELLED: Final = "cancelled"


class LoggedGoal(msgspec.Struct):
    """One goal of a robot; instants in µs."""

    begin: int
    """The start of the step in which it was given."""
    x: float
    y: float
    """Where, m, map frame."""
    end: int | None = None
    """The start of the step in which it was seen to have ended; None: still active at the end of the run."""
    how: str = ""
    """SUCCEEDED, REPLACED, CANCELLED, or the reason of its abort in the words of AbortReason."""
    given_up: bool = False
    """True if navigation aborted it."""


class Logged:
    """The other behaviour, with the log."""

    def __init__(self, inner: Behaviour) -> None:
        self._inner = inner
        self._goals: list[LoggedGoal] = []

    def advance(self, view: View, until: Instant) -> Decision:
        """What the other one decides."""
        if view.goal is not None:
            self._look(view.goal, view.instant)
        decision = self._inner.advance(view, until)
        if decision.goal is GoalOrder.CANCEL:
            self._close(view.instant, CANCELLED)
        elif isinstance(decision.goal, Point):
            self._close(view.instant, REPLACED)
            self._goals.append(LoggedGoal(view.instant, *decision.goal))
        return decision

    def outcome(self) -> dict[str, object]:
        """What the other one has to say, and the log."""
        say = getattr(self._inner, "outcome", None)
        said: dict[str, object] = {} if say is None else say()
        return {**said, SUBJECT: self._goals}

    def _look(self, goal: Goal, instant: Instant) -> None:
        if goal.status is GoalStatus.SUCCEEDED:
            self._close(instant, SUCCEEDED)
        elif goal.status is GoalStatus.ABORTED:
            self._close(instant, "" if goal.reason is None else goal.reason.value, given_up=True)

    def _close(self, instant: Instant, how: str, given_up: bool = False) -> None:
        if self._goals and self._goals[-1].end is None:
            last = self._goals[-1]
            last.end, last.how, last.given_up = instant, how, given_up


def behaviour(start: Start) -> Behaviour:
    """Entry ENTRY."""
    settings = dict(start.settings)
    entry = str(settings.pop(LOGGED))
    return Logged(load_behaviour(entry, replace(start, settings=MappingProxyType(settings))))
