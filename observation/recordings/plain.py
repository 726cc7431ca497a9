"""Messages as plain values with the names of their fields, for readers that know nothing of this project."""

import base64
import struct
from typing import Any, Final

import msgspec
from msgspec import inspect

from actors.messages import Scan
from actors.topic import Message

TAG: Final = "kind"
"""The field that says which of several a value is, such as `heard` of the events of Received."""


def plain(value: object) -> Any:
    """The value as JSON has it: a dict for each part of a message, base64 for bytes, mm for a scan."""
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        named: dict[str, Any] = {} if tag is None else {TAG: tag}
        return named | {name: plain(_field(value, name)) for name in value.__struct_fields__}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


def _field(value: msgspec.Struct, name: str) -> object:
    if isinstance(value, Scan) and name == "ranges_mm":
        count = len(value.ranges_mm) // 2
        return struct.unpack(f"<{count}H", value.ranges_mm[: 2 * count])
    return getattr(value, name)


def columns(kind: type[Message]) -> list[str]:
    """The fields of a type of message as columns: `odometry.x`, `pose[0]`; a tuple of any length is one."""
    return _columns(inspect.type_info(kind), "")


def _columns(kind: inspect.Type, name: str) -> list[str]:
    if isinstance(kind, inspect.UnionType):
        present = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
        if len(present) == 1:
            return _columns(present[0], name)
    if isinstance(kind, inspect.StructType):
        prefix = f"{name}." if name else ""
        return [column for one in kind.fields for column in _columns(one.type, prefix + one.name)]
    if isinstance(kind, inspect.TupleType):
        parts = (_columns(one, f"{name}[{index}]") for index, one in enumerate(kind.item_types))
        return [column for part in parts for column in part]
    return [name]


def at_column(message: Message, column: str) -> Any:
    """The value at a column such as `robots[2].x`, as `plain` has it; None if the message has nothing there.

    Raises LookupError for a column that no message of this type has.
    """
    value: Any = message
    for part in column.replace("[", ".[").split("."):
        if value is None:
            return None
        if part.startswith("["):
            index = int(part.removeprefix("[").removesuffix("]"))
            if not isinstance(value, tuple):
                raise LookupError(column)
            value = value[index] if index < len(value) else None
        elif isinstance(value, msgspec.Struct) and part in value.__struct_fields__:
            value = _field(value, part)
        else:
            raise LookupError(column)
    return plain(value)
