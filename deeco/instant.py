"""Instants and durations: integers in microseconds, so that time adds up exactly on every machine."""

from typing import Final, NewType

Instant = NewType("Instant", int)
"""Microseconds since the start of the run (in simulation) or since the Unix epoch (on hardware)."""
Duration = NewType("Duration", int)
"""Microseconds."""

START: Final = Instant(0)


def seconds(value: float) -> Duration:
    """The duration of so many seconds, rounded to the microsecond."""
    return Duration(round(value * 1_000_000))


def milliseconds(value: float) -> Duration:
    """The duration of so many milliseconds, rounded to the microsecond."""
    return Duration(round(value * 1_000))


def in_seconds(value: int) -> float:
    """An instant or a duration as a number of seconds, for formulas and for people."""
    return value / 1_000_000
