"""Stories of the adaptation layer of one robot: it finds out that it is stuck, and what it does then."""

from collections import Counter
from dataclasses import replace

import pytest

from actors.geometry import Point
from actors.instant import Instant, seconds
from actors.randomness import generator
from actors.task.task import PlaceKey
from cleaning.adaptive import AdaptiveCleaningRobot, HeardPeer
from cleaning.adoption import PeerMask
from cleaning.cleaner import State
from cleaning.parameters import AdaptationParameters, ReleasedParameters, Unblock
from tests.cleaning.equipment import NOW, SOMEWHERE, Base, Floor, Notes, adaptive, assignment

MASKING = AdaptationParameters(peer_mask=True)
NEAR, FAR = adaptive("r2", 3.0), adaptive("r3", 30.0)


def _masking() -> AdaptiveCleaningRobot:
    return replace(adaptive("r1", 0.0), parameters=MASKING)


def test_peers_within_the_distance_are_noted_the_newest_word_of_each() -> None:
    mask, robot = PeerMask(6.5), _masking()
    assert mask.membership(NEAR, robot) and not mask.membership(FAR, robot)
    robot = mask.at_member(NEAR, robot, NOW)
    later = replace(NEAR, position=Point(2.5, 0.0))
    robot = mask.at_member(later, mask.at_member(FAR, robot, NOW), Instant(NOW + seconds(1)))
    assert robot.peers == (
        HeardPeer("r3", FAR.position, NOW),
        HeardPeer("r2", Point(2.5, 0.0), Instant(NOW + seconds(1))),
    )


def test_the_localiser_is_told_and_old_word_is_forgotten() -> None:
    base = Base()
    robot = PeerMask(6.5).at_member(NEAR, _masking(), NOW)
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3)))
    assert base.peers == [NEAR.position] and robot.peers
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3.5)))
    assert base.peers == [] and robot.peers == ()


def test_who_does_not_mask_says_nothing() -> None:
    base = Base()
    adaptive("r1", 0.0).disregard_peers(base, NOW)
    assert base.peers is None


RNG = generator(5, "behaviour", "r1", 0)
WHOLE = AdaptationParameters()


def checked(robot: AdaptiveCleaningRobot, times: int, notes: Notes | None = None) -> AdaptiveCleaningRobot:
    """The robot after so many seconds without moving."""
    for _ in range(times):
        robot = robot.detect_blocked().auto_unblock(Floor(), RNG, notes or Notes(), NOW)
    return robot


def stuck(parameters: AdaptationParameters = WHOLE, *xs: float) -> AdaptiveCleaningRobot:
    """A robot that unblocks itself at the next check."""
    robot = replace(adaptive("r1", 0.0, *(xs or (5.0, 9.0))), parameters=parameters)
    robot = checked(robot, 1 + parameters.still_checks + parameters.blocked_checks)
    assert robot.is_blocked() and robot.blocked_for == parameters.blocked_checks
    return robot


def test_it_is_blocked_at_the_fourth_still_second_after_the_first_look() -> None:
    states = [checked(adaptive("r1", 0.0, 5.0), seconds).state for seconds in range(7)]
    assert states == [State.FREE] * 5 + [State.BLOCKED] * 2
    assert checked(adaptive("r1", 0.0, 5.0).sent_to(SOMEWHERE), 5).is_blocked(), "on its way to any point"


def test_a_centimetre_per_second_is_moving() -> None:
    robot = adaptive("r1", 0.0, 5.0)
    for check in range(9):
        robot = replace(robot, position=Point(0.0101 * check, 0.0)).detect_blocked()
    assert robot.state is State.FREE and robot.still_for == 0
    for check in range(9):
        robot = replace(robot, position=Point(0.1 + 0.0099 * check, 0.0)).detect_blocked()
    assert robot.state is State.BLOCKED


def test_who_has_arrived_or_wants_nowhere_is_not_blocked() -> None:
    assert checked(adaptive("r1", 4.6, 5.0), 9).state is State.FREE
    idle = replace(adaptive("r1", 0.0), state=State.BLOCKED, still_for=9, blocked_for=3)
    assert idle.detect_blocked().state is State.FREE


def test_after_seven_blocked_seconds_it_turns_to_a_place_of_its_queue() -> None:
    turned = checked(stuck(), 1)
    assert turned.attempt == 1 and turned.destination in turned.route and turned.waypoint is None
    assert (turned.state, turned.blocked_for, turned.still_for) == (State.FREE, 0, 0)
    states = [checked(stuck(), seconds).state for seconds in range(1, 6)]
    assert states == [State.FREE] * 4 + [State.BLOCKED], "watched from the beginning"


def test_every_place_of_the_queue_is_as_likely_the_present_one_too() -> None:
    chosen = Counter(checked(stuck(WHOLE, 5.0, 7.0, 9.0), 1).destination for _ in range(300))
    assert len(chosen) == 3 and min(chosen.values()) > 70  # 100 ± 8 each


def test_by_the_code_it_is_blocked_again_within_a_second() -> None:
    turned = checked(stuck(ReleasedParameters()), 1)
    assert turned.state is State.FREE
    assert checked(turned, 1).state is State.BLOCKED


def test_by_the_code_it_mostly_turns_to_any_point_of_the_floor() -> None:
    turns = Counter(checked(stuck(ReleasedParameters()), 1).waypoint for _ in range(300))
    assert turns[SOMEWHERE] == pytest.approx(200, abs=30)  # 2 in 3, ± 8
    assert set(turns) == {SOMEWHERE, None}


@pytest.mark.parametrize("unblock", Unblock)
def test_an_empty_route_is_no_crash(unblock: Unblock) -> None:
    robot = replace(
        adaptive("r1", 0.0).sent_to(Point(5.0, 5.0)), parameters=AdaptationParameters(unblock=unblock)
    )
    turned = checked(checked(robot, 10), 1)
    there = {Unblock.FLOOR: SOMEWHERE, Unblock.QUEUE: Point(5.0, 5.0)}[unblock]
    assert (turned.waypoint, turned.attempt, turned.state) == (there, 2, State.FREE)


def test_it_gives_a_place_up_after_so_many_attempts_and_goes_on_with_the_next() -> None:
    notes = Notes()
    robot = replace(adaptive("r1", 0.0, 5.0), parameters=AdaptationParameters(attempts=3))
    robot = checked(robot, 40, notes)
    assert notes.gone == [
        (PlaceKey("r1", 0), "blocked on the way to it, 3 times without visiting any place meanwhile")
    ]
    assert (robot.route, robot.destination, robot.state) == ((), None, State.FREE)


def test_of_two_places_that_it_gives_up_each_has_had_its_attempts() -> None:
    notes = Notes()
    robot = replace(adaptive("r1", 0.0, 5.0, 9.0), parameters=AdaptationParameters(attempts=3))
    attempts = []
    for _ in range(200):
        left = len(notes.gone)
        robot = checked(robot, 1, notes)
        if len(notes.gone) > left:
            attempts.append(robot.attempt)
        robot = robot if robot.destination or not robot.route else robot.heading_for(robot.route[0])
    assert len(notes.gone) == 2 and robot.route == ()
    assert attempts[0] >= 3 and attempts[1] >= 5


def test_visiting_any_place_is_progress() -> None:
    notes = Notes()
    robot = replace(stuck(AdaptationParameters(attempts=2)), destination=assignment(5.0))
    robot = checked(robot, 1, notes)
    assert len(robot.tried) == 1
    robot = replace(robot, position=Point(9.0, 0.0)).set_destination(notes, NOW)
    assert robot.tried == () and notes.visits == [PlaceKey("r1", 1)]
