"""Stories of goals: reached, given up for each reason, replaced, paused; the local planner obeys a test."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, seconds
from actors.robot.behaviour.goal import AbortReason, Goal, GoalOrder, GoalPhase, GoalStatus
from actors.robot.navigation.local_planner import Steering
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters, Navigator
from actors.robot.navigation.planning import Planner, ground
from actors.robot.sweep import Sweep
from tests.robot.base import TWO_ROOMS, at_step

FLOOR = ground(TWO_ROOMS, 0.177)
WEST, FAR = Point(1.0, 1.0), Point(9.0, 3.0)
NOWHERE = Point(30.0, 1.0)
AHEAD = Twist(0.5, 0.0, 0.0)
CHAPTER = NAVIGATION_PRESETS["chapter"]
ACTIVE, SUCCEEDED, ABORTED = GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED
SHIFT = Pose(-3.0, 2.0, 1.0)
"""The map's origin in the odometry frame."""


class Obedient:
    """A local planner that finds what it is told to find."""

    def __init__(self) -> None:
        self.valid = True
        self.ways: list[NDArray[np.float64]] = []
        self.begun = 0

    def begin(self) -> None:
        self.begun += 1

    def follow(self, way: NDArray[np.float64]) -> None:
        self.ways.append(way)

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        return Steering(AHEAD if self.valid else STILL, self.valid)


