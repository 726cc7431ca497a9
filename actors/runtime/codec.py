"""Encoding of messages: one version byte, then a msgpack array. Errors name the invalid field."""

import re
import reprlib
from collections.abc import Iterable, Iterator
from typing import Any, Final

import msgspec

from actors.messages import MESSAGE_VERSION, TOPICS
from actors.runtime.core import Bus
from actors.runtime.errors import AcrcError
from actors.runtime.typed_json import must_be
from actors.topic import M, Message, Topic

_PREFIX: Final = bytes([MESSAGE_VERSION])
_ENCODER: Final = msgspec.msgpack.Encoder()
_encoded: Final = _ENCODER.encode
_DECODERS: Final[dict[type[Message], msgspec.msgpack.Decoder[Any]]] = {
    topic.kind: msgspec.msgpack.Decoder(topic.kind) for topic in TOPICS
}
_BRIEF: Final = reprlib.Repr()
_BRIEF.maxlevel, _BRIEF.maxstring, _BRIEF.maxother = 2, 60, 60


MESSAGE_LIMIT: Final = 65_000
"""Most bytes of a message, on every bus: what a batch of Zenoh's low-latency transport (65 535 bytes, not
split) holds with the longest key."""


class WireError(AcrcError):
    """Bytes that are not a valid message of their key's topic."""


def encode(message: Message, key: str = "", limit: int = MESSAGE_LIMIT) -> bytes:
    """Encode `message`; equal messages give equal bytes.

    AcrcError, with the `key`, for more than `limit` bytes or for values that do not have the plain types of
    the message's fields.
    """
    sent: object = message
    if message.omissible:  # not a function of its own, which would cost a call per message
        fields, defaults = msgspec.structs.astuple(message), message.__struct_defaults__
        for last in range(-message.omissible, 0):
            if fields[last:] == defaults[last:]:
                sent = fields[:last]
                break
    try:
        payload = _PREFIX + _encoded(sent)
    except (TypeError, ValueError, OverflowError) as error:
        raise AcrcError(f"{_title(message, key)} {_unencodable_value(message) or error}") from None
    if payload[limit:]:  # saves a call of len() per message
        raise AcrcError(f"{_title(message, key)} has {len(payload)} bytes; the limit is {limit}")
    return payload


def _title(message: Message, key: str) -> str:
    return f"step {message.step!r}: {type(message).__name__}{f' on {key}' if key else ''}"


def _unencodable_value(value: object, name: str = "") -> str:
    """Describe the first value in a message, or a part of it, that cannot be encoded; "" if there is none."""
    inner: Iterable[tuple[str, object]] = ()
    if isinstance(value, msgspec.Struct):
        inner = ((f"{name}.{field}", getattr(value, field)) for field in value.__struct_fields__)
    elif isinstance(value, tuple):
        inner = ((f"{name}[{index}]", item) for index, item in enumerate(value))
    else:
        try:
            _ENCODER.encode(value)
        except (TypeError, ValueError, OverflowError) as error:
            kind = f"{type(value).__module__}.{type(value).__qualname__}"
            text = ascii(value)
            text = f"{text[:60]}…" if len(text) > 60 else text
            return f"has {text} of type {kind} in {name.lstrip('.')}; it must be a plain value ({error})"
    return next(filter(None, (_unencodable_value(item, path) for path, item in inner)), "")


def decode(topic: Topic[Message], key: str, payload: bytes) -> Message:
    """Decode `payload`. Raises WireError with key, field and value."""
    if payload[:1] != _PREFIX:
        found = f"version {payload[0]}" if payload else "no bytes"
        raise WireError(f"{key}: {found}, expected message version {MESSAGE_VERSION}")
    try:
        message: Message = _DECODERS[topic.kind].decode(memoryview(payload)[1:])
    except msgspec.ValidationError as error:
        raise WireError(_explain(topic, key, payload[1:], str(error))) from None
    except (ValueError, RecursionError) as error:  # DecodeError; invalid UTF-8; nested too deeply
        raise WireError(f"{key}: {len(payload)} bytes of invalid msgpack: {error}") from None
    return message


def arrived(bus: Bus, topic: Topic[M]) -> Iterator[M]:
    """Yield the messages that have arrived on any key of `topic`. Raises WireError."""
    while (delivery := bus.poll(topic)) is not None:  # type: ignore[arg-type]
        yield decode(delivery.topic, delivery.key, delivery.payload)  # type: ignore[misc]  # of its type


def _element(kind: msgspec.inspect.Type | None, number: int) -> tuple[str, msgspec.inspect.Type | None]:
    """Return an element's name within its message, and its type if known."""
    if isinstance(kind, msgspec.inspect.UnionType):  # an optional part
        kinds = [one for one in kind.types if not isinstance(one, msgspec.inspect.NoneType)]
        kind = kinds[0] if len(kinds) == 1 else None
    if isinstance(kind, msgspec.inspect.StructType) and kind.tag is None:
        field = kind.fields[number]
        return f".{field.name}", field.type
    return f"[{number}]", getattr(kind, "item_type", None)


def _explain(topic: Topic[Message], key: str, body: bytes, reason: str) -> str:
    """Return an error with name and value of the field in `reason`, msgspec's message."""
    reason, _, path = reason.partition(" - at `$")
    try:
        value = msgspec.msgpack.decode(body)
    except (ValueError, RecursionError, TypeError):  # TypeError: a map with a list for a key
        return f"{key}: {topic.kind.__name__} does not decode: {reason}"
    name = topic.kind.__name__
    kind: msgspec.inspect.Type | None = msgspec.inspect.type_info(topic.kind)
    for number in map(int, re.findall(r"\[(\d+)\]", path)):
        if not isinstance(value, list) or number >= len(value):
            break
        part, kind = _element(kind, number)
        name, value = name + part, value[number]
    expected = must_be(reason)
    if not expected:
        return f"{key}: {name} = {_BRIEF.repr(value)}: {reason[:1].lower()}{reason[1:]}"
    return f"{key}: {name} is {_BRIEF.repr(value)}, but must be {expected}"
