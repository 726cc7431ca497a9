import math

import numpy as np
import pytest
from scipy import stats

from benchmarks.localisation.metrics import (
    NEES_BOUNDS,
    EstimatedTrack,
    FilterRun,
    beside_truth,
    nees,
    weighed,
)
from benchmarks.localisation.report import Share, interval, share, summary


def a_run(
    errors: list[float], seed: int = 1, turn: float = 0.0, announced: tuple[int, ...] = ()
) -> FilterRun:
    n = len(errors)
    same = np.full(n, 2.0, np.float32)
    return FilterRun(
        seed,
        np.array(errors, np.float32),
        np.full(n, turn, np.float32),
        same,
        np.isin(np.arange(n), announced),
        np.array([1e-4, 3e-4], np.float32),
        {},
    )


def test_the_bounds_are_those_of_chi_squared() -> None:
    np.testing.assert_allclose(NEES_BOUNDS, stats.chi2(3).ppf([0.025, 0.975]), atol=5e-5)


def test_nees_of_errors_drawn_from_the_covariance_is_chi_squared() -> None:
    draws = np.random.default_rng(5)
    root = np.array([[0.2, 0.0, 0.0], [0.1, 0.05, 0.0], [0.01, 0.02, 0.003]])
    off = draws.standard_normal((20_000, 3)) @ root.T
    values = nees(off, np.broadcast_to(root @ root.T, (20_000, 3, 3)))
    assert stats.kstest(values, stats.chi2(3).cdf).pvalue > 0.01
    by_hand = off[7] @ np.linalg.inv(root @ root.T) @ off[7]
    assert values[7] == pytest.approx(by_hand, rel=1e-6)


def test_nees_of_a_covariance_that_claims_certainty_is_infinite() -> None:
    flat = np.diag([1.0, 1.0, 0.0])
    linear = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    broken = np.diag([1.0, math.nan, 1.0])
    covariances = np.stack([np.zeros((3, 3)), flat, linear, broken, np.eye(3)])
    assert nees(np.zeros((5, 3)), covariances).tolist() == [math.inf] * 4 + [0.0]


def test_a_call_that_only_follows_the_odometry_has_weighed_nothing() -> None:
    draws = np.random.default_rng(1)
    odometry = np.cumsum(draws.normal(0, 0.1, (50, 3)), axis=0)
    odometry[:, 2] = np.remainder(odometry[:, 2] + math.pi, math.tau) - math.pi
    corrections = np.repeat([[1.0, 2.0, 0.5], [1.1, 2.0, 0.5], [1.1, 2.0, 3.0]], [20, 20, 10], axis=0)
    c, s = np.cos(corrections[:, 2]), np.sin(corrections[:, 2])
    poses = corrections + np.column_stack(
        [
            c * odometry[:, 0] - s * odometry[:, 1],
            s * odometry[:, 0] + c * odometry[:, 1],
            odometry[:, 2],
        ]
    )
    assert np.flatnonzero(weighed(odometry, poses)).tolist() == [0, 20, 40]


def test_a_run_s_errors_are_those_to_the_truth_the_short_way_round() -> None:
    truth = np.array([[0.0, 0.0, 3.1], [1.0, 0.0, 3.1]])
    poses = np.array([[0.3, 0.4, -3.1], [1.0, 1.2, 3.0]])
    track = EstimatedTrack(
        poses, np.tile(np.eye(3), (2, 1, 1)), np.array([0.2, 0.96]), np.array([1e-4, 2e-4]), {"updates": 2}
    )
    run = beside_truth(9, truth, truth.copy(), track)
    np.testing.assert_allclose(run.errors, [0.5, 1.2], atol=1e-6)
    np.testing.assert_allclose(run.turns, [math.tau - 6.2, 0.1], atol=1e-6)
    np.testing.assert_allclose(run.nees, [0.25 + (math.tau - 6.2) ** 2, 1.44 + 0.01], atol=1e-6)
    assert run.announced.tolist() == [False, True]
    told = run.figures()
    assert told["rmse"] == pytest.approx(math.sqrt((0.25 + 1.44) / 2))
    assert told["lost"] and told["max"] == pytest.approx(1.2) and told["share_beyond"] == 0.5


def test_who_is_found_is_near_and_faces_about_where_it_faces() -> None:
    run = a_run([3.0, 0.6, 0.4])
    assert [run.found(step) for step in (0, 1, 2, 99)] == [False, False, True, True]
    assert not a_run([0.1], turn=0.3).found(0)


def test_a_spell_of_being_lost_takes_3_s_and_is_announced_while_it_lasts() -> None:
    errors = [0.1] * 20 + [1.2] * 30 + [0.1] * 20 + [1.2] * 29 + [0.1] + [2.0] * 40
    assert a_run(errors).spells == [False, False]
    assert a_run(errors, announced=(19, 50, 60, 80, 139)).spells == [False, True]
    assert a_run([2.0] * 30, announced=(0,)).spells == [True]


def test_an_announcement_is_false_if_the_robot_was_near_the_truth_for_5_s_before_and_after() -> None:
    errors = [0.1] * 100 + [0.6] + [0.1] * 100
    assert a_run(errors, announced=(20, 21, 23, 55, 149, 160)).false_alarms == 3
    assert a_run(errors).false_alarms == 0


def test_consistency_is_asked_for_while_the_robot_is_not_lost() -> None:
    one = a_run([0.1, 0.5, 0.6])
    assert len(one.tracking) == 2
    assert summary([a_run([3.0])]).nees_median is None


def test_a_share_of_nothing_may_be_anything() -> None:
    assert share(0, 0) == Share(0, 0, 0.0, 1.0)


@pytest.mark.parametrize(("count", "of"), [(0, 100), (3, 20), (20, 20), (1, 2)])
def test_shares_have_wilson_s_interval(count: int, of: int) -> None:
    told = share(count, of)
    right = stats.binomtest(count, of).proportion_ci(method="wilson")
    assert (told.low, told.high) == pytest.approx((right.low, right.high), abs=1e-6)


def test_the_bootstrap_covers_the_truth_about_as_often_as_it_says() -> None:
    draws = np.random.default_rng(3)
    inside = 0
    for _ in range(200):
        low, high = interval(draws.uniform(0.5, 1.5, 30))
        inside += low <= 1.0 <= high
    assert 178 <= inside <= 198  # 95 %, less what 30 runs cost the bootstrap


def test_a_summary_counts_every_run() -> None:
    one = summary([a_run([0.1, 0.1]), a_run([0.1, 0.7]), a_run([0.1, 1.1])])
    assert (one.runs, one.lost.count, one.lost.of) == (3, 1, 3)
    assert one.rmse == pytest.approx(math.sqrt((4 * 0.01 + 0.49 + 1.21) / 6), rel=1e-6)
    assert one.rmse_low < one.rmse < one.rmse_high
    assert one.share_beyond == pytest.approx(2 / 6) and one.max == pytest.approx(1.1)
    assert (one.spells.of, one.false_alarms) == (0, 0) and one.hours == pytest.approx(6 / 36_000)
    assert one.nees_median == 2.0 and one.nees_below == one.nees_above == 0.0
    assert one.cpu_us_mean == pytest.approx(200, rel=1e-5) and one.cpu_us_min == pytest.approx(100, rel=1e-5)
