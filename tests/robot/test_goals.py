"""Goals: reached, replaced, cancelled, paused, aborted, with retreats."""

from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, seconds
from actors.messages import NO_ECHO_MM
from actors.robot.behaviour.ports import AbortReason, Goal, GoalOrder, GoalPhase
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.sweep import Sweep
from tests.robot.base import at_step, model
from tests.robot.rig import (
    ABORTED,
    ACTIVE,
    AHEAD,
    CHAPTER,
    FAR,
    HERE,
    SHIFT,
    SUCCEEDED,
    UNREACHABLE,
    WEST,
    NavigationRun,
)


def test_a_goal_is_followed_to_within_the_tolerance() -> None:
    trip = NavigationRun().goes_to(FAR)
    assert trip.navigation.goal == Goal(FAR, ACTIVE)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(0))
    trip.steps(250)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)
    assert trip.place.distance_to(FAR) <= 0.15
    assert trip.take_step() == STILL
    assert (trip.count("goals"), trip.count("succeeded")) == (1, 1)


def test_the_path_is_replanned_every_second() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(41)
    assert len(trip.local_planner.paths) == 5 and trip.local_planner.begun == 1


@pytest.mark.parametrize("preset", NAVIGATION_PRESETS)
def test_the_old_path_is_followed_while_there_is_no_new_one(preset: str) -> None:
    trip = NavigationRun(NAVIGATION_PRESETS[preset]).goes_to(FAR)
    trip.take_step()
    plan = trip.navigation.plan
    trip.planner.finds = False
    assert trip.steps(100) == [AHEAD] * 100
    assert (trip.phase, trip.planner.asked) == (GoalPhase.CONTROLLING, 11)
    assert trip.navigation.plan is plan and trip.count("without_plan") == []
    trip.steps(150)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED) and trip.count("recoveries") == 0


def test_an_interval_ends_with_the_run_or_with_a_cancellation() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.local_planner.valid = False
    trip.steps(4)
    assert trip.count("no_valid_trajectory") == [(at_step(0), at_step(3), "run")]
    trip.navigation.take(GoalOrder.CANCEL)
    assert trip.navigation.goal is None and trip.take_step() == STILL
    assert trip.count("no_valid_trajectory") == [(at_step(0), at_step(3), "order")]
    assert trip.count("cancelled") == 1


def test_no_command_is_requested_once_the_local_planner_has_reached_the_goal() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.local_planner.arrives = False
    trip.steps(250)
    assert trip.place == FAR and trip.phase is GoalPhase.CONTROLLING
    trip.local_planner.arrives = True
    asked = len(trip.local_planner.asked)
    assert trip.take_step() == STILL and trip.navigation.goal == Goal(FAR, SUCCEEDED)
    assert len(trip.local_planner.asked) == asked


def test_a_goal_is_not_reached_before_there_is_a_path() -> None:
    trip = NavigationRun().goes_to(WEST)
    trip.planner.finds = False
    trip.steps(3)
    assert trip.phase is GoalPhase.PLANNING
    trip.planner.finds = True
    trip.steps(3)
    assert trip.navigation.goal == Goal(WEST, SUCCEEDED)


def test_a_new_goal_resets_timeouts_and_recoveries_and_plans_at_once() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    trip.steps(15)
    assert trip.count("recoveries") == 1
    trip.local_planner.valid = True
    assert trip.goes_to(Point(9.0, 1.0)).take_step() == AHEAD, "between two cycles of the old goal"
    trip.local_planner.valid = False
    trip.steps(18)
    assert trip.count("recoveries") == 2 and trip.status is ACTIVE


def test_keeping_changes_nothing_and_a_new_point_replaces_the_goal() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(5)
    before = trip.navigation.goal
    trip.navigation.take(GoalOrder.KEEP)
    assert trip.navigation.goal == before and trip.local_planner.begun == 1
    near = Point(1.0, 3.0)
    trip.goes_to(near).take_step()
    assert Point(*trip.local_planner.paths[-1][-1]) == near and trip.local_planner.begun == 2


def test_a_paused_robot_stands_without_timeout_until_resumed() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(3)
    trip.navigation.take(GoalOrder.KEEP, True)
    assert trip.steps(500) == [STILL] * 500
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.PAUSED, at_step(3))
    trip.navigation.take(GoalOrder.KEEP, False)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(503))
    trip.navigation.take(GoalOrder.KEEP, True)
    assert trip.count("paused") == [(at_step(2), at_step(502)), (at_step(503), None)]


