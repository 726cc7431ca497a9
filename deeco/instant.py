"""Instants and durations as integers in microseconds, so that sums are exact on every machine."""

import re
import traceback
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
ZERO: Final = Duration(0)


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

    `name` is used in errors, such as "@periodic: every". A duration is an int at run time, since encoders
    such as msgspec refuse subclasses of int. Therefore the source line of the call shows whether the program
    gives a number without a unit.
    """
    if not isinstance(value, int) or isinstance(value, bool):
        raise DefinitionError(f"{name}={value!r} is not a duration; use one, such as seconds(1)")
    call = "".join(frame.line or "" for frame in traceback.extract_stack(limit=4))
    if value and re.sub("[ _]", "", f"{name.rpartition(' ')[2]}={value}") in re.sub("[ _]", "", call):
        raise DefinitionError(f"{name}={value} has no unit; use seconds(...) or milliseconds(...)")
    if value < MIN_DURATION and not (zero and value == 0):
        raise DefinitionError(
            f"{name}={value} is {value} µs; use {'0 or ' if zero else ''}at least {MIN_DURATION} µs. "
            "seconds(1) is one second"
        )


def in_seconds(value: int) -> float:
    """Return an instant or a duration as a number of seconds."""
    return value / 1_000_000
