"""The numbers of the MRF24J40: signal strength, transmit power, MAC header."""

from bisect import bisect_right
from typing import Final

from firmware_bridge.beeclick.wire import MisuseError

_STRONGEST_DBM: Final = -35
_WEAKEST_DBM: Final = -90
_RSSI_CODES: Final = (
    *(0, 1, 2, 5, 9, 13, 18, 23, 27, 32, 37, 43, 48, 53, 58, 63, 68, 73, 78, 83, 89, 95, 100, 107),
    *(111, 117, 121, 125, 129, 133, 138, 143, 148, 153, 159, 165, 170, 176, 183, 188, 193, 198, 203),
    *(207, 212, 216, 221, 225, 228, 233, 239, 245, 250, 253, 254, 255),
)
"""The code at -90, -89, … -35 dBm. Source: Linux, drivers/net/ieee802154/mrf24j40.c, the energy levels of
the clear channel assessment, which the chip measures on the same scale; by its own account those of Microchip
DS39776C, table 3-8. Averaged over 8 symbols, typical values: the data sheet promises ± 5 dB."""
_LARGE_STEP: Final = 100
"""Tenths of a dB (DS39776C, register RFCON3)."""
HEADER_SIZE: Final = 7
"""Of the MAC header: frame control, sequence, source PAN, source address."""


def rssi_dbm(code: int) -> float:
    """Signal strength of a code of the chip, dBm; 0 means -90 or less, 255 means -35 or more.

    The link quality needs no such table: the chip gives 0..255 as IEEE 802.15.4-2006, 6.9.8 wants it, 255 the
    best, and how it comes to it is not documented.
    """
    above = bisect_right(_RSSI_CODES, code)
    if above == len(_RSSI_CODES):
        return float(_STRONGEST_DBM)
    lower, upper = _RSSI_CODES[above - 1], _RSSI_CODES[above]
    return _WEAKEST_DBM + above - 1 + (code - lower) / (upper - lower)


def rssi_code(dbm: float) -> int:
    """The code that the chip gives for a signal strength, dBm."""
    steps = min(max(dbm, _WEAKEST_DBM), _STRONGEST_DBM) - _WEAKEST_DBM
    lower = int(steps)
    if lower == len(_RSSI_CODES) - 1:
        return _RSSI_CODES[-1]
    return round(_RSSI_CODES[lower] + (steps - lower) * (_RSSI_CODES[lower + 1] - _RSSI_CODES[lower]))


def radiated(asked: int) -> int:
    """The transmit power, tenths of a dBm, that the firmware sets when asked for `asked`, 0 to -363.

    Whole tens of dB are right. Of the small steps -0.5 to -6.3 dB a mistake of units leaves two: a remainder
    of -0.5 or -0.6 dB gives -0.5, everything from -0.7 on gives -6.3 (MRF24J40.cpp, setTxPower).
    """
    large, rest = divmod(-asked, _LARGE_STEP)
    small = 0 if rest < 5 else 5 if rest < 7 else 63
    return -(large * _LARGE_STEP + small)


def power_setting(power_dbm: float) -> int:
    """What to ask the board for, tenths of a dBm, so that it sends with `power_dbm`. Raises MisuseError.

    A power that the firmware would make another one of is refused.
    """
    asked = round(power_dbm * 10)
    if abs(asked - power_dbm * 10) < 1e-6 and -363 <= asked <= 0 and radiated(asked) == asked:
        return asked
    raise MisuseError(
        f"The board cannot send with {power_dbm:g} dBm; its firmware sets 0, -0.5 or -6.3 dBm, "
        "or one of them less 10, 20 or 30 dB."
    )


def mac_header(pan: int, address: int) -> bytes:
    """The 7 bytes in front of the data: data frame, 16-bit source, sequence always 0 (MRF24J40.cpp)."""
    return b"\x01\x80\x00" + pan.to_bytes(2, "little") + address.to_bytes(2, "little")