def test_a_goal_of_a_paused_robot_waits_and_repeated_pauses_have_no_effect() -> None:
    trip = NavigationRun()
    trip.navigation.take(FAR, True)
    assert trip.take_step() == STILL and trip.phase is GoalPhase.PAUSED
    near = Point(1.0, 3.0)
    trip.navigation.take(near, True)
    assert trip.take_step() == STILL
    trip.navigation.take(GoalOrder.KEEP, False)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(near, ACTIVE, None, GoalPhase.CONTROLLING, at_step(2))
    trip.navigation.take(GoalOrder.KEEP, False)
    trip.take_step()
    assert trip.navigation.goal.since == at_step(2), "not restarted"


def test_marks_reach_the_planner_in_the_map_frame_if_enabled() -> None:
    door = np.array([[4.7, 1.75], [4.75, 1.6], [4.75, 1.9]])
    for marking, status in ((False, ACTIVE), (True, ABORTED)):
        trip = NavigationRun(NavigationParameters(mark_robots=marking)).goes_to(FAR)
        trip.map.marked = np.array([SHIFT.compose(Pose(x, y, 0.0))[:2] for x, y in door])
        trip.steps(17)
        assert trip.status is status


def test_a_robot_in_a_distant_door_does_not_stop_one_that_approaches_it() -> None:
    trip = NavigationRun(NAVIGATION_PRESETS["robust"]).goes_to(FAR)
    trip.take_step()
    trip.map.marked = np.array([SHIFT.compose(Pose(4.7, y, 0.0))[:2] for y in (1.4, 1.6, 1.75, 1.9, 2.1)])
    assert trip.steps(60) == [AHEAD] * 60


def test_a_robot_backs_away_after_a_contact_and_continues() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(3)
    backward = Twist(-0.1, 0.0, 0.0)
    assert trip.take_step(bumped=True) == backward and trip.phase is GoalPhase.RETREATING
    trip.place = Point(trip.place.x - 0.1, trip.place.y)
    assert trip.take_step() == backward
    trip.place = Point(trip.place.x - 0.06, trip.place.y)
    assert trip.take_step() == AHEAD
    assert trip.count("retreats") == 1


def test_a_retreat_has_a_timeout_and_needs_free_space_behind() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.take_step(bumped=True)
    assert [twist.vx < 0 for twist in trip.steps(35)] == [True] * 29 + [False] * 6
    trip.map.behind = False
    assert trip.take_step(bumped=True) == AHEAD
    assert trip.count("retreats") == 1


def test_a_robot_without_a_goal_stands_and_does_not_retreat() -> None:
    trip = NavigationRun()
    assert (trip.take_step(), trip.take_step(bumped=True), trip.navigation.goal) == (STILL, STILL, None)


def test_every_goal_is_listed_with_its_outcome() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(3)
    trip.goes_to(WEST).steps(2)
    trip.navigation.take(GoalOrder.CANCEL)
    given = trip.count("given")
    assert isinstance(given, list)
    assert [(goal.x, goal.y, goal.how) for goal in given] == [
        (*FAR, "replaced"),
        (*WEST, "succeeded"),
    ]


def test_an_interval_without_path_spans_further_attempts() -> None:
    trip = NavigationRun().goes_to(UNREACHABLE)
    trip.steps(30)
    trip.goes_to(UNREACHABLE).steps(30)
    (spell,) = cast(list[tuple[int, int]], trip.count("without_plan"))
    assert spell[1] - spell[0] > seconds(5)
    trip.goes_to(FAR).steps(2)
    (spell,) = cast(list[tuple[int, int]], trip.count("without_plan"))
    assert spell[1] <= at_step(61)


@pytest.mark.parametrize("back_off", [False, True])
def test_backing_off_begins_once_the_space_behind_is_free(back_off: bool) -> None:
    trip = NavigationRun(replace(CHAPTER, back_off=back_off)).goes_to(FAR)
    trip.local_planner.valid, trip.map.behind = False, False
    backward = Twist(-CHAPTER.retreat_speed, 0.0, 0.0)
    while not trip.count("recoveries"):
        assert trip.take_step() == STILL
    trip.map.behind = True
    assert (backward in trip.steps(3)) is back_off
    assert trip.count("retreats") == int(back_off)


