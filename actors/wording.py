"""Phrases for errors about keys and values."""

import difflib
import json
from collections.abc import Collection
from itertools import islice
from typing import Final

_MAX_LENGTH: Final = 60
"""Most characters of a value in a message."""
_DEPTH: Final = 3
_MAX_REPR: Final = 100


def short_repr(value: object) -> str:
    """Return the `repr` of a value, truncated."""
    text = repr(value)
    return text if len(text) <= _MAX_REPR else f"{text[:_MAX_REPR]}…"


def seconds_text(seconds: float) -> str:
    """Return seconds to the tenth."""
    return f"{seconds:.1f}".removesuffix(".0")


def toml_text(value: object) -> str:
    """Return a value in TOML notation, truncated."""
    try:
        text = json.dumps(_short(value), ensure_ascii=False)
    except TypeError:  # a date or a time
        text = str(value)
    except ValueError:
        text = "a number with too many digits to show"
    return text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH]}…"


def one_of(known: Collection[object]) -> str:
    """Return the valid values as a list with "or"."""
    *others, last = map(toml_text, known)
    return f"{', '.join(others)} or {last}" if others else last


def bounds_text(
    *, gt: float | None = None, ge: float | None = None, lt: float | None = None, le: float | None = None
) -> str:
    """Return the bounds of a number as text that follows "must be"; at least one must be given."""
    if ge is not None and le is not None:
        return f"from {number_text(ge)} to {number_text(le)}"
    low = (
        [f"above {number_text(gt)}"]
        if gt is not None
        else [f"at least {number_text(ge)}"]
        if ge is not None
        else []
    )
    high = (
        [f"below {number_text(lt)}"]
        if lt is not None
        else [f"at most {number_text(le)}"]
        if le is not None
        else []
    )
    return " and ".join(low + high)


def number_text(value: float) -> str:
    """Return a number without trailing zeros."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _short(value: object, depth: int = 0) -> object:
    """Return a value truncated for display; it may contain itself, or one part a million times."""
    if isinstance(value, str):
        return value[: _MAX_LENGTH + 1]
    if isinstance(value, dict) and depth < _DEPTH:
        return {
            str(key)[:_MAX_LENGTH]: _short(part, depth + 1)
            for key, part in islice(value.items(), _MAX_LENGTH)
        }
    if isinstance(value, list | tuple) and depth < _DEPTH:
        return [_short(part, depth + 1) for part in value[:_MAX_LENGTH]]
    return "…" if isinstance(value, dict | list | tuple) else value


def unknown_key(table: str, name: str, known: Collection[str]) -> str:
    """Return the error, without a full stop, that `table` has no key `name`; "" is the whole file."""
    prefix = f"{table}." if table else ""
    name = name if len(name) <= _MAX_LENGTH else f"{name[:_MAX_LENGTH]}…"
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        return f"unknown key {prefix}{name}; did you mean {prefix}{near[0]}?"
    where = f"known keys of {table}:" if table else "known keys:"
    return f"unknown key {prefix}{name}; {where} {', '.join(known)}"
