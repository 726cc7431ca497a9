"""Messages to bytes and back: one version byte, then a msgpack array; whatever does not fit is named."""

import re
import reprlib
from typing import Any, Final

import msgspec

from actors.messages import MESSAGE_VERSION, TOPICS
from actors.runtime.errors import AcrcError
from actors.topic import Message, Topic

_PREFIX: Final = bytes([MESSAGE_VERSION])
_ENCODER: Final = msgspec.msgpack.Encoder()
_DECODERS: Final[dict[type[Message], msgspec.msgpack.Decoder[Any]]] = {
    topic.kind: msgspec.msgpack.Decoder(topic.kind) for topic in TOPICS
}
_BRIEF: Final = reprlib.Repr()
_BRIEF.maxlevel, _BRIEF.maxstring, _BRIEF.maxother = 2, 60, 60


class WireError(AcrcError):
    """Bytes on a key that are no message of its topic."""


def encode(message: Message) -> bytes:
    """The bytes of `message`; equal messages give equal bytes."""
    return _PREFIX + _ENCODER.encode(message)


def decode(topic: Topic[Message], key: str, payload: bytes) -> Message:
    """The message in `payload`, or WireError with key, field and value."""
    if payload[:1] != _PREFIX:
        found = f"version {payload[0]}" if payload else "no bytes"
        raise WireError(f"{key}: {found} where message version {MESSAGE_VERSION} was due")
    try:
        message: Message = _DECODERS[topic.kind].decode(memoryview(payload)[1:])
    except msgspec.ValidationError as error:
        raise WireError(_explain(topic, key, payload[1:], str(error))) from None
    except (ValueError, RecursionError) as error:  # DecodeError; text that is not UTF-8; nested too deeply
        raise WireError(f"{key}: not msgpack after {len(payload)} bytes: {error}") from None
    return message


def _explain(topic: Topic[Message], key: str, body: bytes, reason: str) -> str:
    """One sentence with the name and the value of the field that `reason`, msgspec's words, points to."""
    reason, _, path = reason.partition(" - at `$")
    try:
        value = msgspec.msgpack.decode(body)
    except (ValueError, RecursionError, TypeError):  # TypeError: a map with a list for a key
        return f"{key}: {topic.kind.__name__} does not decode: {reason}"
    name = topic.kind.__name__
    fields: tuple[str, ...] = topic.kind.__struct_fields__
    for depth, index in enumerate(re.findall(r"\[(\d+)\]", path)):
        number = int(index)
        if not isinstance(value, list) or number >= len(value):
            break
        name += f".{fields[number]}" if depth == 0 else f"[{number}]"
        value = value[number]
    return f"{key}: {name} = {_BRIEF.repr(value)}: {reason[:1].lower()}{reason[1:]}"