@settings(max_examples=40, deadline=None)
@given(
    preset=st.sampled_from(sorted(NAVIGATION_PRESETS)),
    told=st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 25)), min_size=1, max_size=12),
)
def test_without_plan_or_trajectory_a_robot_stands(preset: str, told: list[tuple[bool, bool, int]]) -> None:
    trip = NavigationRun(NAVIGATION_PRESETS[preset]).goes_to(FAR)
    for trip.planner.finds, trip.local_planner.valid, steps in told:
        for _ in range(steps):
            twist, goal = trip.take_step(), trip.navigation.goal
            assert goal is not None
            assert (twist == AHEAD) is (goal.phase is GoalPhase.CONTROLLING)
            backs_off = goal.phase is GoalPhase.RETREATING
            assert (twist.vx < 0) is backs_off and (not backs_off or NAVIGATION_PRESETS[preset].back_off)
            assert (
                twist == STILL or backs_off or (trip.navigation.plan is not None and trip.local_planner.found)
            )


def test_without_a_path_it_replans_in_every_cycle_recovers_once_and_aborts() -> None:
    trip = NavigationRun().goes_to(UNREACHABLE)
    assert trip.steps(8) == [STILL] * 8
    assert (trip.planner.asked, trip.count("recoveries")) == (4, 0), "0, 0.2, 0.4 and 0.6 s"
    trip.take_step()
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.PLANNING, 1)
    assert trip.steps(7) == [STILL] * 7 and trip.status is ACTIVE
    trip.take_step()
    assert trip.navigation.goal == Goal(UNREACHABLE, ABORTED, AbortReason.NO_PLAN)
    assert trip.planner.asked == 7 and not trip.local_planner.asked


def test_a_new_path_resets_recoveries_for_no_plan() -> None:
    trip = NavigationRun().goes_to(FAR)
    for spell in range(1, 4):
        trip.planner.finds = trip.local_planner.valid = False
        trip.steps(10)
        assert (trip.count("recoveries"), trip.phase) == (spell, GoalPhase.PLANNING)
        trip.planner.finds = trip.local_planner.valid = True
        trip.steps(4)
    assert trip.phase is GoalPhase.CONTROLLING


def test_without_a_trajectory_it_replans_at_once_and_in_each_cycle() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    asked = []
    for _ in range(8):
        assert trip.take_step() == STILL and trip.phase is GoalPhase.OBSTRUCTED
        asked.append(trip.planner.asked)
    assert asked == [2, 2, 3, 3, 4, 4, 5, 5] and len(trip.local_planner.paths) == 5
    assert trip.local_planner.asked == [at_step(n) for n in (0, 2, 4, 6, 8)]


def test_with_marked_robots_a_missing_trajectory_does_not_cause_replanning() -> None:
    trip = NavigationRun(replace(CHAPTER, mark_robots=True)).goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    assert trip.steps(12) == [STILL] * 12 and trip.phase is GoalPhase.OBSTRUCTED
    assert trip.planner.asked == 2 and trip.navigation.plan is not None
    assert len(trip.local_planner.asked) == 7
    trip.take_step()
    assert trip.count("recoveries") == 1


def test_the_planners_timeout_starts_at_the_last_cycle_without_a_trajectory() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(30)
    trip.planner.finds = trip.local_planner.valid = False
    trip.steps(2)
    assert trip.phase is GoalPhase.OBSTRUCTED and trip.navigation.plan is None
    trip.steps(6)
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.PLANNING, 0)
    trip.take_step()
    assert trip.count("recoveries") == 1
    trip.planner.finds = True
    trip.steps(20)
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.BLOCKED), "a path, but no trajectory"
    assert trip.count("without_plan") == [(at_step(30), at_step(40))]


def test_without_a_trajectory_it_recovers_after_the_timeout() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    assert trip.steps(12) == [STILL] * 12
    assert (trip.phase, trip.map.cleared) == (GoalPhase.OBSTRUCTED, [])
    assert trip.navigation.goal is not None and trip.navigation.goal.since == at_step(2)
    trip.take_step()
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.PLANNING, 1)
    assert trip.map.cleared == [CHAPTER.reset_distance]
    trip.steps(5)
    assert trip.local_planner.asked[-2:] == [at_step(12), at_step(18)]
    assert trip.status is ACTIVE
    trip.take_step()
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.BLOCKED) and trip.step == 21
    assert trip.count("no_valid_trajectory") == [(at_step(2), at_step(20), "abort")]
    assert trip.count("aborted") == {"no plan": 0, "blocked": 1, "no progress": 0}


