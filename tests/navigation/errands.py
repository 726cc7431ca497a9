"""Strategy that drives to its places in turn, each once, and reports how navigation ended it."""

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, GoalStatus, Start, View
from actors.task.words import PlaceGivenUp, PlaceReport


class Errands:
    """After its last place the robot begins again, without reports, and stays in the way of the others."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._taken = 0

    def advance(self, view: View, until: Instant) -> Decision:
        """Wait for the end of the current goal, then report its place and give the next one."""
        if self._taken == 0:
            return self._next(())
        if view.goal is None or view.goal.status is GoalStatus.ACTIVE:
            return Decision()
        place = self._taken - 1
        if place >= len(self._start.places):
            return self._next(())
        if view.goal.status is GoalStatus.SUCCEEDED:
            return self._next((PlaceReport(self._start.robot, place, view.instant),))
        reason = "" if view.goal.reason is None else view.goal.reason.value
        return self._next(
            (), (PlaceGivenUp(self._start.robot, place, view.instant, f"navigation: {reason}"),)
        )

    def _next(self, reports: tuple[PlaceReport, ...], given_up: tuple[PlaceGivenUp, ...] = ()) -> Decision:
        goal = self._start.places[self._taken % len(self._start.places)]
        self._taken += 1
        return Decision(goal=goal, reports=reports, given_up=given_up)


def errands(start: Start) -> Behaviour:
    """Return the strategy of one robot."""
    return Errands(start)
