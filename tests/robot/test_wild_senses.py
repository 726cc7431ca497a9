"""What no base can have measured ends a robot before it moves by it."""

import pytest
from msgspec.structs import replace

from tests.robot.rig import Robot, refusal


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
