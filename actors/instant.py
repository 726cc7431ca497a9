"""Instants and durations of the run; the types are the component model's."""

from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds

__all__ = ["START", "Duration", "Instant", "in_seconds", "milliseconds", "seconds"]
