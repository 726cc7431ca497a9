"""What a behaviour told its robot, step by step, while the robot is replayed."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour.goal import Goal, GoalOrder
from actors.robot.behaviour.node_host import ensembles_of
from actors.robot.behaviour.ports import Behaviour, Decision, View
from actors.robot.core import RobotCore
from observation.trace.points import KnownPoints
from observation.trace.rows import GoalChange, Order

SETS_OFF: Final = "sets off for"
AGAIN: Final = "sets off again for"
STOPS: Final = "stops"
GIVES_UP: Final = "gives up"


class OrderWatch:
    """Takes down the orders of one core's behaviour; none of one that is an object nobody can look at."""

    def __init__(self, points: KnownPoints) -> None:
        """`points`: of the same robot's knowledge."""
        self.found: list[Order] = []
        self._points = points
        self._heading: Point | None = None
        self._behaviour: Behaviour | None = None

    @property
    def ensembles(self) -> tuple[object, ...]:
        """Those of its node, the last one of several; empty without one."""
        return ensembles_of(self._behaviour)

    def attach(self, core: RobotCore) -> None:
        """Look at every step that the behaviour takes from now on."""
        behaviour = self._behaviour = core.behaviour
        advance = behaviour.advance

        def watched(view: View, until: Any) -> Decision:
            decision = advance(view, until)
            self.found += self._told(core.step, view, decision)
            return decision

        with suppress(AttributeError):  # an object with slots takes no other method
            object.__setattr__(behaviour, "advance", watched)

    def _told(self, step: int, view: View, decision: Decision) -> Iterator[Order]:
        goal = goal_change(step, view.goal) if view.goal is not None else None

        def order(verb: str, more: str = "", point: Point | None = None, at: Instant | None = None) -> Order:
            moved = self._points.behind(point, step, gone=verb == STOPS, again=verb == AGAIN)
            place = None if point is None else (point.x, point.y)
            words = f"{verb} {more}" if more else verb
            return Order(step, Instant(view.instant) if at is None else at, words, verb, place, goal, moved)

        for place in decision.given_up:
            named = f"{place.owner}/{place.place}: {place.reason}"
            yield order(GIVES_UP, named, at=Instant(place.instant))
        yield from self._driving(view, decision, order)
        if decision.paused is not None:
            yield order("pauses" if decision.paused else "goes on")
        if decision.back_out is not None:
            yield order("backs out", f"{decision.back_out:g} m along its trail")
        if decision.relocalise:
            yield order("looks for itself anew")

    def _driving(self, view: View, decision: Decision, order: Any) -> Iterator[Order]:
        if isinstance(decision.goal, Point):
            verb = AGAIN if decision.goal == self._heading else SETS_OFF
            self._heading = decision.goal
            yield order(verb, f"({decision.goal.x:.2f}, {decision.goal.y:.2f})", decision.goal)
        elif decision.goal is GoalOrder.CANCEL and view.goal is not None:
            left, self._heading = self._heading, None
            yield order(STOPS, "", left)


def goal_change(step: int, goal: Goal | None) -> GoalChange:
    """How a goal stands from a step on."""
    if goal is None:
        return GoalChange(step, None)
    status, reason, phase = (one and one.value for one in (goal.status, goal.reason, goal.phase))
    return GoalChange(step, (goal.point.x, goal.point.y), status, reason, phase)
