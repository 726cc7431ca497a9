"""Instants and durations of a run, with the types of the component model."""

from typing import Final

from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds

__all__ = ["LATEST", "START", "Duration", "Instant", "in_seconds", "milliseconds", "seconds"]

LATEST: Final = 10**16
"""Latest valid instant: the year 2286 in µs since 1970, the epoch of a base on hardware."""
