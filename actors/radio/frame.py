"""Robots' frames: size, air time, check sequence, and signal strength codes of the MRF24J40.

A BEE click sends the MAC data frame of IEEE 802.15.4-2003 from a short address. It has no destination, which
means the PAN's coordinator, and to BEE clicks everyone. All fields are little-endian; the FCS is the last two
octets (2006: 7.2.1, 7.2.2). Source: d3scomp/beeclickarm, MRF24J40.cpp.
"""

import binascii
import struct
from bisect import bisect_right
from typing import Final

import msgspec
import numpy as np

from actors import ieee802154
from actors.array_types import Floats, Indices
from actors.ieee802154 import MAC_OCTETS
from actors.messages import FRAME_DATA_LIMIT


def octets(data_bytes: int) -> int:
    """Return the octets of a frame with this many data bytes: MAC header, data and FCS."""
    return data_bytes + MAC_OCTETS


def airtime_us(data_bytes: int) -> int:
    """Return the air time of a frame with this many data bytes, µs."""
    return ieee802154.airtime_ns(octets(data_bytes)) // 1000


def size_fault(data_bytes: int) -> str:
    """Return why a frame cannot carry this many data bytes, as a sentence; empty if it can."""
    if 0 <= data_bytes <= FRAME_DATA_LIMIT:
        return ""
    return f"The frame has {data_bytes} data bytes; it must have 0 to {FRAME_DATA_LIMIT}."


_HEADER: Final = struct.Struct("<HBHH")
_CONTROL: Final = 0x8001
"""Frame control: data frame, no destination, short source address, no flags."""
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Bytes with reversed bits."""


class DataFrame(msgspec.Struct, frozen=True):
    """Broadcast data; the sequence number is 0, as in the firmware."""

    pan: int
    """PAN identifier of the source, 0 to 0xFFFF."""
    source: int
    """Short address, 0 to 0xFFFF."""
    data: bytes
    """Up to 118 bytes."""

    @property
    def check(self) -> int:
        """Frame check sequence. Raises struct.error for a number out of range."""
        return frame_check(_HEADER.pack(_CONTROL, 0, self.pan, self.source) + self.data)


def frame_check(body: bytes) -> int:
    """Return the frame check sequence over header and data, as stored in the last two bytes, low first.

    CRC-16 of ITU-T, least significant bit first, initial value 0 (IEEE 802.15.4-2006, 7.2.1.9).
    """
    crc = binascii.crc_hqx(body.translate(_MIRRORED), 0)
    return _MIRRORED[crc & 0xFF] << 8 | _MIRRORED[crc >> 8]


_STRONGEST_DBM: Final = -35
_WEAKEST_DBM: Final = -90
_RSSI_CODES: Final = (
    *(0, 1, 2, 5, 9, 13, 18, 23, 27, 32, 37, 43, 48, 53, 58, 63, 68, 73, 78, 83, 89, 95, 100, 107),
    *(111, 117, 121, 125, 129, 133, 138, 143, 148, 153, 159, 165, 170, 176, 183, 188, 193, 198, 203),
    *(207, 212, 216, 221, 225, 228, 233, 239, 245, 250, 253, 254, 255),
)
"""Codes at -90, -89, … -35 dBm. Source: Linux, drivers/net/ieee802154/mrf24j40.c, energy levels of the clear
channel assessment, which the chip measures on the same scale, after Microchip DS39776C, table 3-8. Typical
values averaged over 8 symbols; the data sheet specifies ± 5 dB."""
_CODES: Final = np.array(_RSSI_CODES, dtype=np.float64)
_QUALITY_SPAN_DB: Final = 20.0


def rssi_dbm(code: int) -> float:
    """Return the signal strength of a code of the chip, dBm; 0 means -90 or less, 255 means -35 or more."""
    return _STRENGTHS[code]


def _strength(code: int) -> float:
    above = bisect_right(_RSSI_CODES, code)
    if above == len(_RSSI_CODES):
        return float(_STRONGEST_DBM)
    lower, upper = _RSSI_CODES[above - 1], _RSSI_CODES[above]
    return _WEAKEST_DBM + above - 1 + (code - lower) / (upper - lower)


_STRENGTHS: Final = tuple(_strength(code) for code in range(256))
_STRENGTH_TABLE: Final = np.array(_STRENGTHS)


def rssi_codes(dbm: Floats) -> Indices:
    """Return the chip's codes for signal strengths, (n,) dBm."""
    steps = np.clip(dbm, _WEAKEST_DBM, _STRONGEST_DBM) - _WEAKEST_DBM
    lower = steps.astype(np.intp)
    upper = np.minimum(lower + 1, len(_RSSI_CODES) - 1)
    codes = _CODES[lower] + (steps - lower) * (_CODES[upper] - _CODES[lower])
    rounded: Indices = np.rint(codes).astype(np.intp)
    return rounded


def strengths_dbm(codes: Indices) -> Floats:
    """Return the signal strengths of codes, as `rssi_dbm`, (n,)."""
    return _STRENGTH_TABLE[codes]


def link_qualities(dbm: Floats, weakest_dbm: float) -> Indices:
    """Return the LQI, 0 to 255, of signal strengths, (n,); `weakest_dbm`: about the receivers' limit.

    Own choice: linear, 255 from 20 dB above the limit. IEEE 802.15.4-2006, 6.9.8, requires only an even
    spread with 255 as the best; the chip's own formula is not documented.
    """
    share = np.clip((dbm - weakest_dbm) / _QUALITY_SPAN_DB, 0.0, 1.0)
    return np.rint(share * 255.0).astype(np.intp)
