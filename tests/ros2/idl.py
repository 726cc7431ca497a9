"""CDR by pycdr2, an implementation that starts from IDL types and shares no code with rosbags."""

from dataclasses import make_dataclass
from typing import Any

from pycdr2 import IdlStruct, types

from tests.ros2.definitions import FIELDS, parts

_PRIMITIVES = {"bool": bool, "string": str}


def _annotation(base: str, length: str | None) -> Any:
    element = idl_type(base) if "/" in base else _PRIMITIVES.get(base) or getattr(types, base)
    if length is None:
        return element
    many: Any = types
    return many.array[element, int(length)] if length else many.sequence[element]


_MADE: dict[str, Any] = {}


def idl_type(kind: str) -> Any:
    """Return the class of a message type."""
    if kind not in _MADE:
        fields = [parts(kind, line) for line in FIELDS[kind]]
        made = make_dataclass(
            kind.replace("/", "_"),
            [(name, _annotation(base, length)) for name, base, length in fields],
            bases=(IdlStruct,),
        )
        _MADE[kind] = made
    return _MADE[kind]


def idl_message(kind: str, fields: dict[str, Any]) -> Any:
    """Return a message from nested dictionaries and lists."""
    values = {}
    for line in FIELDS[kind]:
        name, base, length = parts(kind, line)
        value = fields[name]
        if "/" in base:
            nested = [idl_message(base, one) for one in (value if length is not None else [value])]
            value = nested[0] if length is None else nested
        elif length is not None:
            value = list(value)
        values[name] = value
    return idl_type(kind)(**values)


def idl_fields(kind: str, message: Any) -> dict[str, Any]:
    """Return the nested dictionaries and lists of a message."""
    found = {}
    for line in FIELDS[kind]:
        name, base, length = parts(kind, line)
        value = getattr(message, name)
        if "/" in base:
            nested = [idl_fields(base, one) for one in (value if length is not None else [value])]
            value = nested[0] if length is None else nested
        elif length is not None:
            value = list(value)
        found[name] = value
    return found
