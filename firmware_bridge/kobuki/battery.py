"""How full a Kobuki's battery is, by its voltage."""

from dataclasses import dataclass
from enum import Enum


class BatteryLevel(Enum):
    """From full to empty."""

    FULL = "full"
    FAIR = "fair"
    LOW = "low"
    DANGER = "danger"


@dataclass(frozen=True)
class BatteryParameters:
    """Voltages of a battery of four lithium-ion cells; kobuki_driver, battery defaults."""

    full: float = 16.5
    """V, and above."""
    low: float = 14.0
    """V, and below."""
    danger: float = 13.2
    """V, and below: the base soon switches itself off."""
    margin: float = 0.3
    """A level is left upwards only so far above its limit, V; own choice: motors pull the voltage down."""


def level(
    volts: float, before: BatteryLevel | None = None, parameters: BatteryParameters = BatteryParameters()
) -> BatteryLevel:
    """The level at `volts`; `before`: the level until now."""
    if volts <= parameters.danger + parameters.margin * (before is BatteryLevel.DANGER):
        return BatteryLevel.DANGER
    low = before in {BatteryLevel.LOW, BatteryLevel.DANGER}
    if volts <= parameters.low + parameters.margin * low:
        return BatteryLevel.LOW
    if volts >= parameters.full - parameters.margin * (before is BatteryLevel.FULL):
        return BatteryLevel.FULL
    return BatteryLevel.FAIR
