"""Covariance of estimates, compared with numpy, and the probability of being lost."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.array_types import Floats
from actors.geometry import Covariance, Pose
from actors.robot.localisation import LikelihoodField, likelihood_field, search
from actors.robot.localisation.confidence import AGREES, CovarianceModel, updated_covariance
from actors.robot.localisation.search import LostProbability, odds_of_lost
from tests.localisation.scenes import BEAMS, FIELD, ROOM, TURTLEBOT, apartment, ends, room, scan

HERE = Pose(3.2, 4.0, 0.4)
PRIOR: Covariance = (0.09, 0.02, 0.01, 0.02, 0.05, -0.01, 0.01, -0.01, 0.04)
NONE = np.empty((0, 2))


def matrix(covariance: Covariance) -> Floats:
    return np.array(covariance).reshape(3, 3)


def seen_from(pose: Pose, others: int = 0, seed: int = 0) -> Floats:
    middle = np.random.default_rng(seed).uniform(1.0, 7.0, (others, 2))
    return ends(scan(ROOM, pose, np.column_stack((middle, np.full(others, 0.18)))))


def level(field: LikelihoodField, at: Floats) -> float:
    column, row = np.floor((at - field.frame[:2]) / field.frame[2]).astype(int)
    return float(field.distances[field.levels[row, column]])


def slope(field: LikelihoodField, at: Floats) -> Floats:
    side = float(field.frame[2])
    over = np.array([[side, 0.0], [0.0, side]])
    return np.array([(level(field, at + d) - level(field, at - d)) / (2 * side) for d in over])


def informed(field: LikelihoodField, points: Floats, pose: Pose, variance: float) -> Floats:
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    turn, turning = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
    information = np.linalg.inv(matrix(PRIOR))
    near = [point for point in points if level(field, turn @ point + (pose.x, pose.y)) <= AGREES]
    for point in near:
        by_place = slope(field, turn @ point + (pose.x, pose.y))
        g = np.append(by_place, by_place @ (turning @ point))
        information += np.outer(g, g) / (variance * (len(points) / len(near)) ** 2)
    return np.linalg.inv(information)


def trust(field: LikelihoodField = FIELD, count: int = 60) -> CovarianceModel:
    return CovarianceModel(field, TURTLEBOT.sensor, count)


@pytest.mark.parametrize(("seed", "variance"), [(0, 0.0004), (1, 0.01), (2, 1.0), (3, 0.01)])
def test_the_covariance_equals_the_information_form(seed: int, variance: float) -> None:
    x, y, heading = np.random.default_rng(seed).normal(HERE, (0.05, 0.05, 0.03)).tolist()
    pose, points = Pose(x, y, heading), seen_from(HERE, 3, seed)
    after = matrix(updated_covariance(FIELD, points, pose, PRIOR, variance))
    assert after == pytest.approx(informed(FIELD, points, pose, variance), rel=1e-6, abs=1e-12)
    assert np.array_equal(after, after.T)


def test_without_beams_near_walls_the_covariance_is_unchanged() -> None:
    assert trust().covariance(NONE, HERE, PRIOR, 0.0) == pytest.approx(PRIOR)
    middle = 0.7 * BEAMS.directions + BEAMS.mount
    for points, pose in ((NONE, HERE), (middle, HERE), (seen_from(HERE), Pose(1e6, -1e6, 1.0))):
        assert updated_covariance(FIELD, points, pose, PRIOR, 0.001) == PRIOR


def test_in_a_long_corridor_it_is_wide_along_and_narrow_across() -> None:
    """The corridor is 20 m long; both ends are beyond the sensor's range."""
    plan = room(((0.0, 9.0, 20.0, 9.2), (0.0, 10.8, 20.0, 11.0)), 20.0)
    field, pose = likelihood_field(plan, 2.0), Pose(10.0, 10.0, 0.0)
    cloud = (0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.04)
    found = trust(field).covariance(ends(scan(plan, pose)), pose, cloud, 0.0)
    assert found[0] == pytest.approx(0.25)
    assert found[4] < 0.05 * 0.25 and found[8] < 0.05 * 0.04
    everywhere = trust().covariance(seen_from(HERE), HERE, cloud, 0.0)
    assert everywhere[0] < 0.05 * 0.25 and everywhere[4] < 0.05 * 0.25


