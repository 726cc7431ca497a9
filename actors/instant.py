"""Instants and durations of the run; the types are the component model's."""

from typing import Final

from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds

__all__ = ["LATEST", "START", "Duration", "Instant", "in_seconds", "milliseconds", "seconds"]

LATEST: Final = 10**16
"""Later instants are damage: the year 2286, µs since 1970, from which a base on board counts."""
