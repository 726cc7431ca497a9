"""What the host says to the board: type (TOD) 0 to 4 (d3scomp/beeclickarm, TODQueue.h)."""

import struct
from dataclasses import dataclass
from typing import Final

from actors.bounds import check_range
from actors.messages import FRAME_DATA_LIMIT
from firmware_bridge.beeclick.wire import NUMBER_END, SYNC_PATTERN, NoiseError

LEAST_POWER: Final = -363
"""In tenths of a dB: -36.3 dB (Microchip DS39776C, register RFCON3)."""
GREATEST_CODE: Final = 15
"""Of a channel; code 0 is channel 11 of IEEE 802.15.4-2006, 6.1.2."""
SYNC, SEND_PACKET, SET_CHANNEL, SET_POWER, SET_ADDRESS = range(5)
"""Type bytes."""
_SEND: Final = struct.Struct("<BBI")
_CHANNEL: Final = struct.Struct("<BB")
_POWER: Final = struct.Struct("<Bh")
_ADDRESS: Final = struct.Struct("<BHH")


@dataclass(frozen=True)
class Synchronise:
    """Find the messages' boundaries anew; the board answers `Synchronised`."""


@dataclass(frozen=True)
class SendPacket:
    """Broadcast a packet; the board answers `PacketSent` when the radio has done with it."""

    number: int
    data: bytes


@dataclass(frozen=True)
class SetChannel:
    """Answered by itself."""

    code: int


@dataclass(frozen=True)
class SetPower:
    """Answered by what was asked for, not by what the radio does."""

    tenths_db: int


@dataclass(frozen=True)
class SetAddress:
    """Answered by itself."""

    pan: int
    address: int


Setting = SetChannel | SetPower | SetAddress
Command = Synchronise | SendPacket | Setting


def encode(command: Command) -> bytes:
    """The bytes of a command. Raises ParameterError for a value that it cannot carry."""
    match command:
        case Synchronise():
            return SYNC_PATTERN
        case SendPacket(number, data):
            check_range("SendPacket.number", number, 0, NUMBER_END - 1)
            check_range("the length of SendPacket.data", len(data), 0, FRAME_DATA_LIMIT)
            return _SEND.pack(SEND_PACKET, len(data), number) + data
        case SetChannel(code):
            check_range("SetChannel.code", code, 0, GREATEST_CODE)
            return _CHANNEL.pack(SET_CHANNEL, code)
        case SetPower(tenths_db):
            check_range("SetPower.tenths_db", tenths_db, LEAST_POWER, 0)
            return _POWER.pack(SET_POWER, tenths_db)
        case SetAddress(pan, address):
            check_range("SetAddress.pan", pan, 0, 0xFFFF)
            check_range("SetAddress.address", address, 0, 0xFFFF)
            return _ADDRESS.pack(SET_ADDRESS, pan, address)


def size(data: bytes) -> int | None:
    """Bytes of the command that `data` begins, as the board's firmware counts; None: not enough to tell.

    Raises NoiseError for a type that the firmware does not know. It accepts every length byte.
    """
    if not data:
        return None
    kind = data[0]
    if kind > SET_ADDRESS:
        raise NoiseError("unknown_type")
    if kind == SEND_PACKET:
        return _SEND.size + data[1] if len(data) > 1 else None
    return {SYNC: len(SYNC_PATTERN), SET_CHANNEL: _CHANNEL.size, SET_POWER: _POWER.size}.get(
        kind, _ADDRESS.size
    )


def decode(data: bytes) -> Command:
    """The command of all its bytes, with whatever values they say. Raises NoiseError."""
    if size(data) != len(data):
        raise NoiseError("bad_length")
    match data[0]:
        case 0:
            if data != SYNC_PATTERN:
                raise NoiseError("bad_pattern")
            return Synchronise()
        case 1:
            return SendPacket(_SEND.unpack_from(data)[2], data[_SEND.size :])
        case 2:
            return SetChannel(data[1])
        case 3:
            return SetPower(_POWER.unpack(data)[1])
        case _:
            return SetAddress(*_ADDRESS.unpack(data)[1:])