def test_more_beams_at_the_same_walls_hardly_reduce_the_covariance() -> None:
    """Their errors are correlated: 120 beams at 3° have the information of 60 at 6°."""
    few, many = seen_from(HERE), np.repeat(seen_from(HERE), 2, axis=0)
    once, twice = trust(count=60), trust(count=120)
    expected = once.covariance(few, HERE, PRIOR, 0.0)
    assert twice.covariance(many, HERE, PRIOR, 0.0) == pytest.approx(expected)


@pytest.mark.parametrize("lost", [0.1, 1.0])
def test_a_possibly_lost_robot_has_a_map_wide_covariance(lost: float) -> None:
    points = seen_from(HERE)
    tracking = np.array(trust().covariance(points, HERE, PRIOR, 0.0))
    found = trust().covariance(points, HERE, PRIOR, lost)
    assert found == pytest.approx((1 - lost) * tracking + lost * np.array(FIELD.anywhere))
    assert trust().covariance(points, HERE, PRIOR, 0.04) == pytest.approx(tracking)  # below the threshold


@pytest.mark.parametrize("field", [FIELD, apartment()], ids=["room", "apartment"])
def test_anywhere_is_the_covariance_of_pose_differences(field: LikelihoodField) -> None:
    """100 000 draws: 2 % of the larger are about five standard errors."""
    rng = np.random.default_rng(0)
    apart = field.poses(rng, 100_000) - field.poses(rng, 100_000)
    apart[2] = np.remainder(apart[2] + np.pi, 2 * np.pi) - np.pi
    scale = np.sqrt(np.outer(np.diag(matrix(field.anywhere)), np.diag(matrix(field.anywhere))))
    assert np.cov(apart) / scale == pytest.approx(matrix(field.anywhere) / scale, abs=0.02)


beams = st.integers(0, 1000)


def likelihood(passing: float, agreeing: float, agreed: int, passed: int) -> float:
    """Return the log-likelihood of a beta-binomial without the binomial coefficient, which cancels."""

    def beta(a: float, b: float) -> float:
        return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)

    return beta(passing + passed, agreeing + agreed) - beta(passing, agreeing)


@given(beams, beams)
def test_the_odds_are_the_root_of_the_ratio_of_two_beta_binomials(agreed: int, passed: int) -> None:
    ratio = likelihood(*search._LOST, agreed, passed) - likelihood(*search._TRACKING, agreed, passed)
    assert odds_of_lost(agreed, passed) == pytest.approx(math.exp(0.5 * ratio), rel=1e-9)


@given(st.integers(1, 200), st.integers(0, 200))
def test_passing_beams_raise_and_agreeing_beams_lower_the_probability(agreed: int, passed: int) -> None:
    assert odds_of_lost(agreed, passed + 1) > odds_of_lost(agreed, passed)
    if passed == 0:  # with many passing beams, one that agrees only shows that the share is below 1
        assert odds_of_lost(agreed + 1, 0) < odds_of_lost(agreed, 0)


@given(st.lists(st.tuples(beams, beams), max_size=40), st.floats(0.0, 1.0))
def test_the_probability_is_bounded(scans: list[tuple[int, int]], first: float) -> None:
    state = LostProbability(first)
    for agreed, passed in scans:
        state.take(agreed, passed)
        assert 1e-6 <= state.probability <= 0.999


def test_the_probability_recovers_after_any_number_of_scans() -> None:
    state = LostProbability(0.0)
    for scans, agreed, passed, least, most in (
        (300, 50, 0, 1e-6, 0.01), (1000, 0, 1000, 0.999, 0.999), (15, 50, 0, 0.0, 0.01), (10, 10, 30, 0.99, 1)
    ):  # fmt: skip
        for number in range(scans):  # a beam grazes a corner now and then
            state.take(agreed, passed or number % 5 == 1)
        assert least <= state.probability <= most
