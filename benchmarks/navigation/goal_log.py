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
from actors.task.words import PlaceGivenUp, PlaceReport

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


ERRANDS: Final = "benchmarks.navigation.goal_log:errands"


class Errands:
    """Takes its places in turn, each until navigation says what came of it, and reports that once.

    After its last place it begins anew, so that it stays in the others' way until they are done, too.
    """

    def __init__(self, start: Start) -> None:
        self._start = start
        self._taken = 0

    def advance(self, view: View, until: Instant) -> Decision:
        """Wait, or report and take the next place."""
        if self._taken == 0:
            return self._next(())
        if view.goal is None or view.goal.status is GoalStatus.ACTIVE:
            return Decision()
        place, instant = self._taken - 1, view.instant
        if place >= len(self._start.places):
            return self._next(())
        if view.goal.status is GoalStatus.SUCCEEDED:
            return self._next((PlaceReport(self._start.robot, place, instant),))
        reason = "" if view.goal.reason is None else view.goal.reason.value
        given_up = PlaceGivenUp(self._start.robot, place, instant, f"navigation: {reason}")
        return self._next((), (given_up,))

    def _next(self, reports: tuple[PlaceReport, ...], given_up: tuple[PlaceGivenUp, ...] = ()) -> Decision:
        goal = self._start.places[self._taken % len(self._start.places)]
        self._taken += 1
        return Decision(goal=goal, reports=reports, given_up=given_up)


def errands(start: Start) -> Behaviour:
    """Entry ERRANDS."""
    return Errands(start)
