"""Tours, the strategy `chapter-careful`, and the upper bound by an oracle."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Point, Pose
from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.runtime.errors import AcrcError
from actors.task.task import PlaceKey
from cleaning.place import Assignment
from cleaning.strategies.careful import CarefulRobot
from cleaning.strategies.oracle import behaviour
from cleaning.strategies.tour import FAR, PathCosts
from tests.cleaning.fakes import NOW, FakeNavigation, FakePositioning, OpenFloor, route


def start(robot: str, x: float, *places: float) -> Start:
    points = tuple(Point(place, 0.0) for place in places)
    generator = np.random.default_rng(1)
    return Start(robot, 1, 0, Pose(x, 0.0, 0.0), points, generator, floor=OpenFloor())


def step(hosted: Behaviour, x: float, number: int) -> Decision:
    view = View(Instant(number * 100_000), Pose(x, 0.0, 0.0), False, None, ())
    return hosted.advance(view, Instant((number + 1) * 100_000))


def test_the_oracle_assigns_places_without_frames_and_runs_do_not_mix() -> None:
    for _ in range(2):
        r1, r2 = behaviour(start("r1", 0.0, 1.0, 20.0)), behaviour(start("r2", 21.0))
        routes: dict[str, tuple[PlaceKey, ...]] = {}
        for number in range(40):
            for name, hosted, x in (("r1", r1, 0.0), ("r2", r2, 21.0)):
                said = step(hosted, x, number)
                assert said.frames == ()
                routes[name] = routes.get(name, ()) if said.route is None else said.route
        assert routes == {"r1": (PlaceKey("r1", 0),), "r2": (PlaceKey("r1", 1),)}


def test_the_oracle_needs_two_robots() -> None:
    behaviour(start("r1", 0.0, 1.0))
    alone = behaviour(start("r1", 0.0, 1.0))
    with pytest.raises(AcrcError, match="finds no other robot in this process; it needs `--bus memory`"):
        for number in range(12):
            step(alone, 0.0, number)
    behaviour(start("r1", 0.0, 1.0)), behaviour(start("r2", 9.0))
    again = behaviour(replace(start("r2", 9.0), epoch=1))  # a restarted robot stays in its run
    for number in range(12):
        step(again, 9.0, number)


START = Point(0.0, 0.0)
PLACES = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=7)


def tour(places: list[tuple[int, int]]) -> tuple[Assignment, ...]:
    return tuple(Assignment("r1", index, Point(float(x), float(y))) for index, (x, y) in enumerate(places))


@settings(max_examples=100, deadline=None)
@given(PLACES, st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
def test_what_a_place_adds_and_saves(places: list[tuple[int, int]], place: tuple[int, int]) -> None:
    costs, route = PathCosts(OpenFloor(0.5), 4.0), tour(places)
    new = Assignment("r2", 0, Point(float(place[0]), float(place[1])))
    added, index = costs.insertion(START, route, new.point)
    longer = (*route[:index], new, *route[index:])
    before, after = costs.tour(START, route), costs.tour(START, longer)
    assert abs(max(0.0, after - before) - added) < 1e-9
    assert abs(max(0.0, after - before) - costs.saving(START, longer, index)) < 1e-9


@settings(max_examples=100, deadline=None)
@given(PLACES, st.integers(0, 2))
def test_a_shortened_tour_has_the_same_places(places: list[tuple[int, int]], fixed: int) -> None:
    costs, route = PathCosts(OpenFloor()), tour(places)
    short = costs.two_opt(START, route, min(fixed, len(route)))
    assert sorted(place.index for place in short) == list(range(len(route)))
    assert short[: min(fixed, len(route))] == route[:fixed]
    assert costs.tour(START, short) <= costs.tour(START, route) + 1e-9


def test_a_crossing_is_undone() -> None:
    costs, route = PathCosts(OpenFloor()), tour([(0, 5), (5, 0), (5, 5), (9, 0)])
    assert [place.index for place in costs.two_opt(START, route)] == [0, 2, 1, 3]


def test_doors_and_unreachable_places_have_costs() -> None:
    class Walled(OpenFloor):
        def length(self, start: Point, goal: Point) -> float | None:
            return None

    assert PathCosts(OpenFloor(2.0), 4.0).cost(START, Point(5.0, 0.0)) == 9.0
    assert PathCosts(Walled()).cost(START, Point(5.0, 0.0)) == FAR


def after(robot: CarefulRobot, base: FakePositioning, navigation: FakeNavigation, by: float) -> CarefulRobot:
    return robot.mind_pose(base, navigation, Instant(NOW + seconds(by)))


def test_it_waits_while_it_is_lost() -> None:
    base, navigation = FakePositioning(lost_probability=0.9), FakeNavigation()
    robot = CarefulRobot(id="r1", position=Point(0.0, 0.0), route=route(5.0))
    assert after(robot, base, navigation, 0) is robot and navigation.orders == []
    base.lost_probability = 0.96
    robot = after(robot, base, navigation, 1)
    assert navigation.orders == [None] and navigation.backed_out == [1.0] and base.relocalised == 0
    robot = after(robot, base, navigation, 12)
    robot = after(robot, base, navigation, 13)
    assert base.relocalised == 1 and navigation.backed_out == [1.0, 1.0] and robot.lost_since is not None
    base.lost_probability = 0.4
    found = after(robot, base, navigation, 14)
    assert found.lost_since is None and found.attempt == robot.attempt + 1


def test_waiting_while_lost_has_a_timeout() -> None:
    base, navigation = FakePositioning(lost_probability=1.0), FakeNavigation()
    robot = after(CarefulRobot(id="r1", position=Point(0.0, 0.0)), base, navigation, 0)
    robot = after(robot, base, navigation, 31)
    assert robot.lost_since is None
    assert after(robot, base, navigation, 60).lost_since is None
    assert after(robot, base, navigation, 62).lost_since == NOW + seconds(62)
