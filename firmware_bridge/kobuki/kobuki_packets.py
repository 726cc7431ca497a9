"""Serial protocol of a Kobuki: commands to the base, feedback from it.

A frame is `AA 55`, length, payload, and the XOR of length and payload. A payload is a sequence of packets
`id, length, data`, little-endian. IDs of commands and feedback overlap, so the direction must be known.
Source: kobuki-base/kobuki_documentation, doc/protocol.rst, compared with the code of kobuki-base/kobuki_core.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from functools import reduce
from operator import xor
from typing import Any, Final, Generic, TypeVar

# --- commands ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BaseControl:
    """Command of a velocity; see `motion.base_control`."""

    speed: int
    """Speed of the outer wheel, mm/s."""
    radius: int
    """Radius, mm; 0 = straight, 1 = turn in place."""


@dataclass(frozen=True)
class SoundSequence:
    """Command to play a built-in sound."""

    melody: int


RECHARGE_MELODY: Final = 2


POWER_RAILS: Final = 0x00F0
"""Outputs of 3.3 V, 5 V, 12 V 5 A and 12 V 1.5 A; clearing them powers off computers connected there."""
LED1_RED: Final = 0x0100
LED1_GREEN: Final = 0x0200


@dataclass(frozen=True)
class GeneralOutput:
    """Command that sets digital outputs (0x000F), power rails and LEDs together."""

    flags: int


Command = BaseControl | SoundSequence | GeneralOutput


# --- feedback ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BasicSensorData:
    """First packet of every feedback."""

    stamp_ms: int
    """Clock of the base, uint16, ms: wraps every 65.536 s."""
    bumper: int
    """Bit 0 right, 1 centre, 2 left."""
    wheel_drop: int
    """Bit 0 right, 1 left."""
    cliff: int
    """Bit 0 right, 1 centre, 2 left."""
    left_ticks: int
    """Encoder ticks, uint16, wrap."""
    right_ticks: int
    left_pwm: int
    right_pwm: int
    buttons: int
    """Bit 0 B0, 1 B1, 2 B2."""
    charger: int
    """0 none, 2 docked and full, 6 docked and charging, 18 adapter and full, 22 adapter and charging."""
    battery_dv: int
    """Battery voltage, 0.1 V."""
    overcurrent: int
    """Bit 0 left wheel, 1 right wheel."""


@dataclass(frozen=True)
class InertialSensorData:
    """Heading and turn rate of the gyro."""

    angle_cdeg: int
    """Heading, 0.01°, counter-clockwise."""
    rate_cdeg: int
    """Turn rate, 0.01°/s."""


@dataclass(frozen=True)
class UnknownPacket:
    """A packet of an unused kind: docking, currents, raw sensors, versions."""

    kind: int
    data: bytes


FeedbackPacket = BasicSensorData | InertialSensorData | UnknownPacket


class WireMisuseError(ValueError):
    """A packet that cannot be encoded: a programming error, not noise."""


class MalformedError(Exception):
    """An invalid payload with a correct checksum: noise."""


_COMMANDS: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    BaseControl: (1, struct.Struct("<hh")),
    SoundSequence: (4, struct.Struct("<B")),
    GeneralOutput: (12, struct.Struct("<H")),
}
_FEEDBACK: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    BasicSensorData: (1, struct.Struct("<HBBBHHbbBBBB")),
    InertialSensorData: (4, struct.Struct("<hh3x")),
}
_UNREAD: Final = {3: 3, 5: 6, 6: 2, 16: 16, 19: 12, 21: 13}
"""Data sizes of unused packets: docking, cliff, currents, inputs, device ID, gains."""
_COMMAND_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _COMMANDS.items()}
_FEEDBACK_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _FEEDBACK.items()}


def encode_command(command: Command) -> bytes:
    """Encode a command. Raises WireMisuseError for a number beyond its field's range."""
    return _packet(command, *_COMMANDS[type(command)])


def encode_feedback(packet: FeedbackPacket) -> bytes:
    """Encode a feedback packet. Raises WireMisuseError for a number beyond its field's range."""
    if isinstance(packet, UnknownPacket):
        return bytes((packet.kind, len(packet.data))) + packet.data
    return _packet(packet, *_FEEDBACK[type(packet)])


def _packet(packet: Any, kind: int, layout: struct.Struct) -> bytes:
    try:
        return bytes((kind, layout.size)) + layout.pack(*astuple(packet))
    except struct.error as error:
        raise WireMisuseError(f"{packet} cannot be encoded: {error}") from None


