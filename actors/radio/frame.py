"""Size and air time of an IEEE 802.15.4 frame at 2.4 GHz (O-QPSK, 250 kb/s)."""

from typing import Final

from actors.messages import FRAME_DATA_LIMIT

SYMBOL_US: Final = 16
"""One symbol, µs: 62 500 symbols a second of 4 bits each (IEEE 802.15.4-2006, 6.5)."""
HEADER_SYMBOLS: Final = 12
"""Preamble 8, start-of-frame delimiter 2, length 2 (IEEE 802.15.4-2006, 6.3)."""
MAC_OCTETS: Final = 9
"""What surrounds the data: frame control 2, sequence 1, source PAN 2, source address 2, FCS 2
(d3scomp/beeclickarm, MRF24J40.cpp)."""


def octets(data_bytes: int) -> int:
    """The size of a frame with so many data bytes: its MAC header, the data and the FCS."""
    return data_bytes + MAC_OCTETS


def airtime_us(data_bytes: int) -> int:
    """The time in the air, µs, of a frame with so many data bytes: 12 symbols and two per PSDU octet."""
    return (HEADER_SYMBOLS + 2 * octets(data_bytes)) * SYMBOL_US


def size_fault(data_bytes: int) -> str:
    """One sentence on why a frame cannot carry so many data bytes; empty if it can."""
    if 1 <= data_bytes <= FRAME_DATA_LIMIT:
        return ""
    return f"The frame has {data_bytes} data bytes; it must have 1 to {FRAME_DATA_LIMIT}."
