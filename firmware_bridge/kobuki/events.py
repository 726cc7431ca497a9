"""What a Kobuki's driver tells: events, as data."""

from dataclasses import dataclass
from enum import Enum

from actors.instant import Instant
from firmware_bridge.kobuki.packets import UDID, Feedback, FirmwareVersion
from firmware_bridge.kobuki.safety import StopCause


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


@dataclass(frozen=True)
class Found:
    """The base has begun to send feedback."""

    instant: Instant


@dataclass(frozen=True)
class Lost:
    """The base sends no feedback any more."""

    instant: Instant
    since: Instant
    """Of its last feedback."""


@dataclass(frozen=True)
class Fed:
    """One feedback; `packets` begins with Basic."""

    instant: Instant
    packets: tuple[Feedback, ...]


class Sense(Enum):
    """Fields of Basic whose changes are events; each value is the field's name."""

    BUMPER = "bumper"
    WHEEL_DROP = "wheel_drop"
    CLIFF = "cliff"
    BUTTONS = "buttons"
    CHARGER = "charger"
    OVERCURRENT = "overcurrent"


@dataclass(frozen=True)
class FieldChanged:
    """A field of Basic has another value than before; before the first feedback all were 0."""

    instant: Instant
    sense: Sense
    before: int
    now: int


@dataclass(frozen=True)
class BatteryChanged:
    """The battery has come to another level, or its level has become known."""

    instant: Instant
    volts: float
    level: BatteryLevel


@dataclass(frozen=True)
class BaseIdentity:
    """Which base it is; None = it has not said so yet."""

    hardware: FirmwareVersion | None = None
    firmware: FirmwareVersion | None = None
    udid: UDID | None = None

    @property
    def complete(self) -> bool:
        """True once all is known."""
        return None not in (self.hardware, self.firmware, self.udid)


@dataclass(frozen=True)
class Identified:
    """The base has said all about itself."""

    instant: Instant
    identity: BaseIdentity


@dataclass(frozen=True)
class StopsChanged:
    """Other causes hold the base back than before."""

    instant: Instant
    stops: tuple[StopCause, ...]


Event = Found | Lost | Fed | FieldChanged | BatteryChanged | Identified | StopsChanged
