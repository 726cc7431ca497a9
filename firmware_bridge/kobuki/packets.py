"""Packets of a Kobuki: commands to the base and feedback from it; numbers as they stand on the wire.

Source: kobuki-base/kobuki_documentation, doc/protocol.rst, read beside the code of kobuki-base/kobuki_core.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

# --- commands ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BaseControl:
    """Drive; `motion` says what the pair of numbers means."""

    speed: int
    """mm/s."""
    radius: int
    """mm; 0 straight, 1 turn on the spot."""


class Melody(IntEnum):
    """The base's own sounds."""

    ON = 0
    OFF = 1
    RECHARGE = 2
    BUTTON = 3
    ERROR = 4
    CLEANING_START = 5
    CLEANING_END = 6


@dataclass(frozen=True)
class SoundSequence:
    """Play one of the base's own sounds."""

    melody: int


HARDWARE_REQUEST: Final = 0x01
FIRMWARE_REQUEST: Final = 0x02
UDID_REQUEST: Final = 0x08


@dataclass(frozen=True)
class RequestExtra:
    """Ask for versions and the unique device id; they ride in the next feedback."""

    flags: int


POWER_RAILS: Final = 0x00F0
"""The outputs of 3.3 V, 5 V, 12 V 5 A and 12 V 1.5 A: whatever computer hangs on them goes out with them."""
LED1_RED: Final = 0x0100
LED1_GREEN: Final = 0x0200
LED2_RED: Final = 0x0400
LED2_GREEN: Final = 0x0800


@dataclass(frozen=True)
class GeneralOutput:
    """Set digital outputs (0x000F), power rails and LEDs, all at once."""

    flags: int


Command = BaseControl | SoundSequence | RequestExtra | GeneralOutput


# --- feedback ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Basic:
    """What every feedback starts with."""

    stamp_ms: int
    """The base's clock, uint16: wraps every 65.536 s."""
    bumper: int
    """Bit 0 right, 1 centre, 2 left."""
    wheel_drop: int
    """Bit 0 right, 1 left."""
    cliff: int
    """Bit 0 right, 1 centre, 2 left."""
    left_ticks: int
    """uint16, wraps."""
    right_ticks: int
    left_pwm: int
    right_pwm: int
    buttons: int
    """Bit 0 B0, 1 B1, 2 B2."""
    charger: int
    """0 none, 2 docked and full, 6 docked and charging, 18 adapter and full, 22 adapter and charging."""
    battery_dv: int
    """0.1 V."""
    overcurrent: int
    """Bit 0 left wheel, 1 right wheel."""


@dataclass(frozen=True)
class Inertial:
    """Heading and turn rate of the gyro."""

    angle_cdeg: int
    """0.01°, counter-clockwise."""
    rate_cdeg: int
    """0.01°/s."""


@dataclass(frozen=True, order=True)
class FirmwareVersion:
    """A version number."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.patch}"


@dataclass(frozen=True)
class Hardware:
    """The base's hardware version."""

    version: FirmwareVersion


@dataclass(frozen=True)
class Firmware:
    """The base's firmware version."""

    version: FirmwareVersion


@dataclass(frozen=True)
class UDID:
    """The base's unique device id."""

    words: tuple[int, int, int]

    def __str__(self) -> str:
        return "-".join(str(word) for word in self.words)


@dataclass(frozen=True)
class Unknown:
    """A packet of a kind that nobody here reads: docking, currents, raw sensors, or of a newer firmware."""

    kind: int
    data: bytes


Feedback = Basic | Inertial | Hardware | Firmware | UDID | Unknown
