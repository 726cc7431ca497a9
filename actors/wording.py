"""Words that sentences about wrong keys and values have in common."""

import difflib
import json
from collections.abc import Collection
from itertools import islice
from typing import Final

_LONGEST: Final = 60
"""Characters of a value that a sentence shows."""
_DEPTH: Final = 3
_BRIEF: Final = 100


def brief(value: object) -> str:
    """A foreign value as Python would write it, cut short where it is long."""
    text = repr(value)
    return text if len(text) <= _BRIEF else f"{text[:_BRIEF]}…"


def shown(value: object) -> str:
    """A value as it would stand in a TOML file, cut short where it is long."""
    try:
        text = json.dumps(_short(value), ensure_ascii=False)
    except TypeError:  # a date or a time
        text = str(value)
    except ValueError:
        text = "a number of more digits than can be shown"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def one_of(known: Collection[object]) -> str:
    """The values that there are, of which one must be taken."""
    *others, last = map(shown, known)
    return f"{', '.join(others)} or {last}" if others else last


def span(
    *, gt: float | None = None, ge: float | None = None, lt: float | None = None, le: float | None = None
) -> str:
    """Bounds of a number as they go on after "must be"; at least one is given."""
    if ge is not None and le is not None:
        return f"from {number(ge)} to {number(le)}"
    low = [f"above {number(gt)}"] if gt is not None else [f"at least {number(ge)}"] if ge is not None else []
    high = [f"below {number(lt)}"] if lt is not None else [f"at most {number(le)}"] if le is not None else []
    return " and ".join(low + high)


def number(value: float) -> str:
    """A number without digits that say nothing."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _short(value: object, depth: int = 0) -> object:
    """As much of a value as a sentence could show: it may refer to itself, or to one part a million times."""
    if isinstance(value, str):
        return value[: _LONGEST + 1]
    if isinstance(value, dict) and depth < _DEPTH:
        return {str(key)[:_LONGEST]: _short(part, depth + 1) for key, part in islice(value.items(), _LONGEST)}
    if isinstance(value, list | tuple) and depth < _DEPTH:
        return [_short(part, depth + 1) for part in value[:_LONGEST]]
    return "…" if isinstance(value, dict | list | tuple) else value


def unknown_key(table: str, name: str, known: Collection[str]) -> str:
    """The sentence, without its end, that `table` has no key `name`; "" is the whole file."""
    prefix = f"{table}." if table else ""
    name = name if len(name) <= _LONGEST else f"{name[:_LONGEST]}…"
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        return f"{prefix}{name} is not known; did you mean {prefix}{near[0]}?"
    where = f"{table} may hold" if table else "known are"
    return f"{prefix}{name} is not known; {where} {', '.join(known)}"
