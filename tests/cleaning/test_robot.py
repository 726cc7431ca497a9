"""Cleaning robots: places and navigation, detection of blocking, and ensembles of two robots."""

from collections import Counter
from dataclasses import replace
from functools import partial

import pytest

from acrc_testbed.testing import LoggedNavigation, ScriptedPositioning
from actors.geometry import Point, Pose
from actors.instant import Instant, seconds
from actors.items import ItemKey
from actors.randomness import generator
from actors.robot.behaviour import AbortReason
from actors.robot.behaviour.node_host import RobotTaskList
from cleaning.adaptive import AdaptiveCleaningRobot, PeerPosition
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption, MakingWay, PeerMask
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters, CleaningParameters, ReleasedParameters, UnblockTarget
from cleaning.place import RESTART_TERM, Takeover
from cleaning.robot import CleaningRobot
from tests.cleaning.fakes import (
    HERE,
    NOW,
    OPEN,
    FakeTaskMonitor,
    adaptive,
    assignment,
    plain,
    published,
    route,
)

AWAY = Point(20.0, 7.0)


def keys(*places: int) -> list[ItemKey]:
    return [ItemKey("r1", place) for place in places]


def at(robot: CleaningRobot, x: float) -> CleaningRobot:
    return replace(robot, position=Point(x, 0.0))


def test_places_are_visited_in_order() -> None:
    monitor = FakeTaskMonitor()
    robot = plain(5.0, 10.0).set_destination(monitor, NOW)
    assert robot.destination == assignment(5.0) and monitor.visits == []
    plain(5.0, 10.0).report_status(monitor)
    assert monitor.left == tuple(keys(0, 1))
    assert at(robot, 4.5).set_destination(monitor, NOW) == at(robot, 4.5), "0.5 m is not within reach"
    robot = at(robot, 4.51).set_destination(monitor, NOW)
    assert robot.destination == assignment(10.0, 1) and monitor.visits == keys(0)
    assert robot.route == (assignment(10.0, 1),) and robot.has_settled(ItemKey("r1", 0))
    robot = at(robot, 10.49).set_destination(monitor, NOW)
    assert (robot.destination, robot.route, monitor.visits) == (None, (), keys(0, 1))


def test_passed_places_are_visited_and_the_destination_stays() -> None:
    monitor = FakeTaskMonitor()
    robot = plain(5.0, 10.0, 2.0).set_destination(monitor, NOW)
    robot = at(robot, 2.2).set_destination(monitor, NOW)
    assert monitor.visits == keys(2)
    assert robot.destination == assignment(5.0) and robot.route == (assignment(5.0), assignment(10.0, 1))


def test_added_places_are_appended_to_the_route_once() -> None:
    tasks = RobotTaskList(((5.0, 0.0),), 0)
    robot = plain(5.0)
    assert robot.take_on(tasks) is robot
    tasks.items += ((8.0, 0.0), (9.0, 0.0))
    robot = robot.take_on(tasks)
    assert robot.route == (assignment(5.0), assignment(8.0, 1), assignment(9.0, 2))
    assert robot.take_on(tasks) is robot
    tasks.items += ((3.0, 0.0),)
    assert robot.take_on(tasks).route[3:] == (assignment(3.0, 3),)
    tasks = RobotTaskList((), 2)
    tasks.items += ((8.0, 0.0),)
    robot = plain().take_on(tasks)
    assert robot.route == (assignment(8.0, 0, term=2 * RESTART_TERM),), "restarted: with a higher term"


@pytest.mark.parametrize(("retry", "orders"), [(True, 3), (False, 2)])
def test_the_goal_is_sent_once_per_attempt_and_again_after_an_abort(retry: bool, orders: int) -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    robot = replace(plain(5.0), parameters=CleaningParameters(retry=retry))
    robot = robot.sense(ScriptedPositioning(Pose(3.0, 4.0, 1.0))).set_destination(monitor, NOW)
    assert robot.position == Point(3.0, 4.0)
    robot = robot.drive(navigation, monitor, NOW).drive(navigation, monitor, NOW)
    assert navigation.goals == [Point(5.0, 0.0)]
    robot = robot.heading_for(robot.route[0]).drive(navigation, monitor, NOW)
    assert navigation.goals == [Point(5.0, 0.0)] * 2
    navigation.abort()
    robot.drive(navigation, monitor, NOW)
    assert navigation.goals == [Point(5.0, 0.0)] * orders


