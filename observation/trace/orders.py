"""Navigation orders of a strategy in a replay, and where the points of its goals came from."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import Any, Final

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour.goal import Goal, GoalOrder
from actors.robot.behaviour.node_host import ensembles_of
from actors.robot.behaviour.ports import Behaviour, Decision, View
from actors.robot.core import RobotCore
from observation.trace.rows import GoalChange, Order


class KnownPoints:
    """Follows the points in a component's fields, change by change."""

    def __init__(self) -> None:
        self._brought: dict[Point, dict[str, int]] = defaultdict(dict)
        self._taken: dict[Point, dict[str, int]] = defaultdict(dict)
        """By point the number of the last change of each field."""
        self._step = -1
        self._kept: dict[Point, dict[str, int]] = defaultdict(dict)
        """The same of points that a change of the last step has left in a field."""

    def note(self, number: int, step: int, field: str, before: object, after: object) -> None:
        """A change of a field."""
        if step != self._step:
            self._step = step
            self._kept.clear()
        had, has = set(_points(before)), set(_points(after))
        for point in has - had:
            self._brought[point][field] = number
        for point in had - has:
            self._taken[point][field] = number
        for point in has:
            self._kept[point][field] = number

    def behind(self, point: Point | None, step: int, *, gone: bool, again: bool) -> tuple[int, ...]:
        """The last change of each field that brought the point, newest first.

        `gone`: that took it away; `again`: also those of this step that have left it in the field.
        """
        if point is None:
            return ()
        found = dict((self._taken if gone else self._brought).get(point, {}))
        if again and step == self._step:
            found |= self._kept.get(point, {})
        return tuple(sorted(set(found.values()), reverse=True))


def _points(value: object) -> Iterator[Point]:
    """Every point that is somewhere in the value."""
    if isinstance(value, Point):
        yield value
    elif isinstance(value, tuple):
        if len(value) == 2 and all(isinstance(one, float) for one in value):
            yield Point(*value)
        for one in value:
            yield from _points(one)
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _points(one)
    elif is_dataclass(value):
        for one in fields(value):
            yield from _points(getattr(value, one.name))


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
