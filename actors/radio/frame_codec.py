"""The MAC frame of IEEE 802.15.4-2003 that a BEE click sends, byte by byte: data from a short address.

It names no destination, which means the PAN's coordinator and to a BEE click everyone. All fields are
little-endian; the FCS is the last two octets (2006: 7.2.1, 7.2.2). Source: d3scomp/beeclickarm, MRF24J40.cpp.
"""

import binascii
import struct
from dataclasses import dataclass
from typing import Final

from actors.ieee802154 import MAC_OCTETS, PSDU_LIMIT
from actors.runtime.errors import AcrcError

_HEADER: Final = struct.Struct("<HBHH")
_CONTROL: Final = 0x8001
"""Frame control: a data frame, no destination, a short source address, nothing asked for."""
_FCS: Final = struct.Struct("<H")
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in reverse."""


class FrameError(AcrcError):
    """Octets that are no frame of a BEE click, or a frame that cannot be written."""


@dataclass(frozen=True)
class DataFrame:
    """Data for everyone."""

    pan: int
    """Of the source, 0 to 0xFFFF."""
    source: int
    """Short address, 0 to 0xFFFF."""
    data: bytes
    """Up to 118 bytes."""
    sequence: int = 0
    """0 to 255; the firmware always sends 0."""

    @property
    def check(self) -> int:
        """The frame check sequence. Raises FrameError for what no frame can hold."""
        return frame_check(_body(self))


def encode(frame: DataFrame) -> bytes:
    """The PSDU, header to FCS, at most 127 octets. Raises FrameError for what no frame can hold."""
    body = _body(frame)
    return body + _FCS.pack(frame_check(body))


def decode(psdu: bytes) -> DataFrame:
    """The frame in a PSDU. Raises FrameError, and nothing else, for whatever else the octets are."""
    if not MAC_OCTETS <= len(psdu) <= PSDU_LIMIT:
        raise FrameError(f"The frame has {len(psdu)} octets; it must have {MAC_OCTETS} to {PSDU_LIMIT}.")
    body, (given,) = psdu[: -_FCS.size], _FCS.unpack(psdu[-_FCS.size :])
    right = frame_check(body)
    if given != right:
        raise FrameError(f"The frame's check sequence is {given:#06x}; that of its octets is {right:#06x}.")
    control, sequence, pan, source = _HEADER.unpack_from(body)
    if control != _CONTROL:
        raise FrameError(
            f"The frame's control field is {control:#06x}; that of a BEE click's frame is {_CONTROL:#06x}."
        )
    return DataFrame(pan, source, bytes(body[_HEADER.size :]), sequence)


def frame_check(body: bytes) -> int:
    """The frame check sequence over header and data, as the two bytes behind them say, low one first.

    CRC-16 of ITU-T, least significant bit first, begun with 0 (IEEE 802.15.4-2006, 7.2.1.9).
    """
    crc = binascii.crc_hqx(body.translate(_MIRRORED), 0)
    return _MIRRORED[crc & 0xFF] << 8 | _MIRRORED[crc >> 8]


def _body(frame: DataFrame) -> bytes:
    """Header and data."""
    for name, value, most in (
        ("sequence number", frame.sequence, 0xFF),
        ("PAN", frame.pan, 0xFFFF),
        ("short address", frame.source, 0xFFFF),
    ):
        if not 0 <= value <= most:
            raise FrameError(f"The frame's {name} is {value}; it must be 0 to {most}.")
    octets = MAC_OCTETS + len(frame.data)
    if octets > PSDU_LIMIT:
        raise FrameError(f"The frame has {octets} octets; at most {PSDU_LIMIT} fit.")
    return _HEADER.pack(_CONTROL, frame.sequence, frame.pan, frame.source) + frame.data
