"""Tours, the strategy `chapter-careful`, and the upper bound by an oracle."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acrc_testbed.testing import LoggedNavigation, ScriptedPositioning, VirtualSwarm
from actors.geometry import Point
from actors.instant import Instant, seconds
from actors.items import ItemKey
from actors.runtime.errors import AcrcError
from cleaning.place import Assignment
from cleaning.strategies.careful import CarefulRobot
from cleaning.strategies.oracle import behaviour
from cleaning.strategies.tour import FAR, PathCosts
from tests.cleaning.fakes import DOORWAY, HERE, NOW, OPEN, route


def swarm(epoch: int = 0, **robots: tuple[float, ...]) -> VirtualSwarm:
    """Return robots by id, each with the x of its start and of its places, m."""
    points = {name: [Point(x, 0.0) for x in xs] for name, xs in robots.items()}
    return VirtualSwarm(behaviour, OPEN, points, epoch=epoch)


def test_the_oracle_assigns_places_without_frames_and_runs_do_not_mix() -> None:
    for _ in range(2):
        pair = swarm(r1=(0.0, 1.0, 20.0), r2=(21.0,))
        pair.advance(seconds(4))
        assert pair.medium.sent == []
        assert (pair["r1"].route, pair["r2"].route) == ((ItemKey("r1", 0),), (ItemKey("r1", 1),))


def test_the_oracle_needs_two_robots() -> None:
    swarm(r1=(0.0, 1.0))
    alone = swarm(r1=(0.0, 1.0))
    with pytest.raises(AcrcError, match="finds no other robot in this process; it needs `--bus memory`"):
        alone.advance(seconds(1.2))
    swarm(r1=(0.0, 1.0), r2=(9.0,))
    swarm(epoch=1, r2=(9.0,)).advance(seconds(1.2))  # a restarted robot stays in its run


START = Point(0.0, 0.0)
PLACES = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=7)


def tour(places: list[tuple[int, int]]) -> tuple[Assignment, ...]:
    return tuple(Assignment("r1", index, Point(float(x), float(y))) for index, (x, y) in enumerate(places))


@settings(max_examples=100, deadline=None)
@given(PLACES, st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
def test_what_a_place_adds_and_saves(places: list[tuple[int, int]], place: tuple[int, int]) -> None:
    costs, route = PathCosts(DOORWAY, 4.0), tour(places)
    new = Assignment("r2", 0, Point(float(place[0]), float(place[1])))
    added, index = costs.insertion(START, route, new.point)
    longer = (*route[:index], new, *route[index:])
    before, after = costs.tour(START, route), costs.tour(START, longer)
    assert abs(max(0.0, after - before) - added) < 1e-9
    assert abs(max(0.0, after - before) - costs.saving(START, longer, index)) < 1e-9


@settings(max_examples=100, deadline=None)
@given(PLACES, st.integers(0, 2))
def test_a_shortened_tour_has_the_same_places(places: list[tuple[int, int]], fixed: int) -> None:
    costs, route = PathCosts(OPEN), tour(places)
    short = costs.two_opt(START, route, min(fixed, len(route)))
    assert sorted(place.index for place in short) == list(range(len(route)))
    assert short[: min(fixed, len(route))] == route[:fixed]
    assert costs.tour(START, short) <= costs.tour(START, route) + 1e-9


def test_a_crossing_is_undone() -> None:
    costs, route = PathCosts(OPEN), tour([(0, 5), (5, 0), (5, 5), (9, 0)])
    assert [place.index for place in costs.two_opt(START, route)] == [0, 2, 1, 3]


def test_doors_and_unreachable_places_have_costs() -> None:
    assert PathCosts(DOORWAY, 4.0).cost(Point(-2.0, 0.0), Point(3.0, 0.0)) == pytest.approx(9.0)
    assert PathCosts(OPEN).cost(START, Point(99.0, 0.0)) == FAR


def after(
    robot: CarefulRobot, base: ScriptedPositioning, navigation: LoggedNavigation, by: float
) -> CarefulRobot:
    return robot.mind_pose(base, navigation, Instant(NOW + seconds(by)))


def test_it_waits_while_it_is_lost() -> None:
    base, navigation = ScriptedPositioning(HERE, lost_probability=0.9), LoggedNavigation()
    robot = CarefulRobot(id="r1", position=Point(0.0, 0.0), route=route(5.0))
    assert after(robot, base, navigation, 0) is robot and navigation.commands == []
    base.lost_probability = 0.96
    robot = after(robot, base, navigation, 1)
    assert navigation.commands == [("stop", None), ("back_out", 1.0)] and base.relocalised == 0
    robot = after(robot, base, navigation, 12)
    robot = after(robot, base, navigation, 13)
    assert (
        base.relocalised == 1
        and navigation.commands[2:] == [("back_out", 1.0)]
        and robot.lost_since is not None
    )
    base.lost_probability = 0.4
    found = after(robot, base, navigation, 14)
    assert found.lost_since is None and found.attempt == robot.attempt + 1


def test_waiting_while_lost_has_a_timeout() -> None:
    base, navigation = ScriptedPositioning(HERE, lost_probability=1.0), LoggedNavigation()
    robot = after(CarefulRobot(id="r1", position=Point(0.0, 0.0)), base, navigation, 0)
    robot = after(robot, base, navigation, 31)
    assert robot.lost_since is None
    assert after(robot, base, navigation, 60).lost_since is None
    assert after(robot, base, navigation, 62).lost_since == NOW + seconds(62)
