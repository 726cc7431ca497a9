"""Instants and durations: integers in microseconds, so that time adds up exactly on every machine."""

from collections.abc import Callable
from typing import Final, NewType

Instant = NewType("Instant", int)
"""Microseconds since the start of the run (in simulation) or since the Unix epoch (on hardware)."""
Duration = NewType("Duration", int)
"""Microseconds."""
Task = Callable[[Instant], None]
"""A planned action; called with the instant for which it was planned."""

START: Final = Instant(0)


def seconds(value: float) -> Duration:
    """The duration of so many seconds, rounded to the microsecond."""
    return Duration(round(value * 1_000_000))


def milliseconds(value: float) -> Duration:
    """The duration of so many milliseconds, rounded to the microsecond."""
    return Duration(round(value * 1_000))


LEAST: Final = milliseconds(1)
"""The shortest period, delay or age but none: what is shorter was meant in other units."""


def duration_fault(name: str, value: object, *, may_be_none: bool = False) -> str | None:
    """What is wrong with a duration that is an argument `name`, in words; None: nothing.

    `may_be_none`: 0 is right, too.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        if value >= LEAST or (may_be_none and value == 0):
            return None
        return (
            f"{name}={value} is {value} µs, and should be {'0 or ' if may_be_none else ''}at least "
            f"{LEAST} µs; seconds(1) is a second"
        )
    return f"{name}={value!r} is no duration, and should be one, such as seconds(1)"


def in_seconds(value: int) -> float:
    """An instant or a duration as a number of seconds, for formulas and for people."""
    return value / 1_000_000
