"""Stories of goals that are recovered from and given up, as in move_base: why, when, and how often."""

from dataclasses import replace

import numpy as np
import pytest

from actors.geometry import STILL, Point
from actors.instant import Instant
from actors.messages import NO_ECHO_MM
from actors.robot.behaviour.goal import AbortReason, Goal, GoalPhase
from actors.robot.cost_maps.cost_map import CostMap
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.sweep import Sweep
from tests.robot.base import at_step, model
from tests.robot.trip import ABORTED, ACTIVE, AHEAD, CHAPTER, FAR, HERE, NOWHERE, WEST, Trip


def test_without_a_way_it_looks_for_one_in_every_cycle_recovers_once_and_then_gives_up() -> None:
    trip = Trip().goes_to(NOWHERE)
    assert trip.steps(8) == [STILL] * 8
    assert (trip.planner.asked, trip.count("recoveries")) == (4, 0), "0, 0.2, 0.4 and 0.6 s"
    trip.take_step()
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.PLANNING, 1)
    assert trip.steps(7) == [STILL] * 7 and trip.status is ACTIVE
    trip.take_step()
    assert trip.navigation.goal == Goal(NOWHERE, ABORTED, AbortReason.NO_PLAN)
    assert trip.planner.asked == 7 and not trip.local_planner.asked


def test_a_way_found_gives_the_recovery_back_that_was_made_to_find_one() -> None:
    trip = Trip().goes_to(FAR)
    for spell in range(1, 4):
        trip.planner.finds = trip.local_planner.valid = False
        trip.steps(10)
        assert (trip.count("recoveries"), trip.phase) == (spell, GoalPhase.PLANNING)
        trip.planner.finds = trip.local_planner.valid = True
        trip.steps(4)
    assert trip.phase is GoalPhase.CONTROLLING


def test_without_a_trajectory_it_plans_at_once_and_once_per_cycle() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    asked = []
    for _ in range(8):
        assert trip.take_step() == STILL and trip.phase is GoalPhase.OBSTRUCTED
        asked.append(trip.planner.asked)
    assert asked == [2, 2, 3, 3, 4, 4, 5, 5] and len(trip.local_planner.ways) == 5
    assert trip.local_planner.asked == [at_step(n) for n in (0, 2, 4, 6, 8)]


def test_who_plans_round_others_waits_for_the_next_plan_while_there_is_no_trajectory() -> None:
    trip = Trip(replace(CHAPTER, mark_robots=True)).goes_to(FAR)
    trip.steps(2)
    trip.local_planner.valid = False
    assert trip.steps(12) == [STILL] * 12 and trip.phase is GoalPhase.OBSTRUCTED
    assert trip.planner.asked == 2 and trip.navigation.plan is not None
    assert len(trip.local_planner.asked) == 7
    trip.take_step()
    assert trip.count("recoveries") == 1


def test_patience_for_a_way_counts_from_the_last_cycle_without_a_trajectory() -> None:
    trip = Trip().goes_to(FAR)
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
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.BLOCKED), "the way was there, no trajectory"
    assert trip.count("without_plan") == [(at_step(30), at_step(40))]


def test_without_a_trajectory_it_clears_the_map_after_its_patience_and_tries_once_more() -> None:
    trip = Trip().goes_to(FAR)
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


def test_what_goes_away_in_time_costs_no_goal_and_all_patience_is_back() -> None:
    trip = Trip().goes_to(FAR)
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
def test_to_recover_the_chapters_robot_forgets_nothing(preset: str, left: int) -> None:
    local = CostMap(model().sensor, 0.177)
    ranges = np.full(model().sensor.rays, NO_ECHO_MM, np.uint16)
    ranges[[0, 45, 90]] = 1000, 1400, 1900
    local.take(Instant(0), HERE, Sweep(ranges, HERE))
    assert len(local.marks()) == 3
    local.clear(NAVIGATION_PRESETS[preset].reset_distance)
    assert len(local.marks()) == left


def test_who_does_not_get_away_recovers_and_then_gives_up() -> None:
    trip = Trip().goes_to(FAR)
    trip.drifts = False
    assert trip.steps(104) == [AHEAD] * 104, "the cycle after 10 s still has a command"
    assert (trip.count("recoveries"), trip.phase) == (0, GoalPhase.CONTROLLING)
    assert trip.steps(4) == [STILL] * 4
    assert (trip.count("recoveries"), trip.phase) == (1, GoalPhase.PLANNING)
    assert trip.steps(100) == [AHEAD] * 100
    trip.take_step()
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.NO_PROGRESS) and trip.step == 209


def test_who_does_not_get_away_for_want_of_a_trajectory_does_not_recover_for_it() -> None:
    trip = Trip().goes_to(FAR)
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
def test_it_has_got_away_once_it_is_at_the_distance(moved: float, recoveries: int) -> None:
    trip = Trip(replace(CHAPTER, oscillation_distance=0.25)).goes_to(FAR)
    trip.drifts = False
    trip.steps(80)
    trip.place = Point(WEST.x + moved, WEST.y)
    trip.steps(40)
    assert trip.count("recoveries") == recoveries


def test_a_new_goal_starts_the_clock_but_keeps_the_place_from_which_it_must_get_away() -> None:
    trip = Trip(replace(CHAPTER, oscillation_distance=0.25)).goes_to(FAR)
    trip.drifts = False
    trip.steps(80)
    trip.place = Point(WEST.x + 0.125, WEST.y)
    trip.goes_to(FAR).steps(90)
    assert trip.count("recoveries") == 0
    trip.place = Point(WEST.x + 0.25, WEST.y)
    trip.steps(90)
    assert trip.count("recoveries") == 0


def test_getting_away_gives_the_recovery_back() -> None:
    trip = Trip().goes_to(FAR)
    trip.drifts = False
    trip.steps(102)
    trip.drifts = True
    trip.steps(10)
    trip.drifts = False
    trip.steps(110)
    assert (trip.status, trip.count("recoveries")) == (ACTIVE, 2)


@pytest.mark.parametrize("recoveries", [0, 2])
def test_recoveries_are_as_many_as_the_parameters_say(recoveries: int) -> None:
    trip = Trip(NavigationParameters(recoveries=recoveries)).goes_to(NOWHERE)
    trip.steps(40)
    assert trip.navigation.goal == Goal(NOWHERE, ABORTED, AbortReason.NO_PLAN)
    assert len(trip.map.cleared) == recoveries


def test_a_goal_that_was_given_up_can_be_asked_for_again() -> None:
    trip = Trip().goes_to(FAR)
    trip.local_planner.valid = False
    trip.steps(20)
    trip.local_planner.valid = True
    trip.goes_to(FAR)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(20))
    assert trip.local_planner.begun == 2
