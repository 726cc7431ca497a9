"""MAC frames of IEEE 802.15.4-2003 and 2006, byte by byte: data and acknowledgements.

All fields are little-endian; the FCS is the last two octets (2006: 7.2.1, 7.2.2). Beacons, commands, secured
frames and frames of later editions are refused, each in a sentence that says what it is.
"""

import struct
from dataclasses import dataclass
from typing import Final

from actors.ieee802154 import PSDU_LIMIT
from actors.radio.frame_check import FCS_OCTETS, frame_check
from actors.runtime.errors import AcrcError

BROADCAST: Final = 0xFFFF
"""As short address: everyone; as PAN: any (7.2.1.3, 7.2.1.4)."""
_LEAST_OCTETS: Final = 5
"""An acknowledgement."""
_DATA, _ACKNOWLEDGEMENT = 1, 2
_TYPES: Final = ("beacon", "data frame", "acknowledgement", "command")
_SECURED, _PENDING, _ACK_REQUEST, _COMPRESSED = 1 << 3, 1 << 4, 1 << 5, 1 << 6
_RESERVED: Final = 0b111 << 7
_DESTINATION_MODE, _VERSION, _SOURCE_MODE = 10, 12, 14
_NONE, _SHORT, _EXTENDED = 0, 2, 3
_SIZES: Final = {_SHORT: 2, _EXTENDED: 8}


class FrameError(AcrcError):
    """Octets that are no frame of those that can be read, or a frame that cannot be written."""


@dataclass(frozen=True)
class Endpoint:
    """A device in a PAN."""

    pan: int
    """0 to 0xFFFF."""
    address: int
    """Short, 0 to 0xFFFF, or extended, 0 to 2^64 - 1."""
    extended: bool = False
    """The address is the one of 64 bits."""


@dataclass(frozen=True)
class DataFrame:
    """A data frame; without a destination it is for the PAN's coordinator, from a BEE click for everyone."""

    sequence: int
    """0 to 255."""
    destination: Endpoint | None
    source: Endpoint | None
    payload: bytes
    ack_request: bool = False
    compressed: bool = False
    """The source's PAN is left out, as it is the destination's (2003: "intra-PAN")."""
    pending: bool = False
    """The sender has more for the receiver."""
    version: int = 0
    """0: as in the edition of 2003, 1: of 2006."""


@dataclass(frozen=True)
class Acknowledgement:
    """The answer to a frame that asks for one."""

    sequence: int
    """That of the frame, 0 to 255."""
    pending: bool = False
    version: int = 0


Frame = DataFrame | Acknowledgement


def broadcast(pan: int, source: int, sequence: int, payload: bytes) -> DataFrame:
    """A data frame for everyone of the PAN, from a short address."""
    everyone = Endpoint(pan, BROADCAST)
    return DataFrame(sequence, everyone, Endpoint(pan, source), payload, compressed=True)


def unicast(pan: int, source: int, destination: int, sequence: int, payload: bytes) -> DataFrame:
    """A data frame between short addresses of one PAN that asks for an acknowledgement."""
    ends = Endpoint(pan, destination), Endpoint(pan, source)
    return DataFrame(sequence, *ends, payload, ack_request=True, compressed=True)


def beeclick(pan: int, source: int, payload: bytes) -> DataFrame:
    """A frame as the BEE click's firmware sends it: source only, sequence always 0; up to 118 data bytes.

    d3scomp/beeclickarm, MRF24J40.cpp.
    """
    return DataFrame(0, None, Endpoint(pan, source), payload)


def encode(frame: Frame) -> bytes:
    """The PSDU, header to FCS, at most 127 octets. Raises FrameError for what no frame can hold."""
    _check(frame)
    if isinstance(frame, Acknowledgement):
        control = _ACKNOWLEDGEMENT | frame.pending * _PENDING | frame.version << _VERSION
        body = struct.pack("<HB", control, frame.sequence)
    else:
        body = _data_header(frame) + frame.payload
    whole = body + frame_check(body).to_bytes(FCS_OCTETS, "little")
    if len(whole) > PSDU_LIMIT:
        raise FrameError(f"The frame has {len(whole)} octets; at most {PSDU_LIMIT} fit.")
    return whole


def decode(psdu: bytes) -> Frame:
    """The frame in a PSDU. Raises FrameError, and nothing else, for whatever else the octets are."""
    if not _LEAST_OCTETS <= len(psdu) <= PSDU_LIMIT:
        raise FrameError(f"The frame has {len(psdu)} octets; it must have {_LEAST_OCTETS} to {PSDU_LIMIT}.")
    body, given = psdu[:-FCS_OCTETS], int.from_bytes(psdu[-FCS_OCTETS:], "little")
    right = frame_check(body)
    if given != right:
        raise FrameError(f"The frame's check sequence is {given:#06x}; that of its octets is {right:#06x}.")
    control, sequence = struct.unpack_from("<HB", body)
    _check_control(control)
    if control & 0b111 == _ACKNOWLEDGEMENT:
        return _acknowledgement(control, sequence, body)
    return _data(control, sequence, body)


