"""Messages between a host and a BEE-click board, and their bytes on the serial line.

Every message is a type byte and a body whose size follows from its contents; numbers are little-endian,
without delimiter, checksum or escape. The host sends commands (type 0 to 4, TOD), the board answers (type 0
to 9, TOH) and echoes settings. Source: d3scomp/beeclickarm, TODQueue.h and TOHQueue.h.
"""

import struct
from dataclasses import astuple, dataclass
from typing import Any, Final

from actors.messages import FRAME_DATA_LIMIT
from actors.settings import check_range
from firmware_bridge.serial_port import BOARD

BAUD: Final = BOARD.baud
"""8 data bits, no parity, 1 stop bit, no flow control."""
BITS_PER_BYTE: Final = 10
"""Start bit, 8 data bits, stop bit."""
SYNC_PATTERN: Final = b"\x00Hello there!"
"""SYNC message in both directions, type byte included."""
PACKET_NUMBERS: Final = 1 << 32
"""Exclusive upper bound of packet numbers."""
MAX_COMMAND_BYTES: Final = 6 + 255
"""Maximum size of a command as parsed by a board: SEND_PACKET with the greatest length byte."""


class NoiseError(Exception):
    """Bytes that are invalid at this point; the text is the name of the counter."""


def byte_time(count: int) -> int:
    """Return the duration of consecutive bytes on the line, µs, rounded up."""
    return -(-count * BITS_PER_BYTE * 1_000_000 // BAUD)


def bytes_in(duration: int) -> int:
    """Return the number of consecutive bytes transmitted in `duration` µs."""
    return max(duration, 0) * BAUD // (BITS_PER_BYTE * 1_000_000)


MIN_POWER: Final = -363
"""Minimum power, tenths of a dB (Microchip DS39776C, register RFCON3)."""
MAX_CHANNEL_CODE: Final = 15
"""Maximum channel code; code 0 is channel 11 of IEEE 802.15.4-2006, 6.1.2."""
SYNC, SEND_PACKET, SET_CHANNEL, SET_POWER, SET_ADDRESS = range(5)
"""Type bytes."""
_SEND: Final = struct.Struct("<BBI")
_CHANNEL: Final = struct.Struct("<BB")
_POWER: Final = struct.Struct("<Bh")
_ADDRESS: Final = struct.Struct("<BHH")


@dataclass(frozen=True)
class SyncCommand:
    """Resynchronise message boundaries; the board answers `SyncAnswer`."""


@dataclass(frozen=True)
class SendPacket:
    """Broadcast a packet; the board answers `PacketConfirmation` with the outcome."""

    number: int
    data: bytes


@dataclass(frozen=True)
class SetChannel:
    """Set the channel; echoed by the board."""

    code: int


@dataclass(frozen=True)
class SetPower:
    """Set the transmit power; the board echoes the request, not the power that it sets."""

    tenths_db: int


@dataclass(frozen=True)
class SetAddress:
    """Set PAN identifier and short address; echoed by the board."""

    pan: int
    address: int


Setting = SetChannel | SetPower | SetAddress
Command = SyncCommand | SendPacket | Setting


def encode_command(command: Command) -> bytes:
    """Encode a command. Raises ParameterError for values out of range."""
    match command:
        case SyncCommand():
            return SYNC_PATTERN
        case SendPacket(number, data):
            check_range("SendPacket.number", number, 0, PACKET_NUMBERS - 1)
            check_range("the length of SendPacket.data", len(data), 0, FRAME_DATA_LIMIT)
            return _SEND.pack(SEND_PACKET, len(data), number) + data
        case SetChannel(code):
            check_range("SetChannel.code", code, 0, MAX_CHANNEL_CODE)
            return _CHANNEL.pack(SET_CHANNEL, code)
        case SetPower(tenths_db):
            check_range("SetPower.tenths_db", tenths_db, MIN_POWER, 0)
            return _POWER.pack(SET_POWER, tenths_db)
        case SetAddress(pan, address):
            check_range("SetAddress.pan", pan, 0, 0xFFFF)
            check_range("SetAddress.address", address, 0, 0xFFFF)
            return _ADDRESS.pack(SET_ADDRESS, pan, address)


_RECEIVED: Final = struct.Struct("<BBHHBBH")
_SENTENCE_PREFIX: Final = b"$GPRMC"
"""Prefix of the only sentences that the firmware passes on (GPS.cpp)."""
_LENGTH_RANGES: Final = {1: (0, FRAME_DATA_LIMIT), 6: (len(_SENTENCE_PREFIX), 254), 7: (1, 255)}
"""Minimum and maximum length byte of variable-size types."""


@dataclass(frozen=True)
class SyncAnswer:
    """Answer to SyncCommand."""


@dataclass(frozen=True)
class ReceivedPacket:
    """A received packet; RSSI and LQI as codes of the chip, 0 to 255."""

    pan: int
    address: int
    rssi_code: int
    lqi: int
    fcs: int
    """Frame check sequence, IEEE 802.15.4-2006, 7.2.1.9."""
    data: bytes


@dataclass(frozen=True)
class PacketConfirmation:
    """Outcome of a packet."""

    number: int
    failed: bool
    """True if the channel was never clear."""


@dataclass(frozen=True)
class GpsSentence:
    """A line from the GPS module, without line end."""

    text: bytes


@dataclass(frozen=True)
class BoardInfo:
    """INFO: state of the board as UTF-8 text, sent when its button is pressed."""

    text: bytes


@dataclass(frozen=True)
class TemperatureReading:
    """A temperature, tenths of a degree Celsius."""

    tenths: int


@dataclass(frozen=True)
class HumidityReading:
    """A relative humidity, tenths of a percent."""

    tenths: int


Answer = (
    SyncAnswer
    | ReceivedPacket
    | PacketConfirmation
    | Setting
    | GpsSentence
    | BoardInfo
    | TemperatureReading
    | HumidityReading
)


_FIXED_SIZE: Final[dict[int, tuple[type[Any], struct.Struct]]] = {
    2: (PacketConfirmation, struct.Struct("<BI?")),
    3: (SetChannel, _CHANNEL),
    4: (SetPower, _POWER),
    5: (SetAddress, _ADDRESS),
    8: (TemperatureReading, _POWER),
    9: (HumidityReading, _POWER),
}
"""Fixed-size answers by type byte."""
_VALID_RANGES: Final = {
    3: ("bad_channel", range(MAX_CHANNEL_CODE + 1)),
    4: ("bad_power", range(MIN_POWER, 1)),
    8: ("bad_temperature", range(-397, 6157)),
}
"""Counter name and valid range by type byte. Temperatures: the firmware's values for 0 to 0xFFFF
(SHT1x.cpp)."""
CONFIRMATION_TYPE: Final = b"\x02"
CONFIRMATION_SIZE: Final = _FIXED_SIZE[2][1].size
_TYPE_BYTES: Final = {message_class: kind for kind, (message_class, _) in _FIXED_SIZE.items()}


def encode_answer(answer: Answer) -> bytes:
    """Encode an answer of the board. Raises ParameterError for too long text or data."""
    match answer:
        case SyncAnswer():
            return SYNC_PATTERN
        case ReceivedPacket(pan, address, rssi, lqi, fcs, data):
            check_range("the length of ReceivedPacket.data", len(data), 0, FRAME_DATA_LIMIT)
            return _RECEIVED.pack(1, len(data), pan, address, rssi, lqi, fcs) + data
        case GpsSentence(text) | BoardInfo(text):
            check_range(f"the length of {type(answer).__name__}.text", len(text), 0, 0xFF)
            return bytes((6 if isinstance(answer, GpsSentence) else 7, len(text))) + text
        case _:
            kind = _TYPE_BYTES[type(answer)]
            return _FIXED_SIZE[kind][1].pack(kind, *astuple(answer))


def read_answer(data: bytes | bytearray, at: int, end: int) -> tuple[Answer, int] | None:
    """Return the answer at index `at` and its end; None if incomplete at `end`.

    Raises NoiseError at the first invalid byte before `end`.
    """
    size = _answer_size(data, at, end)
    if size is None or at + size > end:
        return None
    body = bytes(data[at : at + size])
    return _decode_answer(body), at + size


def _answer_size(data: bytes | bytearray, at: int, end: int) -> int | None:
    """Return the size of the answer at index `at`; None: unknown so far."""
    if at >= end:
        return None
    kind = data[at]
    if kind > 9:
        raise NoiseError("unknown_type")
    if kind == 0:
        _expect("bad_pattern", SYNC_PATTERN, data[at:end])
        return len(SYNC_PATTERN)
    if kind in _FIXED_SIZE:
        return _FIXED_SIZE[kind][1].size
    if at + 1 >= end:
        return None
    length = data[at + 1]
    if not _LENGTH_RANGES[kind][0] <= length <= _LENGTH_RANGES[kind][1]:
        raise NoiseError("bad_length")
    if kind == 1:
        return _RECEIVED.size + length
    if kind == 6:
        _expect("bad_text", _SENTENCE_PREFIX, data[at + 2 : end])
    return 2 + length


def _expect(cause: str, pattern: bytes, data: bytes | bytearray) -> None:
    """Raise NoiseError unless `data` and the pattern agree in their common length."""
    if not pattern.startswith(data[: len(pattern)]):
        raise NoiseError(cause)


def _decode_answer(body: bytes) -> Answer:
    match body[0]:
        case 0:
            return SyncAnswer()
        case 1:
            _, _, pan, address, rssi, lqi, fcs = _RECEIVED.unpack_from(body)
            return ReceivedPacket(pan, address, rssi, lqi, fcs, body[_RECEIVED.size :])
        case 2 if body[-1] > 1:
            raise NoiseError("bad_status")
        case 6:
            return GpsSentence(body[2:])
        case 7:
            return BoardInfo(_checked_text(body[2:]))
        case kind:
            message_class, layout = _FIXED_SIZE[kind]
            _, *fields = layout.unpack(body)
            cause, valid = _VALID_RANGES.get(kind, ("", fields))
            if fields[0] not in valid:
                raise NoiseError(cause)
            answer: Answer = message_class(*fields)
            return answer


def _checked_text(text: bytes) -> bytes:
    decoded = text.decode(errors="surrogateescape")  # surrogates are not printable
    if not all(character.isprintable() or character in "\n\r\t" for character in decoded):
        raise NoiseError("bad_text")
    return text
