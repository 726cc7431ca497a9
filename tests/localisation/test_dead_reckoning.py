"""Dead reckoning: the pose at switch-on, moved as the odometry says."""

import numpy as np
import pytest

from actors.geometry import Pose
from actors.robot.localisation import DeadReckoning


def test_dead_reckoning_composes_start_and_odometry() -> None:
    localisation = DeadReckoning(Pose(2.0, 3.0, np.pi / 2))
    found = localisation.update(Pose(1.0, 0.5, np.pi), None)
    assert found.pose == pytest.approx((1.5, 4.0, -np.pi / 2))
    assert (found.covariance, found.located, found.lost) == ((0.0,) * 9, True, 0.0)
