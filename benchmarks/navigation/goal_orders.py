"""The behaviour of a robot that goes from place to place for ever, to measure its navigation."""

from typing import Final

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, GoalStatus, Start, View
from actors.task.words import PlaceGivenUp, PlaceReport

ENTRY: Final = "benchmarks.navigation.goal_orders:behaviour"


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


def behaviour(start: Start) -> Behaviour:
    """Entry ENTRY."""
    return Errands(start)
