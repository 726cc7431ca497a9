"""The transmit power that the BEE click's firmware sets."""

from typing import Final

from actors.bounds import ParameterError

POWERS: Final = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
"""Which there are, in words that go on after "must be"."""
_LARGE_STEP: Final = 100
"""Tenths of a dB (DS39776C, register RFCON3)."""


def radiated(asked: int) -> int:
    """The transmit power, tenths of a dBm, that the firmware sets when asked for `asked`, 0 to -363.

    Whole tens of dB are right. Of the small steps -0.5 to -6.3 dB a mistake of units leaves two: a remainder
    of -0.5 or -0.6 dB gives -0.5, everything from -0.7 on gives -6.3 (MRF24J40.cpp, setTxPower).
    """
    large, rest = divmod(-asked, _LARGE_STEP)
    small = 0 if rest < 5 else 5 if rest < 7 else 63
    return -(large * _LARGE_STEP + small)


def power_setting(power_dbm: float) -> int:
    """What to ask the board for, tenths of a dBm, so that it sends with `power_dbm`. Raises ParameterError.

    A power that the firmware would make another one of is refused.
    """
    asked = round(power_dbm * 10)
    if abs(asked - power_dbm * 10) < 1e-6 and -363 <= asked <= 0 and radiated(asked) == asked:
        return asked
    raise ParameterError("board.power_dbm", power_dbm, POWERS)
