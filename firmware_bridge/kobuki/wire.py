"""Packets of a Kobuki and their bytes: commands to the base, feedback from it.

A frame is `AA 55`, length, payload, and the exclusive or of length and payload. A payload is a row of packets
`id, length, data`, little-endian. Ids of commands and feedback overlap, so the direction must be known.
Source: kobuki-base/kobuki_documentation, doc/protocol.rst, compared with the code of kobuki-base/kobuki_core.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from functools import reduce
from operator import xor
from typing import Any, Final, Generic, NamedTuple, TypeVar

from actors.instant import Instant

# --- commands ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BaseControl:
    """Drive; `motion` says what the pair of numbers means."""

    speed: int
    """mm/s."""
    radius: int
    """mm; 0 straight, 1 turn on the spot."""


@dataclass(frozen=True)
class SoundSequence:
    """Play one of the base's own sounds."""

    melody: int


RECHARGE_MELODY: Final = 2


POWER_RAILS: Final = 0x00F0
"""The outputs of 3.3 V, 5 V, 12 V 5 A and 12 V 1.5 A: whatever computer hangs on them goes out with them."""
LED1_RED: Final = 0x0100
LED1_GREEN: Final = 0x0200


@dataclass(frozen=True)
class GeneralOutput:
    """Set digital outputs (0x000F), power rails and LEDs, all at once."""

    flags: int


Command = BaseControl | SoundSequence | GeneralOutput


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


@dataclass(frozen=True)
class Unknown:
    """A packet of a kind that nobody here reads: docking, currents, raw sensors, versions."""

    kind: int
    data: bytes


FeedbackPacket = Basic | Inertial | Unknown


class BaseFeedback(NamedTuple):
    """What a base reported at once, and when it arrived."""

    instant: Instant
    basic: Basic
    inertial: Inertial | None
    """None: there is no gyro, or it is not trusted."""


class WireMisuseError(ValueError):
    """A packet of our own making that has no bytes: our mistake, never noise."""


class MalformedError(Exception):
    """A payload with a right checksum that no Kobuki would send: noise."""


_COMMANDS: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    BaseControl: (1, struct.Struct("<hh")),
    SoundSequence: (4, struct.Struct("<B")),
    GeneralOutput: (12, struct.Struct("<H")),
}
_FEEDBACK: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    Basic: (1, struct.Struct("<HBBBHHbbBBBB")),
    Inertial: (4, struct.Struct("<hh3x")),
}
_UNREAD: Final = {3: 3, 5: 6, 6: 2, 16: 16, 19: 12, 21: 13}
"""Bytes of data of packets that nobody here reads: docking, cliff, currents, inputs, device id, gains."""
_COMMAND_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _COMMANDS.items()}
_FEEDBACK_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _FEEDBACK.items()}


def encode_command(command: Command) -> bytes:
    """Return the packet's bytes. Raises WireMisuseError for a number that its field cannot hold."""
    return _packet(command, *_COMMANDS[type(command)])


def encode_feedback(packet: FeedbackPacket) -> bytes:
    """Return the packet's bytes, as a base sends them. Raises WireMisuseError as `encode_command` does."""
    if isinstance(packet, Unknown):
        return bytes((packet.kind, len(packet.data))) + packet.data
    return _packet(packet, *_FEEDBACK[type(packet)])


def _packet(packet: Any, kind: int, layout: struct.Struct) -> bytes:
    try:
        return bytes((kind, layout.size)) + layout.pack(*astuple(packet))
    except struct.error as error:
        raise WireMisuseError(f"{packet} has no bytes: {error}") from None


def decode_commands(payload: bytes) -> list[Command]:
    """Return the commands of a payload, in order. Raises MalformedError; a base knows every command."""
    commands: list[Command] = []
    for kind, data in _packets(payload):
        if kind not in _COMMAND_KINDS:
            raise MalformedError(f"there is no command {kind}")
        commands.append(_decoded(kind, data, *_COMMAND_KINDS[kind]))
    return commands


def decode_feedback(payload: bytes) -> list[FeedbackPacket]:
    """Return the packets of a payload, in order, those of unknown kinds as Unknown. Raises MalformedError."""
    packets: list[FeedbackPacket] = []
    for kind, data in _packets(payload):
        if kind in _FEEDBACK_KINDS:
            packets.append(_decoded(kind, data, *_FEEDBACK_KINDS[kind]))
        else:
            _check_size(kind, data, _UNREAD.get(kind, len(data)))
            packets.append(Unknown(kind, data))
    return packets


def _packets(payload: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and data of each packet; together they fill the payload exactly."""
    at = 0
    while at < len(payload):
        if at + 2 > len(payload) or at + 2 + payload[at + 1] > len(payload):
            raise MalformedError("a packet is longer than the payload")
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
"""Bytes of the shortest payload: one packet with one byte of data."""
LONGEST: Final = 160
"""Bytes of the longest payload that is believed. All that a base can say at once makes 124; each byte more
lets noise that looks like a header hold up what follows, 87 µs per byte."""

P = TypeVar("P")


@dataclass
class WireCounts:
    """What came over a wire: frames that were right, and bytes that were skipped, by cause."""

    frames: int = 0
    noise: int = 0
    """Bytes before a header."""
    bad_length: int = 0
    """Headers with an impossible length after them; one byte skipped for each, as for the next two."""
    bad_checksum: int = 0
    malformed: int = 0
    """Right checksum, wrong packets."""

    @property
    def skipped(self) -> int:
        """Bytes that belonged to no frame."""
        return self.noise + self.bad_length + self.bad_checksum + self.malformed


def encode_frame(payload: bytes) -> bytes:
    """The frame of a payload. Raises WireMisuseError where its length is impossible."""
    if not SHORTEST <= len(payload) <= LONGEST:
        raise WireMisuseError(f"a payload of {len(payload)} bytes; it should have {SHORTEST} to {LONGEST}")
    body = bytes((len(payload),)) + payload
    return HEADER + body + bytes((reduce(xor, body),))


class FrameReader(Generic[P]):
    """Finds the frames in a stream of bytes, whatever else is in it, and decodes their payloads.

    After anything wrong it goes on one byte after the header's first, so a frame within what looked like one
    is found; it holds at most one frame's bytes between calls.
    """

    def __init__(self, decode: Callable[[bytes], P]) -> None:
        """`decode`: gives the packets of a payload, or raises MalformedError."""
        self._decode = decode
        self._pending = bytearray()
        self.reception = WireCounts()

    @property
    def pending(self) -> int:
        """Bytes that may become a frame."""
        return len(self._pending)

    def take(self, data: bytes) -> list[P]:
        """What the frames that end in `data` decode to, in order."""
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
        """How many bytes to go on from a header: 0 = the frame's end is still to come."""
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
