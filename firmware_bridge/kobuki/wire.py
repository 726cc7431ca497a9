"""The bytes of packets: a payload is a row of them, each `id, length, data`, little-endian.

Commands and feedback have ids of their own that overlap, so the direction must be known.
Source: as for `packets`.
"""

import struct
from collections.abc import Callable
from dataclasses import astuple
from typing import Any, Final

from firmware_bridge.kobuki.packets import (
    UDID,
    BaseControl,
    Basic,
    Command,
    Feedback,
    Firmware,
    FirmwareVersion,
    GeneralOutput,
    Hardware,
    Inertial,
    RequestExtra,
    SoundSequence,
    Unknown,
)


class WireMisuseError(ValueError):
    """A packet of our own making that has no bytes: our mistake, never noise."""


class MalformedError(Exception):
    """A payload with a right checksum that no Kobuki would send: noise."""


_COMMANDS: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    BaseControl: (1, struct.Struct("<hh")),
    SoundSequence: (4, struct.Struct("<B")),
    RequestExtra: (9, struct.Struct("<H")),
    GeneralOutput: (12, struct.Struct("<H")),
}
_FEEDBACK: Final[dict[type[Any], tuple[int, struct.Struct]]] = {
    Basic: (1, struct.Struct("<HBBBHHbbBBBB")),
    Inertial: (4, struct.Struct("<hh3x")),
}
_UNREAD: Final = {3: 3, 5: 6, 6: 2, 16: 16, 21: 13}
"""Bytes of data of packets that nobody here reads: docking, cliff, currents, inputs, gains."""
_HARDWARE: Final = 10
_FIRMWARE: Final = 11
_UDID: Final = 19
_OLD_FIRMWARE: Final = {
    123: FirmwareVersion(1, 0, 0),
    110: FirmwareVersion(1, 1, 0),
    10100: FirmwareVersion(1, 1, 0),
    111: FirmwareVersion(1, 1, 1),
    10101: FirmwareVersion(1, 1, 1),
}
"""The first three firmwares, which said their version in two bytes."""
_WORDS: Final = struct.Struct("<III")
_COMMAND_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _COMMANDS.items()}
_FEEDBACK_KINDS: Final = {kind: (of, layout) for of, (kind, layout) in _FEEDBACK.items()}


def encode_command(command: Command) -> bytes:
    """The packet's bytes. Raises WireMisuseError for a number that its field cannot hold."""
    kind, layout = _COMMANDS[type(command)]
    return _packet(command, kind, lambda: layout.pack(*astuple(command)))


def encode_feedback(feedback: Feedback) -> bytes:
    """The packet's bytes, as a base sends them. Raises WireMisuseError as `encode_command` does."""
    if isinstance(feedback, Hardware | Firmware):
        version = feedback.version
        kind = _HARDWARE if isinstance(feedback, Hardware) else _FIRMWARE
        return _packet(feedback, kind, lambda: bytes((version.patch, version.minor, version.major, 0)))
    if isinstance(feedback, UDID):
        return _packet(feedback, _UDID, lambda: _WORDS.pack(*feedback.words))
    if isinstance(feedback, Unknown):
        return _packet(feedback, feedback.kind, lambda: feedback.data)
    kind, layout_of = _FEEDBACK[type(feedback)]
    return _packet(feedback, kind, lambda: layout_of.pack(*astuple(feedback)))


def _packet(packet: object, kind: int, data_of: Callable[[], bytes]) -> bytes:
    try:
        data = data_of()
        return bytes((kind, len(data))) + data
    except (struct.error, ValueError) as error:
        raise WireMisuseError(f"{packet} has no bytes: {error}") from None


def decode_commands(payload: bytes) -> list[Command]:
    """The commands of a payload, in order. Raises MalformedError; a base knows every command."""
    commands: list[Command] = []
    for kind, data in _packets(payload):
        if kind not in _COMMAND_KINDS:
            raise MalformedError(f"there is no command {kind}")
        of, layout = _COMMAND_KINDS[kind]
        commands.append(of(*_fields(kind, layout, data)))
    return commands


def decode_feedback(payload: bytes) -> list[Feedback]:
    """The packets of a payload, in order, those of unknown kinds as Unknown. Raises MalformedError."""
    return [_feedback(kind, data) for kind, data in _packets(payload)]


def _packets(payload: bytes) -> list[tuple[int, bytes]]:
    """Kind and data of each packet; together they fill the payload exactly."""
    packets = []
    at = 0
    while at < len(payload):
        if at + 2 > len(payload) or at + 2 + payload[at + 1] > len(payload):
            raise MalformedError("a packet is longer than the payload")
        end = at + 2 + payload[at + 1]
        packets.append((payload[at], payload[at + 2 : end]))
        at = end
    return packets


def _feedback(kind: int, data: bytes) -> Feedback:
    if kind in _FEEDBACK_KINDS:
        of, layout = _FEEDBACK_KINDS[kind]
        feedback: Feedback = of(*_fields(kind, layout, data))
        return feedback
    if kind in _SPECIAL:
        return _SPECIAL[kind](data)
    if len(data) != _UNREAD.get(kind, len(data)):
        raise MalformedError(f"packet {kind} has {len(data)} bytes of data, not {_UNREAD[kind]}")
    return Unknown(kind, data)


def _fields(kind: int, layout: struct.Struct, data: bytes) -> tuple[int, ...]:
    if len(data) != layout.size:
        raise MalformedError(f"packet {kind} has {len(data)} bytes of data, not {layout.size}")
    return layout.unpack(data)


def _udid(data: bytes) -> UDID:
    a, b, c = _fields(_UDID, _WORDS, data)
    return UDID((a, b, c))


def _version(kind: int, data: bytes) -> FirmwareVersion:
    """Of four bytes, or of two as old firmware sends them: 104 is hardware 1.0.4."""
    if len(data) == 4:
        return FirmwareVersion(data[2], data[1], data[0])
    if len(data) != 2:
        raise MalformedError(f"packet {kind} has {len(data)} bytes of data, not 2 or 4")
    number = int.from_bytes(data, "little")
    if kind == _FIRMWARE and number in _OLD_FIRMWARE:
        return _OLD_FIRMWARE[number]
    return FirmwareVersion(number // 100, number // 10 % 10, number % 10)


_SPECIAL: Final[dict[int, Callable[[bytes], Feedback]]] = {
    _HARDWARE: lambda data: Hardware(_version(_HARDWARE, data)),
    _FIRMWARE: lambda data: Firmware(_version(_FIRMWARE, data)),
    _UDID: _udid,
}
"""Packets that are more than a row of numbers."""