def test_after_the_last_visit_it_drives_on_to_the_place() -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    robot = plain(5.0).set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    robot = at(robot, 4.6).set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    assert robot.target is None and navigation.goals == [Point(5.0, 0.0)]


def test_a_robot_without_target_stops_once() -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    robot = plain(5.0).set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    robot = robot.heading_for(None).drive(navigation, monitor, NOW).drive(navigation, monitor, NOW)
    assert navigation.commands == [("go_to", Point(5.0, 0.0)), ("stop", None)]
    robot.set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    assert navigation.goals == [Point(5.0, 0.0)] * 2 and len(navigation.commands) == 3


def test_a_waypoint_comes_first_and_no_destination_is_published() -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    robot = plain(5.0).set_destination(monitor, NOW).sent_to(AWAY)
    robot = robot.set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    assert robot.destination is None and navigation.goals == [AWAY]
    robot = replace(robot, position=AWAY).set_destination(monitor, NOW)
    assert robot.destination == assignment(5.0) and robot.waypoint is None


def test_a_place_given_up_leaves_the_route_and_is_never_a_destination_again() -> None:
    monitor = FakeTaskMonitor()
    robot = plain(5.0, 10.0).set_destination(monitor, NOW)
    robot = robot.given_up(robot.route[0], "the door is shut", monitor, NOW)
    assert monitor.gone == [(ItemKey("r1", 0), "the door is shut")]
    assert robot.destination is None and robot.route == (assignment(10.0, 1),)
    assert robot.has_settled(ItemKey("r1", 0)) and not robot.holds(ItemKey("r1", 0))
    other = plain(5.0, 10.0).set_destination(monitor, NOW)
    other = other.given_up(other.route[1], "the door is shut", monitor, NOW)
    assert other.destination == assignment(5.0) and other.attempt == 0


@pytest.mark.parametrize("attempts", [0, 1, 3])
def test_an_unreachable_place_is_given_up_after_the_limit(attempts: int) -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    robot = replace(plain(5.0), parameters=CleaningParameters(no_plan_attempts=attempts))
    robot = robot.set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    if attempts == 3:  # another reason resets the count
        for reason in (AbortReason.NO_PLAN, AbortReason.BLOCKED):
            navigation.abort(reason)
            robot = robot.drive(navigation, monitor, NOW)
        assert robot.no_plans == 0
        del navigation.commands[1:]
    for _ in range(5):
        if navigation.goal is not None:
            navigation.abort(AbortReason.NO_PLAN)
        robot = robot.set_destination(monitor, NOW).drive(navigation, monitor, NOW)
    tries = {0: "", 1: "1 times in a row", 3: "3 times in a row"}[attempts]
    expected = [(ItemKey("r1", 0), f"navigation found no way to it, {tries}")] if attempts else []
    assert monitor.gone == expected
    assert len(navigation.goals) == (attempts or 6)


NEAR, FAR = adaptive("r2", 3.0), adaptive("r3", 30.0)


MASKING = replace(adaptive("r1", 0.0), parameters=AdaptationParameters(peer_mask=True))


def test_peers_within_the_distance_are_stored_with_their_newest_position() -> None:
    mask, robot = PeerMask(6.5), MASKING
    assert mask.membership(NEAR, robot) and not mask.membership(FAR, robot)
    robot = mask.at_member(NEAR, robot, NOW)
    later = replace(NEAR, position=Point(2.5, 0.0))
    robot = mask.at_member(later, mask.at_member(FAR, robot, NOW), Instant(NOW + seconds(1)))
    assert robot.peers == (
        PeerPosition("r3", FAR.position, NOW),
        PeerPosition("r2", Point(2.5, 0.0), Instant(NOW + seconds(1))),
    )


def test_peers_reach_the_localiser_and_old_positions_are_dropped() -> None:
    base = ScriptedPositioning(HERE)
    robot = PeerMask(6.5).at_member(NEAR, MASKING, NOW)
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3)))
    assert base.peers == (NEAR.position,) and robot.peers
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3.5)))
    assert not base.peers and robot.peers == ()
    base = ScriptedPositioning(HERE)
    adaptive("r1", 0.0).disregard_peers(base, NOW)
    assert base.peers is None, "without the mask"


