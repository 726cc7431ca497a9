"""Constants of IEEE 802.15.4-2006 at 2.4 GHz (O-QPSK, 250 kb/s) used outside the radio, too.

The octets of a frame are its PSDU: MAC header, data and FCS.
"""

from typing import Final

SYMBOL_NS: Final = 16_000
"""Duration of one symbol of 4 bits: 62 500 per second (6.5)."""
PHY_HEADER_OCTETS: Final = 6
"""Octets before the PSDU: preamble 4, start-of-frame delimiter 1, length 1 (6.3)."""
PSDU_LIMIT: Final = 127
"""aMaxPHYPacketSize, octets (6.4.1)."""
MAC_OCTETS: Final = 9
"""MAC octets of a BEE click's frame: frame control 2, sequence 1, source PAN 2, source address 2, FCS 2
(7.2.1; d3scomp/beeclickarm, MRF24J40.cpp)."""
UNIT_BACKOFF_NS: Final = 20 * SYMBOL_NS
"""aUnitBackoffPeriod (7.4.1)."""
CCA_NS: Final = 8 * SYMBOL_NS
"""Clear channel assessment (6.9.9)."""
TURNAROUND_NS: Final = 12 * SYMBOL_NS
"""aTurnaroundTime: switching between receiving and sending (6.4.1)."""


def airtime_ns(octets: int) -> int:
    """Return the airtime of a frame with this many PSDU octets, PHY header included."""
    return 2 * (PHY_HEADER_OCTETS + octets) * SYMBOL_NS
