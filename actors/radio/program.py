"""The radio's core from its setup."""

from actors.radio.core import RadioCore
from actors.radio.parameters import preset
from actors.radio.setup import RadioSetup
from actors.runtime.errors import AcrcError

GREATEST_ADDRESS = 0xFFFD
"""0xFFFE and 0xFFFF mean "no address" and "everyone" (IEEE 802.15.4-2006, 7.2.1)."""


def build(setup: RadioSetup) -> RadioCore:
    """The core, before its first step; AcrcError if the setup makes no sense."""
    parameters = preset(setup.preset)
    if setup.step_us < 1:
        raise AcrcError(f"The radio's step is {setup.step_us} µs long; it must be at least 1 µs.")
    owners: dict[int, str] = {}
    names: set[str] = set()
    for robot, address in setup.robots:
        if not 0 <= address <= GREATEST_ADDRESS:
            raise AcrcError(
                f"Robot {robot} has the short address {address}; it must be 0 to {GREATEST_ADDRESS}."
            )
        if address in owners:
            raise AcrcError(
                f"Robots {owners[address]} and {robot} share the short address {address}; each needs its own."
            )
        if robot in names:
            raise AcrcError(f"Robot {robot} is listed twice for the radio; each robot needs one entry.")
        owners[address] = robot
        names.add(robot)
    return RadioCore(setup.robots, setup.step_us, parameters)
