"""Instants and durations as integers in microseconds, so that sums are exact on every machine."""

from collections.abc import Callable
from typing import Final, NewType

from deeco.errors import DefinitionError

Instant = NewType("Instant", int)
"""Microseconds since the start of the run (in simulation) or since the Unix epoch (on hardware)."""
Duration = NewType("Duration", int)
"""Microseconds."""
Task = Callable[[Instant], None]
"""A scheduled action, called with its scheduled instant."""

START: Final = Instant(0)


def seconds(value: float) -> Duration:
    """Return a duration of `value` seconds, rounded to the microsecond."""
    return Duration(round(value * 1_000_000))


def milliseconds(value: float) -> Duration:
    """Return a duration of `value` milliseconds, rounded to the microsecond."""
    return Duration(round(value * 1_000))


MIN_DURATION: Final = milliseconds(1)
"""Shortest period, delay or age except 0; a smaller value probably has the wrong unit."""


def check_duration(name: str, value: object, *, zero: bool = False) -> None:
    """Raise DefinitionError unless `value` is a duration of at least 1 ms, or 0 if `zero`.

    `name` is used in errors, such as "@periodic: every".
    """
    if not isinstance(value, int) or isinstance(value, bool):
        raise DefinitionError(f"{name}={value!r} is not a duration; use one, such as seconds(1)")
    if value < MIN_DURATION and not (zero and value == 0):
        raise DefinitionError(
            f"{name}={value} is {value} µs; use {'0 or ' if zero else ''}at least {MIN_DURATION} µs. "
            "seconds(1) is one second"
        )


def in_seconds(value: int) -> float:
    """Return an instant or a duration as a number of seconds."""
    return value / 1_000_000
