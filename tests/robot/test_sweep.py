"""Scans get the pose of their stamp, and no other."""

import math

import pytest
from msgspec.structs import replace

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import Scan
from actors.robot.sweep import Sweeps
from actors.runtime.errors import AcrcError
from tests.robot.base import model
from tests.robot.rig import Robot, refusal

KIND = model(rays=8)
RANGES = bytes(range(16))


def _odometry(x: float, heading: float = 0.0) -> Pose:
    return Pose(x, 0.0, heading)


def _sweeps(*poses: tuple[int, float, float]) -> Sweeps:
    sweeps = Sweeps(KIND.sensor)
    for instant, x, heading in poses:
        assert sweeps.take(Instant(instant), _odometry(x, heading), None) is None
    return sweeps


@pytest.mark.parametrize(
    ("stamp", "x"),
    [(300, 3.0), (250, 2.5), (200, 2.0), (125, 1.25), (100, 1.0), (20, 1.0), (999, 3.0)],
    ids=["now", "between", "at a step", "in the step before", "at the first", "before it", "in the future"],
)
def test_pose_is_that_of_the_stamp(stamp: int, x: float) -> None:
    sweeps = _sweeps((100, 1.0, 0.0), (200, 2.0, 0.0))
    sweep = sweeps.take(Instant(300), _odometry(3.0), Scan(stamp, RANGES))
    assert sweep is not None
    assert sweep.pose == Pose(x, 0.0, 0.0)
    assert sweep.ranges_mm.tobytes() == RANGES


def test_heading_goes_the_short_way_round() -> None:
    sweeps = _sweeps((0, 0.0, math.pi - 0.1))
    sweep = sweeps.take(Instant(100), _odometry(0.0, 0.1 - math.pi), Scan(75, RANGES))
    assert sweep is not None
    assert sweep.pose.heading == pytest.approx(0.05 - math.pi)


def test_another_number_of_rays_is_refused() -> None:
    with pytest.raises(AcrcError) as raised:
        Sweeps(KIND.sensor).take(Instant(0), _odometry(0.0), Scan(0, RANGES + b"12"))
    assert str(raised.value) == ("a scan of 18 bytes arrived; the 8 rays of the robot's range sensor give 16")


def test_an_earlier_scan_of_the_step_gets_its_own_pose() -> None:
    sweeps = _sweeps((100, 1.0, 0.0))
    latest = sweeps.take(Instant(200), _odometry(2.0), Scan(200, RANGES))
    assert latest is not None and latest.pose.x == 2.0
    assert sweeps.placed(Scan(150, RANGES)).pose.x == 1.5


@pytest.mark.parametrize("wild", [float("nan"), float("inf"), -1e200])
@pytest.mark.parametrize("field", ["x", "y", "heading", "vx", "vy", "omega"])
def test_odometry_that_cannot_be_is_refused(field: str, wild: float) -> None:
    robot = Robot()
    senses = robot.base.senses(0)
    senses = replace(senses, odometry=replace(senses.odometry, **{field: wild}))
    told = refusal(robot, senses=senses)
    assert told.startswith("step 0: r1 got the odometry (") and f"{wild:g}" in told
    assert told.endswith("; each should be at most 100000")
    assert robot.behaviour.views == []
