"""Yielding: one of two blocked robots backs out, waits, and continues."""

from dataclasses import replace
from functools import partial

import pytest

from acrc_testbed.testing import LoggedNavigation
from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.cleaner import Cleaner, State
from cleaning.yielding import SteppingAside, Yielding, YieldingParameters, YieldingRobot
from tests.cleaning.fakes import DOORWAY, NOW, OPEN, published, route

seen = partial(published, role=Cleaner)
P = YieldingParameters()
YIELDING = Yielding(P.yield_distance, P.yield_checks, P.insist_checks)


def blocked(robot: str, at: float, *xs: float, checks: int = 2) -> YieldingRobot:
    places = route(*xs, owner=robot)
    head = places[0] if places else None
    made = YieldingRobot(id=robot, position=Point(at, 0.0), route=places, destination=head)
    return replace(made, state=State.BLOCKED, blocked_for=checks)


@pytest.mark.parametrize(
    ("r1", "r2", "gives_way"),
    [
        (blocked("r1", 0.0, 5.0), blocked("r2", 1.0, -5.0), True),
        (blocked("r1", 0.0, 5.0, checks=1), blocked("r2", 1.0, -5.0), False),
        (blocked("r1", 0.0, 5.0), blocked("r2", 1.6, -5.0), False),
        (blocked("r1", 0.0, 5.0), replace(blocked("r2", 1.0, -5.0), state=State.FREE), False),
        (blocked("r2", 0.0, 5.0), blocked("r1", 1.0, -5.0), False),
        (blocked("r2", 0.0, 5.0, checks=5), blocked("r1", 1.0, -5.0), True),
        (blocked("r2", 0.0), blocked("r1", 1.0, -5.0), True),
        (replace(blocked("r1", 0.0, 5.0), waits_until=NOW), blocked("r2", 1.0, -5.0), False),
    ],
)
def test_who_gives_way(r1: YieldingRobot, r2: YieldingRobot, gives_way: bool) -> None:
    assert YIELDING.membership(seen(r2), r1) is gives_way


def test_it_backs_out_waits_and_requests_the_goal_again() -> None:
    navigation, robot = (
        LoggedNavigation(),
        YIELDING.at_member(seen(blocked("r2", 1.0)), blocked("r1", 0.0, 5.0), OPEN, NOW),
    )
    robot = robot.give_way(navigation, NOW)
    assert navigation.commands == [("stop", None), ("back_out", P.back_out)]
    waiting = robot.give_way(navigation, Instant(NOW + seconds(7)))
    assert not waiting.is_blocked() and waiting.blocked_for == 0 and len(navigation.commands) == 2
    after = waiting.give_way(navigation, Instant(NOW + seconds(8)))
    assert after.waits_until is None and after.attempt == robot.attempt + 1

    assert blocked("r1", 0.3).request_back_out(DOORWAY, NOW).backs_by == P.back_out_of_door


def test_a_robot_without_target_leaves_a_door() -> None:
    idle = replace(blocked("r1", 0.3), state=State.FREE)
    aside = idle.leave_door(DOORWAY).waypoint
    assert aside is not None and DOORWAY.door(aside) is None
    assert idle.leave_door(OPEN) == idle
    assert replace(idle, waypoint=Point(9.0, 9.0)).leave_door(DOORWAY).waypoint == Point(9.0, 9.0)


def test_a_robot_without_target_steps_aside_for_a_blocked_one() -> None:
    aside, idle = SteppingAside(1.5), replace(blocked("r1", 0.0), state=State.FREE)
    assert aside.membership(seen(blocked("r2", 1.0, 5.0)), idle)
    assert aside.at_member(seen(blocked("r2", 1.0, 5.0)), idle, OPEN).waypoint is not None
    assert not aside.membership(seen(blocked("r2", 1.6, 5.0)), idle)
    assert not aside.membership(seen(blocked("r2", 1.0, 5.0)), blocked("r1", 0.0, 5.0))
