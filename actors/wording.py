"""Words that sentences about wrong keys and values have in common."""

import difflib
import json
from collections.abc import Collection
from typing import Final

_LONGEST: Final = 60
"""Characters of a value that a sentence shows."""


def shown(value: object) -> str:
    """A value as it would stand in a TOML file, cut short where it is long."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except TypeError:  # a date or a time
        text = str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def unknown_key(table: str, name: str, known: Collection[str]) -> str:
    """The sentence, without its end, that `table` has no key `name`; "" is the whole file."""
    prefix = f"{table}." if table else ""
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        return f"{prefix}{name} is not known; did you mean {prefix}{near[0]}?"
    where = f"{table} may hold" if table else "known are"
    return f"{prefix}{name} is not known; {where} {', '.join(known)}"
