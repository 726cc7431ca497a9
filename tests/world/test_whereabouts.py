"""How far robots are from where they hold themselves to be."""

import math

import pytest

from actors.messages import RobotTruth
from actors.world.whereabouts import PoseError, Whereabouts


def _truth(x: float, y: float = 0.0) -> RobotTruth:
    return RobotTruth("r1", x, y, 0.0, 0.0, 0.0, 0.0, True, True, 0)


def test_errors_are_those_of_the_samples() -> None:
    whereabouts = Whereabouts(2)
    for held, x in ((0.0, 0.3), (0.0, -0.6), (5.0, 5.0), (0.0, 1.2), (0.0, 1.5), (0.0, 0.9)):
        whereabouts.take(0, (held, 0.0, 1.0), _truth(x))
    error = whereabouts.error(0)
    assert error.samples == 6
    assert error.rmse == pytest.approx(math.sqrt((0.09 + 0.36 + 1.44 + 2.25 + 0.81) / 6))
    assert (error.greatest, error.astray_share, error.lost_share) == (1.5, 4 / 6, 2 / 6)
    assert (error.times_lost, error.lost_at_end) == (1, False)
    assert whereabouts.error(1) == PoseError(0, 0.0, 0.0, 0.0, 0.0, 0, False)


def test_a_robot_gets_lost_anew_after_it_has_found_itself() -> None:
    whereabouts = Whereabouts(1)
    for y in (1.1, 1.3, 0.0, 2.0):
        whereabouts.take(0, (0.0, 0.0, 0.0), _truth(0.0, y))
    assert (whereabouts.error(0).times_lost, whereabouts.error(0).lost_at_end) == (2, True)


def test_who_says_nothing_is_not_measured() -> None:
    whereabouts = Whereabouts(1)
    whereabouts.take(0, None, _truth(7.0))
    assert whereabouts.error(0).samples == 0