def _check(frame: Frame) -> None:
    _within("sequence number", frame.sequence, 0xFF)
    _within("version", frame.version, 1)
    if isinstance(frame, Acknowledgement):
        return
    ends = frame.destination, frame.source
    for end in ends:
        if end is not None:
            _within("PAN", end.pan, 0xFFFF)
            _within("extended address" if end.extended else "short address", end.address, _most(end))
    if frame.destination is None and frame.source is None:
        raise FrameError("The data frame has neither destination nor source; it must have one of them.")
    if frame.compressed and not _same_pan(*ends):
        raise FrameError("The frame leaves its source's PAN out; both ends must be given, and of one PAN.")


def _most(end: Endpoint) -> int:
    return 2**64 - 1 if end.extended else 0xFFFF


def _same_pan(destination: Endpoint | None, source: Endpoint | None) -> bool:
    return destination is not None and source is not None and destination.pan == source.pan


def _within(name: str, value: int, most: int) -> None:
    if not 0 <= value <= most:
        raise FrameError(f"The frame's {name} is {value}; it must be 0 to {most}.")


def _mode(end: Endpoint | None) -> int:
    return _NONE if end is None else _EXTENDED if end.extended else _SHORT


def _data_header(frame: DataFrame) -> bytes:
    modes = _mode(frame.destination) << _DESTINATION_MODE | _mode(frame.source) << _SOURCE_MODE
    flags = frame.pending * _PENDING | frame.ack_request * _ACK_REQUEST | frame.compressed * _COMPRESSED
    header = struct.pack("<HB", _DATA | flags | modes | frame.version << _VERSION, frame.sequence)
    for end, with_pan in ((frame.destination, True), (frame.source, not frame.compressed)):
        if end is not None:
            header += end.pan.to_bytes(2, "little") * with_pan
            header += end.address.to_bytes(_SIZES[_mode(end)], "little")
    return header


def _check_control(control: int) -> None:
    """Refuse what is not read here."""
    kind = control & 0b111
    if kind >= len(_TYPES):
        raise FrameError(
            f"The frame is of the reserved type {kind}; data frames and acknowledgements are read."
        )
    if kind not in (_DATA, _ACKNOWLEDGEMENT):
        raise FrameError(f"The frame is a {_TYPES[kind]}; data frames and acknowledgements are read.")
    version = control >> _VERSION & 0b11
    if version > 1:
        raise FrameError(f"The frame is of version {version}; those of 2003 and 2006, 0 and 1, are read.")
    if control & _SECURED:
        raise FrameError("The frame is secured; only those in the clear are read.")
    if control & _RESERVED:
        raise FrameError("The frame sets reserved bits of its control field; they must be 0.")


def _acknowledgement(control: int, sequence: int, body: bytes) -> Acknowledgement:
    if len(body) + FCS_OCTETS != _LEAST_OCTETS:
        raise FrameError(f"The acknowledgement has {len(body) + FCS_OCTETS} octets; it must have 5.")
    version = control >> _VERSION & 0b11
    if control & ~(_PENDING | 0b111 | 0b11 << _VERSION):
        raise FrameError("The acknowledgement's control field promises addresses or asks for an answer.")
    return Acknowledgement(sequence, bool(control & _PENDING), version)


def _data(control: int, sequence: int, body: bytes) -> DataFrame:
    compressed = bool(control & _COMPRESSED)
    modes = control >> _DESTINATION_MODE & 0b11, control >> _SOURCE_MODE & 0b11
    if 1 in modes:
        raise FrameError("The frame has an address of the reserved mode 1; modes are 0, 2 and 3.")
    if modes == (_NONE, _NONE):
        raise FrameError("The data frame has neither destination nor source; it must have one of them.")
    if compressed and _NONE in modes:
        raise FrameError("The frame leaves its source's PAN out; both ends must be given, and of one PAN.")
    at = 3
    destination, at = _endpoint(body, at, modes[0], None)
    pan = destination.pan if compressed and destination is not None else None
    source, at = _endpoint(body, at, modes[1], pan)
    return DataFrame(
        sequence,
        destination,
        source,
        bytes(body[at:]),
        bool(control & _ACK_REQUEST),
        compressed,
        bool(control & _PENDING),
        control >> _VERSION & 0b11,
    )


def _endpoint(body: bytes, at: int, mode: int, pan: int | None) -> tuple[Endpoint | None, int]:
    """The endpoint that begins there, and where it ends; `pan` if it is not given there."""
    if mode == _NONE:
        return None, at
    pan_end = at if pan is not None else at + 2
    end = pan_end + _SIZES[mode]
    if end > len(body):
        raise FrameError(f"The frame ends within its addresses, which need {end + FCS_OCTETS} octets.")
    if pan is None:
        pan = int.from_bytes(body[at:pan_end], "little")
    return Endpoint(pan, int.from_bytes(body[pan_end:end], "little"), mode == _EXTENDED), end
