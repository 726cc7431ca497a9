"""What a Kobuki's driver tells: events, as data."""

from dataclasses import dataclass
from enum import Enum

from actors.instant import Instant
from firmware_bridge.kobuki.battery import BatteryLevel
from firmware_bridge.kobuki.packets import UDID, Feedback, FirmwareVersion
from firmware_bridge.kobuki.safety import StopCause


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
