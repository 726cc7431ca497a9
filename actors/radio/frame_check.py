"""The frame check sequence of IEEE 802.15.4."""

import binascii
from typing import Final

FCS_OCTETS: Final = 2
"""Behind every frame, low octet first."""
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in reverse."""


def frame_check(frame: bytes) -> int:
    """The frame check sequence over header and data, as the two bytes behind them say, low one first.

    CRC-16 of ITU-T, least significant bit first, begun with 0 (IEEE 802.15.4-2006, 7.2.1.9).
    """
    crc = binascii.crc_hqx(frame.translate(_MIRRORED), 0)
    return _MIRRORED[crc & 0xFF] << 8 | _MIRRORED[crc >> 8]
