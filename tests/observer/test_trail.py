import itertools
import math

from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Point
from actors.observer.trail import PIECE, RECENT, Trail


def drawn(trail: Trail, points: list[Point]) -> tuple[dict[str, tuple[Point, ...]], int]:
    """What is on the screen after the points, and how many points were sent for it."""
    screen: dict[str, tuple[Point, ...]] = {}
    sent = 0
    for point in points:
        for strip in trail.extend(point):
            screen[strip.name] = strip.points
            sent += len(strip.points)
    return screen, sent


def straight(number: int, spacing: float = 0.1) -> list[Point]:
    return [Point(spacing * i, 0.0) for i in range(number)]


def test_a_robot_that_stands_leaves_no_trail() -> None:
    assert drawn(Trail(0.05, 1.0), [Point(1.0, 1.0), Point(1.0, 1.04)] * 10) == ({}, 0)


def test_a_short_way_is_one_strip() -> None:
    screen, _ = drawn(Trail(0.05, 1.0), straight(5))
    assert screen == {"recent": tuple(straight(5))}


def test_a_robot_put_elsewhere_begins_anew() -> None:
    points = [Point(0.0, 0.0), Point(0.1, 0.0), Point(5.0, 0.0), Point(5.1, 0.0)]
    screen, _ = drawn(Trail(0.05, 1.0), points)
    assert screen == {"0": tuple(points[:2]), "recent": tuple(points[2:])}


@settings(max_examples=30, deadline=None, derandomize=True)
@given(number=st.integers(2, 4 * PIECE))
def test_the_strips_join_to_the_whole_way(number: int) -> None:
    points = straight(number)
    screen, _ = drawn(Trail(0.05, 1.0), points)
    recent = screen.pop("recent")
    ordered = [screen[name] for name in sorted(screen, key=int)] + ([recent] if recent else [])
    assert sorted(screen, key=int) == [str(i) for i in range(len(screen))]
    for before, after in itertools.pairwise(ordered):
        assert before[-1] == after[0]
    joined = [*ordered[0], *(point for strip in ordered[1:] for point in strip[1:])]
    assert joined == points


def test_what_is_sent_grows_linearly_with_the_way() -> None:
    """Every point at most RECENT/2 times as recent and PIECE/RECENT/2 times in its piece, on average."""
    for number in (4_000, 16_000):
        _, sent = drawn(Trail(0.05, 1.0), straight(number))
        assert math.isclose(sent / number, RECENT / 2 + PIECE / RECENT / 2, rel_tol=0.1)
