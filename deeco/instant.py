"""Instants and durations: integers in microseconds, so that time adds up exactly on every machine."""

from collections.abc import Callable
from typing import Final, NewType

from deeco.errors import DefinitionError

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


def check_duration(name: str, value: object, *, zero: bool = False) -> None:
    """Raise DefinitionError for what is no duration, or one below a millisecond; `zero`: 0 is right, too.

    `name` is for errors, such as "@periodic: every".
    """
    if not isinstance(value, int) or isinstance(value, bool):
        raise DefinitionError(f"{name}={value!r} is no duration, and should be one, such as seconds(1)")
    if value < LEAST and not (zero and value == 0):
        raise DefinitionError(
            f"{name}={value} is {value} µs, and should be {'0 or ' if zero else ''}at least {LEAST} µs; "
            "seconds(1) is a second"
        )


def in_seconds(value: int) -> float:
    """An instant or a duration as a number of seconds, for formulas and for people."""
    return value / 1_000_000