def test_an_obstacle_that_leaves_in_time_resets_timeouts() -> None:
    trip = NavigationRun().goes_to(FAR)
    for _ in range(3):
        trip.local_planner.valid = True
        trip.steps(2)
        trip.local_planner.valid = False
        trip.steps(16)  # long enough for a recovery
    trip.local_planner.valid = True
    trip.steps(3)
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.CONTROLLING, 3)
    spells = [(2, 18, "itself"), (20, 36, "itself"), (38, 54, "itself")]
    assert trip.count("no_valid_trajectory") == [(at_step(a), at_step(b), how) for a, b, how in spells]


@pytest.mark.parametrize(("preset", "left"), [("chapter", 3), ("robust", 2)])
def test_a_recovery_of_the_chapters_robot_clears_nothing(preset: str, left: int) -> None:
    local = CostMap(model().sensor, 0.177)
    ranges = np.full(model().sensor.rays, NO_ECHO_MM, np.uint16)
    ranges[[0, 45, 90]] = 1000, 1400, 1900
    local.take(Instant(0), HERE, Sweep(ranges, HERE))
    assert len(local.marks()) == 3
    local.clear(NAVIGATION_PRESETS[preset].reset_distance)
    assert len(local.marks()) == left


def test_a_robot_without_progress_recovers_and_then_aborts() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.drifts = False
    assert trip.steps(104) == [AHEAD] * 104, "the cycle after 10 s still has a command"
    assert (trip.count("recoveries"), trip.phase) == (0, GoalPhase.CONTROLLING)
    assert trip.steps(4) == [STILL] * 4
    assert (trip.count("recoveries"), trip.phase) == (1, GoalPhase.PLANNING)
    assert trip.steps(100) == [AHEAD] * 100
    trip.take_step()
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.NO_PROGRESS) and trip.step == 209


def test_a_robot_without_trajectory_does_not_recover_for_lack_of_progress() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.drifts = False
    trip.steps(102)
    trip.local_planner.valid = False
    trip.steps(10)
    trip.local_planner.valid = True
    trip.take_step()
    assert (trip.count("recoveries"), trip.phase) == (0, GoalPhase.CONTROLLING)
    trip.steps(2)
    assert trip.count("recoveries") == 1


@pytest.mark.parametrize(("moved", "recoveries"), [(0.25, 0), (0.2499, 1)])
def test_progress_requires_the_oscillation_distance(moved: float, recoveries: int) -> None:
    trip = NavigationRun(replace(CHAPTER, oscillation_distance=0.25)).goes_to(FAR)
    trip.drifts = False
    trip.steps(80)
    trip.place = Point(WEST.x + moved, WEST.y)
    trip.steps(40)
    assert trip.count("recoveries") == recoveries


def test_a_new_goal_restarts_the_timeout_but_keeps_the_anchor() -> None:
    trip = NavigationRun(replace(CHAPTER, oscillation_distance=0.25)).goes_to(FAR)
    trip.drifts = False
    trip.steps(80)
    trip.place = Point(WEST.x + 0.125, WEST.y)
    trip.goes_to(FAR).steps(90)
    assert trip.count("recoveries") == 0
    trip.place = Point(WEST.x + 0.25, WEST.y)
    trip.steps(90)
    assert trip.count("recoveries") == 0


def test_progress_resets_recoveries() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.drifts = False
    trip.steps(102)
    trip.drifts = True
    trip.steps(10)
    trip.drifts = False
    trip.steps(110)
    assert (trip.status, trip.count("recoveries")) == (ACTIVE, 2)


@pytest.mark.parametrize("recoveries", [0, 2])
def test_the_number_of_recoveries_is_a_parameter(recoveries: int) -> None:
    trip = NavigationRun(NavigationParameters(recoveries=recoveries)).goes_to(UNREACHABLE)
    trip.steps(40)
    assert trip.navigation.goal == Goal(UNREACHABLE, ABORTED, AbortReason.NO_PLAN)
    assert len(trip.map.cleared) == recoveries


def test_an_aborted_goal_can_be_requested_again() -> None:
    trip = NavigationRun().goes_to(FAR)
    trip.local_planner.valid = False
    trip.steps(20)
    trip.local_planner.valid = True
    trip.goes_to(FAR)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(20))
    assert trip.local_planner.begun == 2