class Memory:
    """A local map that is told what it holds."""

    def __init__(self) -> None:
        self.cleared: list[float] = []
        self.marked = np.empty((0, 2))
        self.behind = True

    def take(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Needs no scan."""

    def clear(self, beyond: float) -> None:
        self.cleared.append(beyond)

    def marks(self) -> NDArray[np.float64]:
        return self.marked

    def free_behind(self, here: Pose, distance: float, *, touching: bool = False) -> bool:
        return self.behind


class Trip:
    """A robot that is carried about; `drift` says whether it gets about by itself."""

    def __init__(self, parameters: NavigationParameters = CHAPTER) -> None:
        self.local_planner, self.map = Obedient(), Memory()
        self.navigation = Navigator(Planner(FLOOR), self.map, self.local_planner, parameters)
        self.place = WEST
        self.step = 0
        self.drifts = True

    def take_step(self, bumped: bool = False) -> Twist:
        estimate = Pose(self.place.x, self.place.y, 0.5)
        here = SHIFT.compose(estimate)
        twist = self.navigation.advance(at_step(self.step), here, estimate, STILL, bumped)
        if self.drifts and twist == AHEAD:
            way = self.local_planner.ways[-1]
            nearest = int(np.hypot(*(way - np.array(self.place)).T).argmin())
            self.place = Point(*way[min(nearest + 1, len(way) - 1)].tolist())
        self.step += 1
        return twist

    def steps(self, number: int) -> list[Twist]:
        return [self.take_step() for _ in range(number)]

    def goes_to(self, goal: Point) -> "Trip":
        self.navigation.take(goal)
        return self

    @property
    def phase(self) -> GoalPhase | None:
        assert self.navigation.goal is not None
        return self.navigation.goal.phase

    def count(self, name: str) -> object:
        return self.navigation.outcome()[name]


def test_without_a_goal_it_stands() -> None:
    trip = Trip()
    assert trip.take_step() == STILL and trip.navigation.goal is None


def test_a_goal_is_followed_to_within_the_tolerance() -> None:
    trip = Trip().goes_to(FAR)
    assert trip.navigation.goal == Goal(FAR, ACTIVE)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(0))
    trip.steps(250)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)
    assert trip.place.distance_to(FAR) <= 0.15
    assert trip.take_step() == STILL
    assert (trip.count("goals"), trip.count("succeeded")) == (1, 1)


def test_the_way_is_planned_anew_every_second() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(41)
    assert len(trip.local_planner.ways) == 5 and trip.local_planner.begun == 1


def test_without_a_way_it_recovers_once_and_then_gives_up() -> None:
    trip = Trip().goes_to(NOWHERE)
    assert trip.steps(7) == [STILL] * 7
    assert (trip.phase, trip.map.cleared) == (GoalPhase.PLANNING, [3.0])
    trip.steps(6)
    assert trip.navigation.goal == Goal(NOWHERE, ABORTED, AbortReason.NO_PLAN)
    assert trip.step == 13, "0.5 s of patience exceeded, and once more"


def test_without_a_trajectory_it_clears_the_map_after_its_patience_and_tries_once_more() -> None:
    trip = Trip().goes_to(FAR)
    trip.take_step()
    trip.local_planner.valid = False
    assert trip.steps(10) == [STILL] * 10
    assert (trip.phase, trip.map.cleared) == (GoalPhase.OBSTRUCTED, [])
    assert trip.navigation.goal is not None and trip.navigation.goal.since == at_step(1)
    trip.take_step()
    assert (trip.phase, trip.map.cleared, trip.count("recoveries")) == (GoalPhase.PLANNING, [3.0], 1)
    trip.take_step()
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.BLOCKED)
    assert trip.count("no_valid_trajectory") == [(at_step(1), at_step(12), "abort")]
    assert trip.count("aborted") == {"no plan": 0, "blocked": 1, "no progress": 0}


def test_what_goes_away_in_time_costs_no_goal_and_all_patience_is_back() -> None:
    trip = Trip().goes_to(FAR)
    for _ in range(3):
        trip.local_planner.valid = True
        trip.steps(2)
        trip.local_planner.valid = False
        trip.steps(11)  # long enough for a recovery
    trip.local_planner.valid = True
    trip.steps(3)
    assert (trip.phase, trip.count("recoveries")) == (GoalPhase.CONTROLLING, 3)
    spells = [(2, 13, "itself"), (15, 26, "itself"), (28, 39, "itself")]
    assert trip.count("no_valid_trajectory") == [(at_step(a), at_step(b), how) for a, b, how in spells]


def test_who_does_not_get_away_recovers_and_then_gives_up() -> None:
    trip = Trip().goes_to(FAR)
    trip.drifts = False
    trip.steps(102)
    assert (trip.map.cleared, trip.phase) == ([3.0], GoalPhase.PLANNING)
    trip.steps(101)
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.NO_PROGRESS)
    assert trip.step == 203


def test_getting_away_gives_the_recovery_back() -> None:
    trip = Trip().goes_to(FAR)
    trip.drifts = False
    trip.steps(102)
    trip.drifts = True
    trip.steps(10)
    trip.drifts = False
    trip.steps(110)
    assert trip.navigation.goal is not None and trip.navigation.goal.status is ACTIVE
    assert trip.count("recoveries") == 2


@pytest.mark.parametrize("recoveries", [0, 2])
def test_recoveries_are_as_many_as_the_parameters_say(recoveries: int) -> None:
    trip = Trip(NavigationParameters(recoveries=recoveries)).goes_to(NOWHERE)
    trip.steps(30)
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


def test_a_cancelled_goal_is_gone_and_its_spell_ends_with_the_order() -> None:
    trip = Trip().goes_to(FAR)
    trip.local_planner.valid = False
    trip.steps(4)
    trip.navigation.take(GoalOrder.CANCEL)
    assert trip.navigation.goal is None and trip.take_step() == STILL
    assert trip.count("no_valid_trajectory") == [(at_step(0), at_step(3), "order")]
    assert trip.count("cancelled") == 1


def test_a_spell_that_lasts_ends_with_the_run() -> None:
    trip = Trip().goes_to(FAR)
    trip.local_planner.valid = False
    trip.steps(4)
    assert trip.count("no_valid_trajectory") == [(at_step(0), at_step(3), "run")]


def test_keeping_changes_nothing_and_a_new_point_replaces_the_goal() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(5)
    before = trip.navigation.goal
    trip.navigation.take(GoalOrder.KEEP)
    assert trip.navigation.goal == before and trip.local_planner.begun == 1
    near = Point(1.0, 3.0)
    trip.goes_to(near).take_step()
    assert Point(*trip.local_planner.ways[-1][-1]) == near and trip.local_planner.begun == 2


def test_a_paused_robot_stands_for_as_long_as_it_takes_and_then_goes_on() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(3)
    trip.navigation.take(GoalOrder.KEEP, True)
    assert trip.steps(500) == [STILL] * 500
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.PAUSED, at_step(3))
    trip.navigation.take(GoalOrder.KEEP, False)
    assert trip.take_step() == AHEAD
    assert trip.navigation.goal == Goal(FAR, ACTIVE, None, GoalPhase.CONTROLLING, at_step(503))


def test_a_goal_given_to_a_paused_robot_waits_and_saying_it_twice_changes_nothing() -> None:
    trip = Trip()
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
    assert trip.navigation.goal.since == at_step(2), "not begun anew"


def test_marks_reach_the_plan_in_the_frame_of_the_map_if_it_is_to_know_them() -> None:
    door = np.array([[4.7, 1.75], [4.75, 1.6], [4.75, 1.9]])
    for marking, status in ((False, ACTIVE), (True, ABORTED)):
        trip = Trip(NavigationParameters(mark_robots=marking)).goes_to(FAR)
        trip.map.marked = np.array([SHIFT.compose(Pose(x, y, 0.0))[:2] for x, y in door])
        trip.steps(14)
        assert trip.navigation.goal is not None and trip.navigation.goal.status is status


def test_a_robot_that_touches_something_backs_away_and_goes_on() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(3)
    backward = Twist(-0.1, 0.0, 0.0)
    assert trip.take_step(bumped=True) == backward and trip.phase is GoalPhase.RETREATING
    trip.place = Point(trip.place.x - 0.1, trip.place.y)
    assert trip.take_step() == backward
    trip.place = Point(trip.place.x - 0.06, trip.place.y)
    assert trip.take_step() == AHEAD
    assert trip.count("retreats") == 1


def test_a_retreat_ends_in_time_and_does_not_begin_with_something_behind() -> None:
    trip = Trip().goes_to(FAR)
    trip.take_step(bumped=True)
    assert [twist.vx < 0 for twist in trip.steps(35)] == [True] * 29 + [False] * 6
    trip.map.behind = False
    assert trip.take_step(bumped=True) == AHEAD
    assert trip.count("retreats") == 1


def test_a_robot_without_a_goal_does_not_retreat() -> None:
    assert Trip().take_step(bumped=True) == STILL


def test_the_chapters_preset_is_what_is_assumed() -> None:
    assert NavigationParameters() == CHAPTER and CHAPTER.controller_patience == seconds(1)


def test_every_goal_is_listed_with_what_became_of_it() -> None:
    trip = Trip().goes_to(FAR)
    trip.steps(3)
    trip.goes_to(WEST).steps(2)
    trip.navigation.take(GoalOrder.CANCEL)
    given = trip.count("given")
    assert isinstance(given, list)
    assert [(goal["x"], goal["y"], goal["how"]) for goal in given] == [
        (*FAR, "replaced"),
        (*WEST, "succeeded"),
    ]


def test_without_a_way_the_spell_lasts_through_further_attempts() -> None:
    trip = Trip().goes_to(NOWHERE)
    trip.steps(30)
    trip.goes_to(NOWHERE).steps(30)
    (spell,) = cast(list[tuple[int, int]], trip.count("without_plan"))
    assert spell[1] - spell[0] > seconds(5)
    trip.goes_to(FAR).steps(2)
    (spell,) = cast(list[tuple[int, int]], trip.count("without_plan"))
    assert spell[1] <= at_step(61)


@pytest.mark.parametrize("back_off", [False, True])
def test_who_backs_off_does_so_once_nothing_is_behind(back_off: bool) -> None:
    trip = Trip(replace(CHAPTER, back_off=back_off)).goes_to(FAR)
    trip.local_planner.valid, trip.map.behind = False, False
    backward = Twist(-CHAPTER.retreat_speed, 0.0, 0.0)
    while not trip.count("recoveries"):
        assert trip.take_step() == STILL
    trip.map.behind = True
    assert (backward in trip.steps(3)) is back_off
    assert trip.count("retreats") == int(back_off)
