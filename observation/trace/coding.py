"""Traces as bytes: from the program that makes one, and in the file that keeps it."""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, Final

import msgspec
import numpy as np

from actors.runtime import typed_json
from actors.runtime.errors import AcrcError, printable
from observation.trace.rows import Trace, misfit

PART: Final = struct.Struct("<I")
"""Before each part of a trace: how many bytes it has."""
MOST_BYTES: Final = 1 << 30
"""Of one process's trace; ten minutes have 30 MB."""


class TraceError(AcrcError):
    """A trace that is not to be had, or makes no sense."""


def encode(trace: Trace) -> bytes:
    """A part, with its length before it."""
    data = msgspec.msgpack.encode(trace, enc_hook=_plain)
    return PART.pack(len(data)) + data


def decode(data: bytes) -> Trace:
    """One part, without its length. Raises TraceError for what `encode` did not make."""
    try:
        trace = typed_json.decode(data, Trace, form=msgspec.msgpack, hook=_array)
    except (ValueError, TypeError) as error:
        raise TraceError(f"its trace makes no sense: {printable(str(error))}") from None
    if wrong := misfit(trace):
        raise TraceError(f"its trace makes no sense: {wrong}")
    return trace


def parts(data: bytes) -> Iterator[bytes]:
    """The parts of a whole answer, without their lengths. Raises TraceError where one is cut."""
    at = 0
    while at < len(data):
        if len(data) - at < PART.size:
            raise TraceError("its trace makes no sense: it ends within a part")
        (length,) = PART.unpack_from(data, at)
        at += PART.size
        if len(data) - at < length:
            raise TraceError("its trace makes no sense: it ends within a part")
        yield data[at : at + length]
        at += length


def joined(found: Iterable[Trace]) -> Trace:
    """The rows of all parts in one trace, without what was looked at closely: that is of the first."""
    first, *more = found
    if not more:
        return first
    every = (first, *more)
    arrays = {
        name: np.concatenate([getattr(one.held, name) for one in every])
        for name in first.held.__struct_fields__
    }
    rows = {
        name: sum((getattr(one, name) for one in every), ())
        for name in ("doings", "knowledge", "contacts", "goals", "changes", "news", "orders")
    }
    held = type(first.held)(**arrays)
    nodes = any(one.has_nodes for one in every)
    return msgspec.structs.replace(first, held=held, has_nodes=nodes, fault=every[-1].fault, **rows)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.shape, np.ascontiguousarray(value).tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} in a trace")


def _array(kind: Any, told: Any) -> Any:
    """The array of the type that the field has."""
    dtype = np.dtype(kind.__args__[1].__args__[0])
    shape, data = told
    if not all(isinstance(side, int) and side >= 0 for side in shape) or not isinstance(data, bytes):
        raise ValueError("an array without a shape")
    return np.frombuffer(data, dtype).reshape(shape)
