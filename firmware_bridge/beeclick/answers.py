"""What the board says to the host: type (TOH) 0 to 9 (d3scomp/beeclickarm, TOHQueue.h).

A setting is answered by itself, as far as the board has understood it.
"""

import struct
from dataclasses import astuple, dataclass
from typing import Any, Final

from actors.bounds import check_range
from actors.messages import FRAME_DATA_LIMIT
from firmware_bridge.beeclick.commands import (
    GREATEST_CODE,
    LEAST_POWER,
    SetAddress,
    SetChannel,
    SetPower,
    Setting,
)
from firmware_bridge.beeclick.wire import SYNC_PATTERN, NoiseError

_RECEIVED: Final = struct.Struct("<BBHHBBH")
_SENT: Final = struct.Struct("<BIB")
_NUMBER: Final = struct.Struct("<Bh")
_ADDRESS: Final = struct.Struct("<BHH")
_CHANNEL: Final = struct.Struct("<BB")
_SENTENCE: Final = b"$GPRMC"
"""The only sentences that the firmware passes on (GPS.cpp)."""
_TEMPERATURES: Final = (-397, 6156)
"""Tenths of a degree: what the firmware computes from 0 and from 0xFFFF (SHT1x.cpp)."""
_SIZES: Final = {0: 13, 2: 6, 3: 2, 4: 3, 5: 5, 8: 3, 9: 3}
"""Of the types that have always the same."""
_LENGTHS: Final = {1: (0, FRAME_DATA_LIMIT), 6: (len(_SENTENCE), 254), 7: (1, 255)}
"""Least and greatest length byte of the others."""
SENT_TYPE: Final = b"\x02"
SENT_SIZE: Final = _SENT.size


@dataclass(frozen=True)
class Synchronised:
    """The answer to Synchronise."""


@dataclass(frozen=True)
class ReceivedPacket:
    """A packet that the radio heard; codes as the chip gives them, 0..255."""

    pan: int
    address: int
    rssi_code: int
    lqi: int
    fcs: int
    """Frame check sequence of the frame, by IEEE 802.15.4-2006, 7.2.1.9."""
    data: bytes


@dataclass(frozen=True)
class PacketSent:
    """The radio has done with a packet."""

    number: int
    failed: bool
    """The channel was never clear."""


@dataclass(frozen=True)
class Sentence:
    """A line from the GPS module, without its end."""

    text: bytes


@dataclass(frozen=True)
class Notes:
    """INFO: what the board tells of itself when its button is pressed, UTF-8."""

    text: bytes


@dataclass(frozen=True)
class Warmth:
    """TEMPERATURE: tenths of a degree Celsius."""

    tenths: int


@dataclass(frozen=True)
class Moisture:
    """HUMIDITY: tenths of a percent."""

    tenths: int


Answer = Synchronised | ReceivedPacket | PacketSent | Setting | Sentence | Notes | Warmth | Moisture
_FIXED: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    PacketSent: (2, _SENT),
    SetChannel: (3, _CHANNEL),
    SetPower: (4, _NUMBER),
    SetAddress: (5, _ADDRESS),
    Warmth: (8, _NUMBER),
    Moisture: (9, _NUMBER),
}


def encode(answer: Answer) -> bytes:
    """The bytes that the board sends. Raises ParameterError for a text or data that is too long."""
    match answer:
        case Synchronised():
            return SYNC_PATTERN
        case ReceivedPacket(pan, address, rssi, lqi, fcs, data):
            check_range("the length of ReceivedPacket.data", len(data), 0, FRAME_DATA_LIMIT)
            return _RECEIVED.pack(1, len(data), pan, address, rssi, lqi, fcs) + data
        case Sentence(text) | Notes(text):
            check_range(f"the length of {type(answer).__name__}.text", len(text), 0, 0xFF)
            return bytes((6 if isinstance(answer, Sentence) else 7, len(text))) + text
        case _:
            kind, body = _FIXED[type(answer)]
            return body.pack(kind, *astuple(answer))


def read(data: bytes | bytearray, at: int, end: int) -> tuple[Answer, int] | None:
    """The answer that begins `at` and where it ends; None if it does not end by `end`.

    Raises NoiseError as soon as a byte before `end` shows that no board says that.
    """
    size = _size(data, at, end)
    if size is None or at + size > end:
        return None
    body = bytes(data[at : at + size])
    return _decode(body), at + size


def _size(data: bytes | bytearray, at: int, end: int) -> int | None:
    """Bytes of the answer that begins `at`; None: not enough to tell."""
    if at >= end:
        return None
    kind = data[at]
    if kind > 9:
        raise NoiseError("unknown_type")
    if kind in _SIZES:
        if kind == 0:
            _expect("bad_pattern", SYNC_PATTERN, data[at:end])
        return _SIZES[kind]
    if at + 1 >= end:
        return None
    length = data[at + 1]
    if not _LENGTHS[kind][0] <= length <= _LENGTHS[kind][1]:
        raise NoiseError("bad_length")
    if kind == 1:
        return _RECEIVED.size + length
    if kind == 6:
        _expect("bad_text", _SENTENCE, data[at + 2 : end])
    return 2 + length


def _expect(cause: str, pattern: bytes, data: bytes | bytearray) -> None:
    """Raise NoiseError unless `data` begins with the pattern, as far as both go."""
    if not pattern.startswith(data[: len(pattern)]):
        raise NoiseError(cause)


def _decode(body: bytes) -> Answer:
    if body[0] not in _SIZES:
        if body[0] == 1:
            _, _, pan, address, rssi, lqi, fcs = _RECEIVED.unpack_from(body)
            return ReceivedPacket(pan, address, rssi, lqi, fcs, body[_RECEIVED.size :])
        return Sentence(body[2:]) if body[0] == 6 else Notes(_readable(body[2:]))
    match body[0]:
        case 0:
            return Synchronised()
        case 2:
            return PacketSent(_SENT.unpack(body)[1], bool(_within("bad_status", body[5], 0, 1)))
        case 5:
            return SetAddress(*_ADDRESS.unpack(body)[1:])
        case kind:
            return _number(kind, body)


def _number(kind: int, body: bytes) -> SetChannel | SetPower | Warmth | Moisture:
    """The answers that are one number."""
    if kind == 3:
        return SetChannel(_within("bad_channel", body[1], 0, GREATEST_CODE))
    value = _NUMBER.unpack(body)[1]
    if kind == 4:
        return SetPower(_within("bad_power", value, LEAST_POWER, 0))
    return Warmth(_within("bad_temperature", value, *_TEMPERATURES)) if kind == 8 else Moisture(value)


def _within(cause: str, value: int, least: int, most: int) -> int:
    if not least <= value <= most:
        raise NoiseError(cause)
    return value


def _readable(text: bytes) -> bytes:
    try:
        decoded = text.decode()
    except UnicodeDecodeError:
        raise NoiseError("bad_text") from None
    if not all(character.isprintable() or character in "\n\r\t" for character in decoded):
        raise NoiseError("bad_text")
    return text
