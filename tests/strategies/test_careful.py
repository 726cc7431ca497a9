"""A robot that knows that it is lost: it stops, goes back, looks for itself, and does not wait for ever."""

from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.strategies.careful import CarefulRobot
from tests.cleaning.equipment import NOW, Base, Ways, route


def after(robot: CarefulRobot, base: Base, ways: Ways, by: float) -> CarefulRobot:
    return robot.mind_pose(base, ways, Instant(NOW + seconds(by)))


def test_it_waits_while_it_is_lost() -> None:
    base, ways = Base(is_lost=0.9), Ways()
    robot = CarefulRobot(id="r1", position=Point(0.0, 0.0), route=route(5.0))
    assert after(robot, base, ways, 0) is robot and ways.orders == []
    base.is_lost = 0.96
    robot = after(robot, base, ways, 1)
    assert ways.orders == [None] and ways.backed == [1.0] and base.relocalised == 0
    robot = after(robot, base, ways, 12)
    robot = after(robot, base, ways, 13)
    assert base.relocalised == 1 and ways.backed == [1.0, 1.0] and robot.lost_since is not None
    base.is_lost = 0.4
    found = after(robot, base, ways, 14)
    assert found.lost_since is None and found.attempt == robot.attempt + 1


def test_it_does_not_wait_for_ever() -> None:
    base, ways = Base(is_lost=1.0), Ways()
    robot = after(CarefulRobot(id="r1", position=Point(0.0, 0.0)), base, ways, 0)
    robot = after(robot, base, ways, 31)
    assert robot.lost_since is None
    assert after(robot, base, ways, 60).lost_since is None
    assert after(robot, base, ways, 62).lost_since == NOW + seconds(62)
