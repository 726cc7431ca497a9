"""What the log of goals holds, and when a robot counts as pursuing one."""

from collections.abc import Sequence
from types import MappingProxyType
from typing import cast

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.randomness import generator
from actors.robot.behaviour.goal import AbortReason, Goal, GoalOrder, GoalStatus
from actors.robot.behaviour.ports import Behaviour, Decision, Setting, Start, View
from benchmarks.navigation import goal_log
from benchmarks.navigation.goal_log import LoggedGoal

STEP = 100_000
HERE = Pose(0.0, 0.0, 0.0)
A, B = Point(1.0, 0.0), Point(2.0, 0.0)
ACTIVE = {point: Goal(point, GoalStatus.ACTIVE) for point in (A, B)}


def start(**settings: Setting) -> Start:
    return Start("r1", 1, 0, HERE, (A, B), generator(1, "behaviour", "r1"), MappingProxyType(settings))


class Told:
    """Decides what it is told, one step after the other."""

    def __init__(self, goals: Sequence[Point | GoalOrder]) -> None:
        self._goals = iter(goals)

    def advance(self, view: View, until: Instant) -> Decision:
        return Decision(goal=next(self._goals))


def told(of: Start) -> Behaviour:
    keep = GoalOrder.KEEP
    return Told([A, keep, keep, A, keep, B, keep, GoalOrder.CANCEL, keep, A])


def drive(behaviour: Behaviour, goals: Sequence[Goal | None]) -> list[Decision]:
    return [
        behaviour.advance(View(Instant(step * STEP), HERE, True, goal, ()), Instant((step + 1) * STEP))
        for step, goal in enumerate(goals)
    ]


def log(behaviour: Behaviour) -> list[LoggedGoal]:
    outcome = cast(goal_log.Logged, behaviour).outcome()
    return cast(list[LoggedGoal], outcome[goal_log.SUBJECT])


def test_every_way_in_which_a_goal_can_end() -> None:
    behaviour = goal_log.behaviour(start(logged=f"{__name__}:told"))
    aborted = Goal(A, GoalStatus.ABORTED, AbortReason.BLOCKED)
    seen = [None, ACTIVE[A], aborted, aborted, ACTIVE[A], ACTIVE[A], ACTIVE[B], ACTIVE[B], None, None]
    drive(behaviour, seen)
    assert log(behaviour) == [
        LoggedGoal(0, 1.0, 0.0, 2 * STEP, "blocked", given_up=True),
        LoggedGoal(3 * STEP, 1.0, 0.0, 5 * STEP, "replaced"),
        LoggedGoal(5 * STEP, 2.0, 0.0, 7 * STEP, "cancelled"),
        LoggedGoal(9 * STEP, 1.0, 0.0),
    ]


def test_goal_orders_are_reported_once_and_begin_anew() -> None:
    reached = Goal(A, GoalStatus.SUCCEEDED)
    gone = Goal(B, GoalStatus.ABORTED, AbortReason.NO_PLAN)
    decisions = drive(goal_log.errands(start()), [None, ACTIVE[A], reached, gone, reached, reached])
    assert [decision.goal for decision in decisions] == [A, GoalOrder.KEEP, B, A, B, A]
    assert [[report.place for report in decision.reports] for decision in decisions] == [
        [], [], [0], [], [], [],
    ]  # fmt: skip
    assert [place.reason for decision in decisions for place in decision.given_up] == ["navigation: no plan"]
