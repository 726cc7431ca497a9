"""What the kernel believes about its clock, whichever service it is that sets it."""

import ctypes
import sys

_UNSYNCHRONISED = 0x0040
"""STA_UNSYNC of adjtimex(2)."""


class _Timex(ctypes.Structure):
    """The head of struct timex, and room for the rest (adjtimex(2))."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("frequency", ctypes.c_long),
        ("largest_error_us", ctypes.c_long),
        ("estimated_error_us", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def clock_error() -> float | None:
    """By how much the clock may be off at most, s; None if it is not synchronised, or if nobody can tell."""
    if sys.platform != "linux":
        return None
    answer = _Timex()  # modes 0: look, do not touch
    if ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(answer)) < 0:
        return None
    if answer.status & _UNSYNCHRONISED:
        return None
    return float(answer.largest_error_us) / 1e6
