"""What keeps a TurtleBot from driving is told to people in words."""

import pytest

from firmware_bridge.onboard.vehicle import LastWord, TurtleBot
from firmware_bridge.serial_port import SerialPort
from tests.kobuki.drives import Rig


def nothing_plugged_in() -> SerialPort:
    raise AssertionError("the port is not asked for")


def vehicle(rig: Rig) -> TurtleBot:
    return TurtleBot(nothing_plugged_in, rig.driver, None, LastWord("base"), lambda line: None)


def test_a_base_that_drives_is_held_by_nothing() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    assert vehicle(rig).held() == ()


@pytest.mark.parametrize(
    ("volts", "told"), [(14.0, "the battery is low"), (13.0, "the battery is nearly empty")]
)
def test_a_battery_that_runs_down_is_told(volts: float, told: str) -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    rig.base.faults.battery = volts
    rig.run(1.0, (0.1, 0.0))
    assert vehicle(rig).held() == (told,)


def test_over_current_is_told() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    rig.base.faults.overcurrent = 1  # left
    rig.run(0.2, (0.1, 0.0))
    assert vehicle(rig).held() == ("a wheel's motor draws too much current: something may hold it",)