RNG = generator(5, "behaviour", "r1", 0)
WHOLE = AdaptationParameters()


def checked(
    robot: AdaptiveCleaningRobot, times: int, monitor: FakeTaskMonitor | None = None
) -> AdaptiveCleaningRobot:
    for _ in range(times):
        robot = robot.detect_blocked().auto_unblock(OPEN, RNG, monitor or FakeTaskMonitor(), NOW)
    return robot


def stuck(parameters: AdaptationParameters = WHOLE, *xs: float) -> AdaptiveCleaningRobot:
    robot = replace(adaptive("r1", 0.0, *(xs or (5.0, 9.0))), parameters=parameters)
    robot = checked(robot, 1 + parameters.still_checks + parameters.blocked_checks)
    assert robot.is_blocked() and robot.blocked_for == parameters.blocked_checks
    return robot


def test_it_is_blocked_at_the_fourth_still_second() -> None:
    states = [checked(adaptive("r1", 0.0, 5.0), seconds).state for seconds in range(7)]
    assert states == [State.FREE] * 5 + [State.BLOCKED] * 2
    assert checked(adaptive("r1", 0.0, 5.0).sent_to(AWAY), 5).is_blocked(), "on its way to any point"


def test_a_centimetre_per_second_is_moving() -> None:
    robot = adaptive("r1", 0.0, 5.0)
    for check in range(9):
        robot = replace(robot, position=Point(0.0101 * check, 0.0)).detect_blocked()
    assert robot.state is State.FREE and robot.still_for == 0
    for check in range(9):
        robot = replace(robot, position=Point(0.1 + 0.0099 * check, 0.0)).detect_blocked()
    assert robot.state is State.BLOCKED


def test_a_robot_at_or_without_a_target_is_not_blocked() -> None:
    assert checked(adaptive("r1", 4.6, 5.0), 9).state is State.FREE
    idle = replace(adaptive("r1", 0.0), state=State.BLOCKED, still_for=9, blocked_for=3)
    assert idle.detect_blocked().state is State.FREE


def test_after_seven_blocked_seconds_it_chooses_a_place_of_its_route() -> None:
    turned = checked(stuck(), 1)
    assert turned.attempt == 1 and turned.destination in turned.route and turned.waypoint is None
    assert (turned.state, turned.blocked_for, turned.still_for) == (State.FREE, 0, 0)
    states = [checked(stuck(), seconds).state for seconds in range(1, 6)]
    assert states == [State.FREE] * 4 + [State.BLOCKED], "counted from the start"


def test_all_places_of_the_route_are_equally_likely() -> None:
    chosen = Counter(checked(stuck(WHOLE, 5.0, 7.0, 9.0), 1).destination for _ in range(300))
    assert len(chosen) == 3 and min(chosen.values()) > 70  # 100 ± 8 each


def test_released_code_mostly_chooses_a_random_point_and_is_blocked_within_a_second() -> None:
    turned = checked(stuck(ReleasedParameters()), 1)
    assert (turned.state, checked(turned, 1).state) == (State.FREE, State.BLOCKED)
    turns = Counter(checked(stuck(ReleasedParameters()), 1).waypoint is None for _ in range(300))
    assert turns[False] == pytest.approx(200, abs=30)  # 2 in 3, ± 8


@pytest.mark.parametrize("unblock", UnblockTarget)
def test_an_empty_route_does_not_crash(unblock: UnblockTarget) -> None:
    robot = replace(
        adaptive("r1", 0.0).sent_to(Point(5.0, 5.0)), parameters=AdaptationParameters(unblock=unblock)
    )
    turned = checked(checked(robot, 10), 1)
    assert (turned.waypoint == Point(5.0, 5.0)) is (unblock is UnblockTarget.QUEUE)
    assert turned.waypoint is not None and (turned.attempt, turned.state) == (2, State.FREE)


