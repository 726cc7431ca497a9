"""What the messages of a recording are made of, for people who open it with other programs.

Messages stay arrays without names; the schema of a channel says the names in their order, and how large
messages are packed.
"""

import functools
from collections.abc import Iterator
from typing import Final

import msgspec
from msgspec import inspect

from actors.messages import TOPICS
from actors.runtime.recording.form import DEFLATED, MESSAGES, SCANNED
from actors.topic import Message

DESCRIPTION: Final = "acrc-fields"
"""The encoding of such a schema: a JSON object with the fields of each type, in their order on the wire.

The first type is the message, behind a byte with the version; of a union each has its tag before its fields.
Where messages are packed, `packing` says in words how.
"""
_PACKING: Final = {
    MESSAGES: (),
    SCANNED: (
        "two bytes, most significant first: where the scan begins",
        "then the message, whose scan (bin 16) has two bytes with the number of ranges, and these packed",
        "actors/runtime/recording/scans.py",
    ),
    DEFLATED: (
        "a part of the stream of deflate (RFC 1951) that runs through all such messages of the file",
        "flushed behind each message, without the bytes 00 00 ff ff at the end of each",
    ),
}
_KINDS: Final = {topic.pattern.rpartition("/")[2]: topic.kind for topic in TOPICS}


def kind_on(key: str) -> type[Message] | None:
    """The type of what travels on a key; None for a key that is none of this project."""
    return _KINDS.get(key.rpartition("/")[2])


@functools.cache
def described(kind: type[Message], encoding: str = MESSAGES) -> bytes:
    """The schema of a type of message, on a channel of that encoding."""
    types = {one.cls.__name__: _fields(one) for one in _structs(inspect.type_info(kind))}
    packing = {"packing": _PACKING[encoding]} if _PACKING[encoding] else {}
    return msgspec.json.encode(types | packing)


def _fields(kind: inspect.StructType) -> list[str]:
    tag = [] if kind.tag is None else [f"tag {kind.tag!r}"]
    return tag + [field.name for field in kind.fields]


def _structs(kind: inspect.Type) -> Iterator[inspect.StructType]:
    """The type itself, and those of its parts."""
    inner: tuple[inspect.Type, ...] = ()
    match kind:
        case inspect.StructType():
            yield kind
            inner = tuple(field.type for field in kind.fields)
        case inspect.UnionType():
            inner = kind.types
        case inspect.VarTupleType():
            inner = (kind.item_type,)
        case inspect.TupleType():
            inner = kind.item_types
    for one in inner:
        yield from _structs(one)
