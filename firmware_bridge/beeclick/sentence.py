"""The GPS module's sentence RMC: where it is, and when (NMEA 0183)."""

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from typing import Final

_FRAME: Final = re.compile(rb"\$(GPRMC,[\x20-\x29\x2b-\x7e]*)\*([0-9A-F]{2})")
_TIME: Final = re.compile(r"(\d\d)(\d\d)(\d\d)(\.\d+)?")
_DATE: Final = re.compile(r"(\d\d)(\d\d)(\d\d)")
_ANGLE: Final = re.compile(r"(\d+)(\d\d(?:\.\d+)?)")
_LEAST_FIELDS: Final = 10
"""Type, time, status, latitude, N or S, longitude, E or W, speed, course, date."""


@dataclass(frozen=True)
class RecommendedMinimum:
    """What a sentence says; degrees, north and east positive."""

    valid: bool
    """True if the receiver vouches for the position, which is then there."""
    latitude: float | None
    longitude: float | None
    utc: datetime | None


def parse(text: bytes) -> RecommendedMinimum | None:
    """The sentence in `text`; None if it is none: checksum, fields, ranges and digits must be right."""
    frame = _FRAME.fullmatch(text)
    if frame is None or reduce(xor, frame[1]) != int(frame[2], 16):
        return None
    fields = frame[1].decode().split(",")
    if len(fields) < _LEAST_FIELDS or fields[2] not in ("A", "V"):
        return None
    try:
        utc = _instant(fields[9], fields[1])
        latitude = _degrees(fields[3], fields[4], 2, "NS", 90.0)
        longitude = _degrees(fields[5], fields[6], 3, "EW", 180.0)
    except ValueError:
        return None
    valid = fields[2] == "A"
    if valid and (latitude is None or longitude is None or utc is None):
        return None
    return RecommendedMinimum(valid, latitude, longitude, utc)


def _instant(date: str, time: str) -> datetime | None:
    """From `ddmmyy` and `hhmmss.s…`; None if one is missing, as before the first fix."""
    if not date or not time:
        return None
    day, clock = _DATE.fullmatch(date), _TIME.fullmatch(time)
    if day is None or clock is None:
        raise ValueError
    midnight = datetime(2000 + int(day[3]), int(day[2]), int(day[1]), tzinfo=UTC)
    hours, minutes, seconds = int(clock[1]), int(clock[2]), int(clock[3])
    if hours > 23 or minutes > 59 or seconds > 60:  # 60: a leap second
        raise ValueError
    return midnight + timedelta(hours=hours, minutes=minutes, seconds=seconds + float(clock[4] or 0))


def _degrees(angle: str, side: str, digits: int, sides: str, most: float) -> float | None:
    """From degrees of so many digits and minutes `mm.m…` with any number of decimals."""
    if not angle and not side:
        return None
    parts = _ANGLE.fullmatch(angle)
    if parts is None or len(parts[1]) != digits or len(side) != 1 or side not in sides:
        raise ValueError
    minutes = float(parts[2])
    degrees = int(parts[1]) + minutes / 60.0
    if minutes >= 60.0 or degrees > most:
        raise ValueError
    return math.copysign(degrees, 1.0 if side == sides[0] else -1.0)
