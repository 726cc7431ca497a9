"""The episode finders on tracks made by hand; a sample is a second, a window ten of them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from observation.accounting.episodes import Blocking, Episode, blockings, lost, runs, standing

WINDOW = 10
ALWAYS = np.ones(60, np.bool_)


def track(*stretches: tuple[int, float, float]) -> NDArray[np.float64]:
    """(samples, 2): so many samples at each x, y."""
    return np.array([(x, y) for count, x, y in stretches for _ in range(count)])


def drive(count: int, speed: float = 0.5) -> NDArray[np.float64]:
    return np.column_stack([np.arange(count) * speed, np.zeros(count)])


def test_runs_of_true() -> None:
    mask = np.array([True, True, False, True, False, True, True, True])
    assert runs(mask) == [(0, 2), (3, 4), (5, 8)]
    assert runs(mask, 2) == [(0, 2), (5, 8)]
    assert runs(np.zeros(4, np.bool_)) == [] == runs(np.zeros(0, np.bool_))


def test_lost_begins_above_one_metre_and_ends_below_half_a_metre() -> None:
    assert lost(np.array([0.2, 0.9, 1.0, 1.1, 0.7, 1.2, 0.5, 0.49, 0.9])) == [Episode(3, 7)]


def test_lost_to_the_end_and_twice() -> None:
    assert lost(np.array([1.5, 0.1, 0.1, 3.0, 4.0])) == [Episode(0, 1), Episode(3, 5)]


def test_an_unknown_error_changes_nothing() -> None:
    unknown = np.nan
    assert lost(np.array([unknown, 1.5, unknown, 0.6, unknown, 0.2, unknown])) == [Episode(1, 5)]
    assert lost(np.full(5, unknown)) == []


def test_standing_needs_a_whole_window_within_the_distance() -> None:
    stood = standing(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.11, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert runs(stood) == [Episode(10, 20)]
    stood = standing(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.09, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert runs(stood) == [Episode(10, 25)]


def test_driving_and_creeping_are_no_standing() -> None:
    assert not standing(drive(60), ALWAYS, WINDOW, 0.1).any()
    assert not standing(drive(60, 0.012), ALWAYS, WINDOW, 0.1).any()
    assert standing(drive(60, 0.01), ALWAYS, WINDOW, 0.1).all()


def test_who_has_no_goal_does_not_stand_in_the_way() -> None:
    pursuing = ALWAYS.copy()
    pursuing[25] = False
    assert runs(standing(track((60, 0, 0)), pursuing, WINDOW, 0.1)) == [Episode(0, 25), Episode(26, 60)]
    pursuing[30::9] = False
    assert runs(standing(track((60, 0, 0)), pursuing, WINDOW, 0.1)) == [Episode(0, 25)]


def test_a_track_shorter_than_the_window() -> None:
    assert not standing(track((5, 0, 0)), ALWAYS[:5], WINDOW, 0.1).any()


def both(*tracks: NDArray[np.float64], pursuing: NDArray[np.bool_] | None = None) -> list[Blocking]:
    true = np.stack(tracks, axis=1)
    wanted = np.ones(true.shape[:2], np.bool_) if pursuing is None else pursuing
    return blockings(true, wanted, WINDOW)


def test_two_that_stand_near_each_other_block_until_one_leaves() -> None:
    one = track((5, -9, 0), (40, 0, 0), (15, 9, 9))
    other = track((20, 9, 0), (40, 0.9, 0))
    assert both(one, other) == [Blocking((0, 1), 20, 45)]
    assert both(other, one) == [Blocking((0, 1), 20, 45)]


def test_lasting_means_to_the_last_sample() -> None:
    assert both(track((60, 0, 0)), track((50, 9, 0), (10, 1.0, 0))) == [Blocking((0, 1), 50, 60)]


@pytest.mark.parametrize("gap", [1.18, 1.4, 1.6])
def test_who_stops_head_on_before_a_door_blocks_the_other(gap: float) -> None:
    assert both(track((60, 0, 0)), track((60, gap, 0))) == [Blocking((0, 1), 0, 60)]


@pytest.mark.parametrize("gap", [1.61, 5.0])
def test_farther_apart_they_do_not(gap: float) -> None:
    assert both(track((60, 0, 0)), track((60, gap, 0))) == []


def test_together_for_less_than_the_window_they_do_not() -> None:
    assert both(track((60, 0, 0)), track((51, 9, 0), (9, 0.5, 0))) == []


def test_a_robot_that_has_reached_its_goal_is_an_obstacle_but_no_party() -> None:
    pursuing = np.ones((60, 2), np.bool_)
    pursuing[:, 1] = False
    assert both(track((60, 0, 0)), track((60, 0.5, 0)), pursuing=pursuing) == []


def test_a_chain_is_one_blocking_and_two_pairs_apart_are_two() -> None:
    chain = [track((60, x, 0)) for x in (0.0, 0.8, 1.6)]
    pair = [track((30, 30, 0), (30, 20, 0)), track((60, 20.5, 0))]
    assert both(*chain, *pair) == [Blocking((0, 1, 2), 0, 60), Blocking((3, 4), 30, 60)]
    assert both(*pair, *chain) == [Blocking((2, 3, 4), 0, 60), Blocking((0, 1), 30, 60)]


def test_one_that_joins_later_lengthens_the_blocking() -> None:
    tracks = [track((40, 0, 0), (20, 9, 9)), track((60, 0.5, 0)), track((20, 5, 5), (40, 1.0, 0.5))]
    assert both(*tracks) == [Blocking((0, 1, 2), 0, 60)]


def test_the_same_two_at_different_times_are_two_blockings() -> None:
    assert both(track((60, 0, 0)), track((20, 0.5, 0), (20, 9, 0), (20, 0.5, 0))) == [
        Blocking((0, 1), 0, 20),
        Blocking((0, 1), 40, 60),
    ]