def test_a_place_is_given_up_after_the_limit_of_attempts() -> None:
    monitor = FakeTaskMonitor()
    robot = replace(adaptive("r1", 0.0, 5.0), parameters=AdaptationParameters(attempts=3))
    robot = checked(robot, 40, monitor)
    assert monitor.gone == [
        (ItemKey("r1", 0), "blocked on the way to it, 3 times without visiting any place meanwhile")
    ]
    assert (robot.route, robot.destination, robot.state) == ((), None, State.FREE)


def test_visiting_a_place_resets_attempts() -> None:
    monitor = FakeTaskMonitor()
    robot = replace(stuck(AdaptationParameters(attempts=2)), destination=assignment(5.0))
    robot = checked(robot, 1, monitor)
    assert len(robot.tried) == 1
    robot = replace(robot, position=Point(9.0, 0.0)).set_destination(monitor, NOW)
    assert robot.tried == () and monitor.visits == [ItemKey("r1", 1)]


seen = partial(published, role=Cleaner)
P = AdaptationParameters()
ADOPTION = DestinationAdoption(P.adoption_distance, P.adoption_checks, P.adoption_backoff)
REMOVE = AdoptedDestinationRemove(exchange=True)


def blocked(robot: str, at: float, *xs: float) -> AdaptiveCleaningRobot:
    return replace(adaptive(robot, at, *xs), state=State.BLOCKED, blocked_for=1)


def adopts(member: AdaptiveCleaningRobot, peer: Cleaner, now: Instant = NOW) -> AdaptiveCleaningRobot:
    return ADOPTION.at_member(peer, member, now) if ADOPTION.membership(peer, seen(member)) else member


def removes(
    member: AdaptiveCleaningRobot, peer: Cleaner, ensemble: AdoptedDestinationRemove = REMOVE
) -> AdaptiveCleaningRobot:
    return ensemble.at_member(peer, member, NOW) if ensemble.membership(peer, member) else member


R1, R2 = blocked("r1", 0.0, 5.0, 6.0), blocked("r2", 1.0, -5.0, -6.0)


def test_two_blocked_robots_exchange_their_destinations() -> None:
    r1, r2 = adopts(R1, seen(R2)), adopts(R2, seen(R1))
    assert r1.destination == assignment(-5.0, owner="r2", term=1) == r1.route[-1]
    assert r2.destination == assignment(5.0, owner="r1", term=1) == r2.route[-1]
    assert r1.adopted == (Takeover("r2", 0, 1),) and r1.former == assignment(5.0)
    r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    assert (
        r1.route == (assignment(6.0, 1), assignment(-5.0, owner="r2", term=1))
        and r1.destination == r1.route[-1]
    )
    assert r2.route == (assignment(-6.0, 1, "r2"), assignment(5.0, term=1)) and r2.destination == r2.route[-1]


@pytest.mark.parametrize(
    ("far", "state"), [(1.499, State.FREE), (1.501, State.BLOCKED), (1.499, State.BLOCKED)]
)
def test_both_must_be_blocked_and_near(far: float, state: State) -> None:
    peer = replace(seen(R2), position=Point(far, 0.0), state=state)
    expected = state is State.BLOCKED and far < 1.5
    assert ADOPTION.membership(peer, seen(R1)) is ADOPTION.membership(seen(R1), peer) is expected
    assert adopts(replace(R1, blocked_for=0), seen(R2)).destination == R1.destination


def test_it_adopts_once_in_ten_seconds() -> None:
    r1 = adopts(R1, seen(R2))
    again = replace(r1, state=State.BLOCKED, blocked_for=1)
    other = seen(replace(R2, destination=assignment(-6.0, 1, "r2")))
    assert adopts(again, other, Instant(NOW + seconds(9.9))) == again
    assert adopts(again, other, Instant(NOW + seconds(10))).destination == assignment(-6.0, 1, "r2", 1)


def test_an_adoption_resets_the_blocked_state() -> None:
    r1 = adopts(replace(R1, still_for=9, blocked_for=4), seen(R2))
    assert (r1.state, r1.blocked_for, r1.still_for) == (State.FREE, 0, 0)
    code = replace(R1, parameters=ReleasedParameters(), still_for=9, blocked_for=4)
    r1 = adopts(code, seen(R2))
    assert (r1.state, r1.blocked_for, r1.still_for) == (State.BLOCKED, 0, 9)


