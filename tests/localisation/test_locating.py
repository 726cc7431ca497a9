"""A robot in doubt about its pose: located while it stands, if it is about where it last was."""

import numpy as np
import pytest

from actors.geometry import Pose
from actors.robot.localisation import PRESETS, Amcl, DeadReckoning
from actors.robot.sweep import Sweep
from tests.localisation.scenes import FIELD, ROOM, TURTLEBOT, error, scan

TRUTH = Pose(3.2, 4.5, 0.6)
HERE = Pose(40.0, -7.0, 2.0)
"""What the odometry says; its origin is far away, as after a long drive."""


def stand(believed: Pose, doubt: float, preset: str, seed: int, scans: int = 60) -> tuple[int | None, Pose]:
    """Scans until it was located, None if it was not; and its pose then."""
    start = believed.compose(HERE.relative(Pose(0.0, 0.0, 0.0)))
    parameters, generator = PRESETS[preset], np.random.default_rng(seed)
    localiser = Amcl(FIELD, TURTLEBOT.sensor, start, generator, parameters, doubt)
    seen = scan(ROOM, TRUTH)
    before = localiser.update(HERE, None)
    assert not before.located and before.lost == 1.0
    for number in range(1, scans + 1):
        estimate = localiser.update(HERE, Sweep(seen, HERE))
        if estimate.located:
            assert estimate.lost < 0.1
            return number, estimate.pose
    return None, estimate.pose


@pytest.mark.parametrize("preset", ["chapter", "robust"])
@pytest.mark.parametrize("seed", range(4))
def test_near_to_where_it_last_was_it_is_located_while_it_stands(preset: str, seed: int) -> None:
    believed = Pose(TRUTH.x + 0.3, TRUTH.y - 0.25, TRUTH.heading + 0.25)
    scans, pose = stand(believed, 0.3, preset, seed)
    assert scans is not None
    assert error(pose, TRUTH) < 0.2 and abs(pose.heading - TRUTH.heading) < 0.1


@pytest.mark.parametrize("preset", ["chapter", "robust"])
@pytest.mark.parametrize("seed", range(4))
def test_carried_elsewhere_it_is_not_located(preset: str, seed: int) -> None:
    scans, _ = stand(Pose(6.8, 1.5, -2.0), 0.3, preset, seed)
    assert scans is None, "rooms are alike: what is far from what it knew it has to be told"


def test_without_a_map_it_stays_in_doubt() -> None:
    assert not DeadReckoning(TRUTH, 0.3).update(HERE, None).located
    assert DeadReckoning(TRUTH).update(HERE, None).located
