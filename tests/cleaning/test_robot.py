"""Stories of the adapted layer: one robot, its places, and navigation."""

from dataclasses import replace

import pytest

from actors.geometry import Point, Pose
from actors.robot.behaviour import AbortReason
from actors.task.task import PlaceKey
from cleaning.parameters import CleaningParameters
from cleaning.place import RESTART_TERM
from cleaning.robot import CleaningRobot
from tests.cleaning.equipment import NOW, SOMEWHERE, Base, Notes, Tasks, Ways, assignment, plain


def keys(*places: int) -> list[PlaceKey]:
    return [PlaceKey("r1", place) for place in places]


def at(robot: CleaningRobot, x: float) -> CleaningRobot:
    return replace(robot, position=Point(x, 0.0))


def test_it_takes_its_places_in_order() -> None:
    notes = Notes()
    robot = plain(5.0, 10.0).set_destination(notes, NOW)
    assert robot.destination == assignment(5.0) and notes.visits == []
    plain(5.0, 10.0).report_status(notes)
    assert notes.left == tuple(keys(0, 1))
    assert at(robot, 4.5).set_destination(notes, NOW) == at(robot, 4.5), "0.5 m away is not there"
    robot = at(robot, 4.51).set_destination(notes, NOW)
    assert robot.destination == assignment(10.0, 1) and notes.visits == keys(0)
    assert robot.route == (assignment(10.0, 1),) and robot.has_settled(PlaceKey("r1", 0))
    robot = at(robot, 10.49).set_destination(notes, NOW)
    assert (robot.destination, robot.route, notes.visits) == (None, (), keys(0, 1))


def test_places_it_passes_are_visited_too_and_the_destination_stays() -> None:
    notes = Notes()
    robot = plain(5.0, 10.0, 2.0).set_destination(notes, NOW)
    robot = at(robot, 2.2).set_destination(notes, NOW)
    assert notes.visits == keys(2)
    assert robot.destination == assignment(5.0) and robot.route == (assignment(5.0), assignment(10.0, 1))


def test_places_that_it_is_given_come_last_in_its_route_and_once() -> None:
    tasks = Tasks((Point(5.0, 0.0),), at_start=1)
    robot = plain(5.0)
    assert robot.take_on(tasks) is robot
    tasks.places += (Point(8.0, 0.0), Point(9.0, 0.0))
    robot = robot.take_on(tasks)
    assert robot.route == (assignment(5.0), assignment(8.0, 1), assignment(9.0, 2))
    assert robot.take_on(tasks) is robot
    tasks.places += (Point(3.0, 0.0),)
    assert robot.take_on(tasks).route[3:] == (assignment(3.0, 3),)


def test_a_robot_that_was_restarted_holds_them_by_a_later_word() -> None:
    robot = plain().take_on(Tasks((Point(8.0, 0.0),), at_start=0, epoch=2))
    assert robot.route == (assignment(8.0, 0, term=2 * RESTART_TERM),)


@pytest.mark.parametrize(("retry", "orders"), [(True, 3), (False, 2)])
def test_navigation_is_told_once_per_attempt_and_again_when_it_gave_up(retry: bool, orders: int) -> None:
    ways, notes = Ways(), Notes()
    robot = replace(plain(5.0), parameters=CleaningParameters(retry=retry))
    robot = robot.sense(Base(Pose(3.0, 4.0, 1.0))).set_destination(notes, NOW)
    assert robot.position == Point(3.0, 4.0)
    robot = robot.drive(ways, notes, NOW).drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0)]
    robot = robot.heading_for(robot.route[0]).drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0)] * 2
    ways.abort()
    robot.drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0)] * orders


def test_after_its_last_place_it_drives_up_to_it() -> None:
    ways, notes = Ways(), Notes()
    robot = plain(5.0).set_destination(notes, NOW).drive(ways, notes, NOW)
    robot = at(robot, 4.6).set_destination(notes, NOW).drive(ways, notes, NOW)
    assert robot.target is None and ways.orders == [Point(5.0, 0.0)]


def test_who_is_told_to_head_for_nothing_stops_once() -> None:
    ways, notes = Ways(), Notes()
    robot = plain(5.0).set_destination(notes, NOW).drive(ways, notes, NOW)
    robot = robot.heading_for(None).drive(ways, notes, NOW).drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0), None]
    robot.set_destination(notes, NOW).drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0), None, Point(5.0, 0.0)]


def test_sent_anywhere_it_goes_there_first_and_has_no_destination_to_publish() -> None:
    ways, notes = Ways(), Notes()
    robot = plain(5.0).set_destination(notes, NOW).sent_to(SOMEWHERE)
    robot = robot.set_destination(notes, NOW).drive(ways, notes, NOW)
    assert robot.destination is None and ways.orders == [SOMEWHERE]
    robot = replace(robot, position=SOMEWHERE).set_destination(notes, NOW)
    assert robot.destination == assignment(5.0) and robot.waypoint is None


def test_a_place_given_up_leaves_the_route_and_is_never_a_destination_again() -> None:
    notes = Notes()
    robot = plain(5.0, 10.0).set_destination(notes, NOW)
    robot = robot.given_up(robot.route[0], "the door is shut", notes, NOW)
    assert notes.gone == [(PlaceKey("r1", 0), "the door is shut")]
    assert robot.destination is None and robot.route == (assignment(10.0, 1),)
    assert robot.has_settled(PlaceKey("r1", 0)) and not robot.holds(PlaceKey("r1", 0))
    other = plain(5.0, 10.0).set_destination(notes, NOW)
    other = other.given_up(other.route[1], "the door is shut", notes, NOW)
    assert other.destination == assignment(5.0) and other.attempt == 0


@pytest.mark.parametrize("attempts", [0, 1, 3])
def test_a_place_to_which_there_is_no_way_is_given_up_after_so_many_attempts(attempts: int) -> None:
    ways, notes = Ways(), Notes()
    robot = replace(plain(5.0), parameters=CleaningParameters(no_plan_attempts=attempts))
    robot = robot.set_destination(notes, NOW).drive(ways, notes, NOW)
    for _ in range(5):
        if ways.goal is not None:
            ways.abort(AbortReason.NO_PLAN)
        robot = robot.set_destination(notes, NOW).drive(ways, notes, NOW)
    tries = {0: "", 1: "1 times in a row", 3: "3 times in a row"}[attempts]
    expected = [(PlaceKey("r1", 0), f"navigation found no way to it, {tries}")] if attempts else []
    assert notes.gone == expected
    assert sum(order is not None for order in ways.orders) == (attempts or 6)


def test_other_reasons_than_no_plan_do_not_count() -> None:
    ways, notes = Ways(), Notes()
    robot = replace(plain(5.0), parameters=CleaningParameters(no_plan_attempts=2))
    robot = robot.set_destination(notes, NOW).drive(ways, notes, NOW)
    for reason in (AbortReason.NO_PLAN, AbortReason.BLOCKED, AbortReason.NO_PLAN):
        ways.abort(reason)
        robot = robot.drive(ways, notes, NOW)
    assert notes.gone == [] and robot.no_plans == 1
