"""A scenario as the text of a TOML file, which reads back as the very same scenario."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from deploy.scenario import Scenario


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text; what is absent stays absent, and floats keep every digit."""
    content = scenario.model_dump(exclude_none=True)
    head = [f"{name} = {_value(value)}" for name, value in content.items() if not _holds_tables(value)]
    parts = ["\n".join(head)]
    for name, value in content.items():
        if isinstance(value, Mapping):
            parts.append(_table(f"[{name}]", value))
        elif _holds_tables(value):
            parts.extend(_table(f"[[{name}]]", table) for table in value)
    return "\n\n".join(parts) + "\n"


def _holds_tables(value: object) -> bool:
    """True for a table or a list of tables; an empty list is one of tables, too, and leaves no text."""
    if isinstance(value, tuple):
        return all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _table(header: str, table: Mapping[str, Any]) -> str:
    return "\n".join([header, *(f"{name} = {_value(value)}" for name, value in table.items())])


def _value(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            # JSON's strings are TOML's but for DEL, which TOML wants escaped
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case Sequence():
            return _array(value)
        case _:
            return repr(value)


def _array(items: Sequence[object]) -> str:
    """One line for a pose, a point or names, a line each for a list of poses or points."""
    if items and all(isinstance(item, tuple) for item in items):
        return "[\n" + "".join(f"    {_value(item)},\n" for item in items) + "]"
    return f"[{', '.join(map(_value, items))}]"
