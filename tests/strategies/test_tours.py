"""Tours: what a place adds or saves is what the tour's length says; 2-opt never makes one longer."""

from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Point
from cleaning.place import Assignment
from cleaning.strategies.tour import FAR, Ways
from tests.cleaning.equipment import Floor

START = Point(0.0, 0.0)
PLACES = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=7)


def tour(places: list[tuple[int, int]]) -> tuple[Assignment, ...]:
    return tuple(Assignment("r1", index, Point(float(x), float(y))) for index, (x, y) in enumerate(places))


@settings(max_examples=100, deadline=None)
@given(PLACES, st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
def test_what_a_place_adds_and_what_it_saves_are_differences_of_lengths(
    places: list[tuple[int, int]], place: tuple[int, int]
) -> None:
    ways, route = Ways(Floor(0.5), 4.0), tour(places)
    new = Assignment("r2", 0, Point(float(place[0]), float(place[1])))
    added, index = ways.insertion(START, route, new.point)
    longer = (*route[:index], new, *route[index:])
    before, after = ways.tour(START, route), ways.tour(START, longer)
    assert abs(max(0.0, after - before) - added) < 1e-9
    assert abs(max(0.0, after - before) - ways.saving(START, longer, index)) < 1e-9


@settings(max_examples=100, deadline=None)
@given(PLACES, st.integers(0, 2))
def test_a_shortened_tour_has_the_same_places_and_is_no_longer(
    places: list[tuple[int, int]], fixed: int
) -> None:
    ways, route = Ways(Floor()), tour(places)
    short = ways.shortened(START, route, min(fixed, len(route)))
    assert sorted(place.index for place in short) == list(range(len(route)))
    assert short[: min(fixed, len(route))] == route[:fixed]
    assert ways.tour(START, short) <= ways.tour(START, route) + 1e-9


def test_a_crossing_is_undone() -> None:
    ways, route = Ways(Floor()), tour([(0, 5), (5, 0), (5, 5), (9, 0)])
    assert [place.index for place in ways.shortened(START, route)] == [0, 2, 1, 3]


def test_a_door_counts_and_so_does_what_nobody_gets_to() -> None:
    class Walled(Floor):
        def length(self, start: Point, goal: Point) -> float | None:
            return None

    assert Ways(Floor(2.0), 4.0).cost(START, Point(5.0, 0.0)) == 9.0
    assert Ways(Walled()).cost(START, Point(5.0, 0.0)) == FAR
