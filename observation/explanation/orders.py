"""What a behaviour told its robot, step by step, while the robot is executed again."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour.goal import Goal, GoalOrder, GoalStatus
from actors.robot.behaviour.node_host import ensembles_of
from actors.robot.behaviour.ports import Behaviour, Decision, View
from actors.robot.core import RobotCore

SETS_OFF: Final = "sets off for"
AGAIN: Final = "sets off again for"
STOPS: Final = "stops"
GIVES_UP: Final = "gives up"


class Order(NamedTuple):
    """Something that a behaviour wanted done from a step on."""

    step: int
    instant: Instant
    """The step's start, or when the behaviour says that it was."""
    words: str
    verb: str
    """What kind of order it is: the first of the words."""
    point: Point | None
    """Where to, m, map frame; of `STOPS`, where it had been heading for."""
    goal: Goal | None
    """How navigation's last goal stood before."""


@dataclass
class OrderWatch:
    """Takes down the orders of one core's behaviour."""

    orders: list[Order] = field(default_factory=list)
    followed: bool = False
    """False: the behaviour is an object that nobody can look at."""
    _heading: Point | None = None
    _behaviour: Behaviour | None = None

    @property
    def ensembles(self) -> tuple[object, ...]:
        """Those of its node, the last one of several; empty without one."""
        return ensembles_of(self._behaviour)

    def attach(self, core: RobotCore) -> None:
        """Look at every step that the behaviour takes from now on."""
        behaviour = self._behaviour = core.behaviour
        advance = behaviour.advance

        def watched(view: View, until: Instant) -> Decision:
            decision = advance(view, until)
            self.orders += self._told(core.step, view, decision)
            return decision

        with suppress(AttributeError):  # an object with slots takes no other method
            object.__setattr__(behaviour, "advance", watched)
            self.followed = True

    def _told(self, step: int, view: View, decision: Decision) -> Iterator[Order]:
        def order(verb: str, more: str = "", point: Point | None = None, at: int | None = None) -> Order:
            words = f"{verb} {more}" if more else verb
            return Order(step, Instant(view.instant if at is None else at), words, verb, point, view.goal)

        for place in decision.given_up:
            named = f"{place.owner}/{place.place}: {place.reason}"
            yield order(GIVES_UP, named, at=place.instant)
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


def stands(goal: Goal | None) -> str:
    """How a goal stood, in words."""
    if goal is None:
        return "there was no goal before"
    at = f"({goal.point.x:.2f}, {goal.point.y:.2f})"
    if goal.status is GoalStatus.ABORTED and goal.reason is not None:
        return f"navigation had given up the goal {at}: {goal.reason.value}"
    if goal.status is GoalStatus.SUCCEEDED:
        return f"navigation had reached the goal {at}"
    phase = "" if goal.phase is None else f", {goal.phase.value}"
    return f"navigation was under way to {at}{phase}"
