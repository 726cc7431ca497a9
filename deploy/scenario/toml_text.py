"""Tables as the text of a TOML file, which reads back as the very same values.

A point is one line, as a person writes it; tomli-w would spread it over four, each number on its own.
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Final

from deploy.scenario.tables import Scenario

_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that need no quotes."""


def document(content: Mapping[str, object]) -> str:
    """The file's text: values first, then tables and lists of tables; empty ones of these leave no text.

    Values are bool, int, finite float, str, and lists and tuples of them; floats keep every digit.
    """
    parts = ["\n".join(_line(name, value) for name, value in content.items() if not _holds_tables(value))]
    for name, value in content.items():
        if not value or not _holds_tables(value):
            continue
        if isinstance(value, Mapping):
            parts.append(_table(f"[{_key(name)}]", value))
        else:
            assert isinstance(value, Sequence)
            parts.extend(_table(f"[[{_key(name)}]]", table) for table in value)
    return "\n\n".join(part for part in parts if part) + "\n"


def inline(value: object) -> str:
    """A value on one line, as it may stand after an equals sign; tables in it as inline tables."""
    match value:
        case Mapping():
            return "{" + ", ".join(f"{_key(name)} = {inline(part)}" for name, part in value.items()) + "}"
        case list() | tuple():
            return f"[{', '.join(map(inline, value))}]"
        case _:
            return _value(value)


def _holds_tables(value: object) -> bool:
    """True for a table or a list of tables; an empty list is one of tables, too."""
    if isinstance(value, list | tuple):
        return all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _table(header: str, table: Mapping[str, object]) -> str:
    return "\n".join([header, *(_line(name, value) for name, value in table.items())])


def _line(name: str, value: object) -> str:
    return f"{_key(name)} = {_value(value)}"


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)


def _value(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return _text(value)
        case Sequence():
            return _array(value)
        case _:
            return repr(value)


def _text(value: str) -> str:
    # JSON's strings are TOML's but for DEL, which TOML wants escaped
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _array(items: Sequence[object]) -> str:
    """One line for a pose, a point or names, a line each for a list of poses or points."""
    if items and all(isinstance(item, tuple) for item in items):
        return "[\n" + "".join(f"    {_value(item)},\n" for item in items) + "]"
    return f"[{', '.join(map(_value, items))}]"


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text, which reads back as the very same scenario; what is absent stays absent."""
    return document(scenario.model_dump(exclude_none=True))
