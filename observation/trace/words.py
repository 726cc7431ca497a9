"""Knowledge of any component as rows of a table, in words that a person reads."""

from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Final

from actors.instant import Instant, in_seconds
from actors.runtime.errors import printable
from actors.task.words import PlaceKey
from deeco import Knowledge

_LONGEST: Final = 160
"""Characters of a value."""
_DEEPEST: Final = 3
"""Values within values beyond this are left out."""


def rows(knowledge: Knowledge) -> tuple[tuple[str, str], ...]:
    """Name and value of each field that says anything; parameters never change, and are left out."""
    told = []
    for field in fields(knowledge):
        if field.name != "parameters":
            text = printable(in_words(getattr(knowledge, field.name)))
            short = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
            told.append((field.name.replace("_", " "), short))
    return tuple(told)


def in_words(value: Any, deep: int = 0) -> str:
    """A value as short as it can be told: a place as "r1/3", a point by its coordinates."""
    key = value if isinstance(value, PlaceKey) else getattr(value, "key", None)
    if isinstance(key, PlaceKey):
        return f"{key.owner}/{key.place}"
    if value is None or value == ():
        return "-"
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, Enum):
        return str(value.value)
    return _composed(value, deep)


def _composed(value: Any, deep: int) -> str:
    """A value that may be made of others."""
    if is_dataclass(value):
        parts = [getattr(value, one.name) for one in fields(value)]
    elif isinstance(value, tuple | list | frozenset):
        parts = list(value)
    else:
        return str(value)
    if deep == _DEEPEST:
        return "…"
    told = [in_words(one, deep + 1) for one in parts]
    if isinstance(value, frozenset):
        told.sort()
    return (", " if is_dataclass(value) or hasattr(value, "_fields") else " ").join(told)


def seconds(instant: Instant) -> str:
    """An instant as people read it, s."""
    return f"{in_seconds(instant):.3f}".rstrip("0").rstrip(".")