def decode_commands(payload: bytes) -> list[Command]:
    """Decode the commands of a payload, in order. Raises MalformedError, also for unknown commands."""
    commands: list[Command] = []
    for kind, data in _packets(payload):
        if kind not in _COMMAND_KINDS:
            raise MalformedError(f"unknown command {kind}")
        commands.append(_decoded(kind, data, *_COMMAND_KINDS[kind]))
    return commands


def decode_feedback(payload: bytes) -> list[FeedbackPacket]:
    """Decode the packets of a payload, in order; unused kinds as UnknownPacket. Raises MalformedError."""
    packets: list[FeedbackPacket] = []
    for kind, data in _packets(payload):
        if kind in _FEEDBACK_KINDS:
            packets.append(_decoded(kind, data, *_FEEDBACK_KINDS[kind]))
        else:
            _check_size(kind, data, _UNREAD.get(kind, len(data)))
            packets.append(UnknownPacket(kind, data))
    return packets


def _packets(payload: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and data of each packet. Raises MalformedError unless they fill the payload."""
    at = 0
    while at < len(payload):
        if at + 2 > len(payload) or at + 2 + payload[at + 1] > len(payload):
            raise MalformedError("packet longer than the payload")
        end = at + 2 + payload[at + 1]
        yield payload[at], payload[at + 2 : end]
        at = end


def _decoded(kind: int, data: bytes, of: type[Any], layout: struct.Struct) -> Any:
    _check_size(kind, data, layout.size)
    return of(*layout.unpack(data))


def _check_size(kind: int, data: bytes, size: int) -> None:
    if len(data) != size:
        raise MalformedError(f"packet {kind} has {len(data)} bytes of data, not {size}")


HEADER: Final = b"\xaa\x55"
SHORTEST: Final = 3
"""Minimum payload, bytes: one packet with one byte of data."""
LONGEST: Final = 160
"""Maximum accepted payload, bytes. A base sends up to 124; a larger limit lets noise that looks like a header
delay the following frames by 87 µs per byte."""

P = TypeVar("P")


@dataclass
class WireCounts:
    """Counts of valid frames, and of skipped bytes by cause."""

    frames: int = 0
    noise: int = 0
    """Bytes outside of frames."""
    bad_length: int = 0
    """Headers with an invalid length; one skipped byte each, as for the next two."""
    bad_checksum: int = 0
    malformed: int = 0
    """Correct checksum, invalid packets."""

    @property
    def skipped(self) -> int:
        """Total number of skipped bytes."""
        return self.noise + self.bad_length + self.bad_checksum + self.malformed


def encode_frame(payload: bytes) -> bytes:
    """Return the frame of a payload. Raises WireMisuseError for an invalid length."""
    if not SHORTEST <= len(payload) <= LONGEST:
        raise WireMisuseError(f"payload of {len(payload)} bytes; must have {SHORTEST} to {LONGEST}")
    body = bytes((len(payload),)) + payload
    return HEADER + body + bytes((reduce(xor, body),))


class FrameReader(Generic[P]):
    """Incremental parser of frames in a noisy byte stream.

    After an error it continues one byte after the start of the header, so that a frame within an apparent one
    is found. It buffers at most one frame.
    """

    def __init__(self, decode: Callable[[bytes], P]) -> None:
        """Create it; `decode`: returns the packets of a payload or raises MalformedError."""
        self._decode = decode
        self._pending = bytearray()
        self.reception = WireCounts()

    @property
    def pending(self) -> int:
        """Number of buffered bytes."""
        return len(self._pending)

    def take(self, data: bytes) -> list[P]:
        """Append bytes and return the decoded payloads of completed frames, in order."""
        self._pending += data
        found: list[P] = []
        at = 0
        while True:
            header = self._pending.find(HEADER, at)
            if header < 0:
                kept = int(self._pending.endswith(HEADER[:1], at))
                self.reception.noise += len(self._pending) - at - kept
                at = len(self._pending) - kept
                break
            self.reception.noise += header - at
            at = header
            step = self._frame_at(at, found)
            if step == 0:
                break
            at += step
        del self._pending[:at]
        return found

    def _frame_at(self, at: int, found: list[P]) -> int:
        """Parse the frame at a header; return how many bytes to advance, 0 if it is incomplete."""
        bytes_ = self._pending
        if len(bytes_) < at + 3:
            return 0
        length = bytes_[at + 2]
        if not SHORTEST <= length <= LONGEST:
            self.reception.bad_length += 1
            return 1
        end = at + 3 + length
        if len(bytes_) <= end:
            return 0
        if reduce(xor, bytes_[at + 2 : end + 1]):
            self.reception.bad_checksum += 1
            return 1
        try:
            found.append(self._decode(bytes(bytes_[at + 3 : end])))
        except MalformedError:
            self.reception.malformed += 1
            return 1
        self.reception.frames += 1
        return length + 4
