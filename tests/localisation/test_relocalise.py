"""Asked to look for itself, a robot forgets where it was, and finds itself as it drives."""

import numpy as np

from actors.geometry import Pose
from actors.robot.localisation import DeadReckoning
from actors.robot.sweep import Sweep
from tests.localisation.scenes import APARTMENT, Drive, amcl, anywhere, apartment, error
from tests.localisation.test_carried import ROBUST


def test_it_has_particles_everywhere_says_that_it_is_lost_and_comes_back() -> None:
    here = anywhere(1, 0)
    robot = amcl(ROBUST, here, apartment(), 1)
    drive = list(Drive(APARTMENT, here, 1).sweeps(60.0))
    for _, sweep in drive[:50]:
        estimate = robot.update(sweep.pose, sweep)
    assert estimate.lost < 0.05 and np.ptp(robot.particles[:, 0]) < 2.0
    robot.relocalise()
    assert len(robot.particles) == ROBUST.max_particles and np.ptp(robot.particles[:, 0]) > 5.0
    assert robot.update(drive[50][1].pose, None).lost > 0.99
    for _, sweep in drive[50:]:
        estimate = robot.update(sweep.pose, Sweep(sweep.ranges_mm, sweep.pose))
    assert error(estimate.pose, drive[-1][0]) < 0.5 and estimate.lost < 0.05


def test_the_odometry_alone_finds_nothing() -> None:
    robot = DeadReckoning(Pose(1.0, 2.0, 0.0))
    before = robot.update(Pose(0.5, 0.0, 0.0), None)
    robot.relocalise()
    assert robot.update(Pose(0.5, 0.0, 0.0), None) == before