def test_a_late_robot_still_receives_the_other_destination() -> None:
    r1 = adopts(R1, seen(R2))
    r2 = adopts(R2, seen(r1))
    assert r2 == R2, "r1 already has r2's destination and is no longer blocked"
    r2 = removes(r2, seen(r1))
    assert r2.destination == assignment(5.0, term=1) and r2.former is None
    assert r2.route == (assignment(-6.0, 1, "r2"), assignment(5.0, term=1))
    assert removes(r1, seen(r2)).route == (
        assignment(6.0, 1),
        assignment(-5.0, owner="r2", term=1),
    )


def test_a_former_destination_is_exchanged_only_with_its_holder() -> None:
    r1 = adopts(R1, seen(R2))
    third = replace(
        adaptive("r3", 0.0), route=route(-5.0, owner="r2"), destination=assignment(3.0, owner="r3")
    )
    third = replace(third, route=(*third.route, assignment(3.0, owner="r3")))
    assert removes(third, seen(r1)).route == (assignment(3.0, owner="r3"),)
    elsewhere = replace(seen(r1), destination=assignment(6.0, 1))
    assert removes(R2, elsewhere).destination == assignment(-6.0, 1, "r2")


def test_a_finished_robot_makes_way_for_a_blocked_one() -> None:
    ensemble, idle = MakingWay(1.5), adaptive("r2", 1.0)
    assert ensemble.membership(seen(R1), idle)
    assert ensemble.at_member(seen(R1), idle, OPEN).waypoint is not None
    for peer, member in (
        (replace(seen(R1), state=State.FREE), idle),
        (replace(seen(R1), position=Point(-0.6, 0.0)), idle),
        (seen(R1), R2),
        (seen(R1), idle.sent_to(AWAY)),
    ):
        assert not ensemble.membership(peer, member)


def test_a_place_adopted_back_is_not_lost() -> None:
    """In the original, one adoption removes a place from all routes forever, including the adopter's."""
    r1, r2 = adopts(R1, seen(R2)), adopts(R2, seen(R1))
    r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    r1 = replace(r1, state=State.BLOCKED, blocked_for=1, adopted_at=None)
    r1 = adopts(r1, replace(seen(r2), state=State.BLOCKED))
    assert r1.destination == assignment(5.0, term=2), "r1 adopts its own place back"
    r2 = removes(r2, seen(r1))
    for _ in range(3):
        r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    assert r1.holds(ItemKey("r1", 0)) and not r2.holds(ItemKey("r1", 0))


def test_settled_places_are_not_adopted() -> None:
    for destination in (None, R1.destination, replace(R1.route[1], term=5)):
        assert adopts(R1, replace(seen(R2), destination=destination)) == R1
    monitor = FakeTaskMonitor()
    r1 = replace(R1, position=Point(5.0, 0.0)).set_destination(monitor, NOW)
    r1 = replace(r1, position=Point(0.0, 0.0))
    assert adopts(r1, replace(seen(R2), destination=assignment(5.0, term=1))) == r1
    gone = R1.given_up(R1.route[0], "the door is shut", monitor, NOW)
    gone = replace(gone, state=State.BLOCKED, blocked_for=1)
    assert adopts(gone, replace(seen(R2), destination=assignment(5.0, term=1))) == gone


def test_the_higher_term_wins_and_then_the_greater_id() -> None:
    r3 = replace(seen(adaptive("r3", 0.0)), adopted=(Takeover("r1", 0, 2),))
    mine = {term: replace(R2, route=(assignment(5.0, term=term),), destination=None) for term in (1, 2, 3)}
    assert [bool(mine[term].places_taken_by(r3)) for term in (1, 2, 3)] == [True, True, False]
    other = replace(mine[2], id="r4")
    assert not other.places_taken_by(r3)


def test_an_impossible_term_is_not_adopted() -> None:
    """Received terms may be so large that the next one does not fit the wire format."""
    r1 = seen(R2)
    for term in (2**63 - 1, 2**64 - 1):
        assert adopts(R1, replace(r1, destination=assignment(-5.0, owner="r2", term=term))) == R1
    taken = adopts(R1, replace(r1, destination=assignment(-5.0, owner="r2", term=2**63 - 2)))
    assert taken.destination is not None and taken.destination.term == 2**63 - 1
