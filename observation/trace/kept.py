"""Traces kept beside the recordings that they were made from, under the digest of all that they came of.

A trace in a folder that somebody else made is his word, as his recordings are: `acrc replay` holds those
against the strategy.
"""

import errno
import hashlib
import os
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from actors.installation.repository import REPOSITORY
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError, printable
from observation.trace.rows import VERSION, Trace, misfit

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


_ENDING: Final = ".trace"
_MAKERS: Final = ("actors", "deeco", "cleaning", "observation/trace", "observation/replay")
"""Packages whose code decides what is in a trace."""
_MOST_RECORDED: Final = 1 << 33
"""Bytes of a recording; beyond that, days of a robot, its trace is made anew each time."""
_LEVEL: Final = 1
"""Of compression: the fastest."""


def own_files(path: Path) -> Iterator[Path]:
    """A recording, and the model and map beside it; no password, and no way to others."""
    for file in sorted(path.parent.iterdir()):
        wanted = file == path or file.suffix == ".toml" or file.stem == "map"
        if wanted and stat.S_ISREG(file.lstat().st_mode):
            yield file


def inputs(path: Path) -> bytes | None:
    """The digest of what the trace of a recording comes of: its process's own files, and this software.

    The strategy's code is in it by the hashes that the recording has. None where a file cannot be read, or is
    larger than anything of its kind: then nothing is kept.
    """
    try:
        return _digest(path)
    except OSError:
        return None


def keep(path: Path, came_of: bytes | None, found: Iterable[bytes]) -> None:
    """Keep the parts of a trace beside the recording, if there is room, and the recording is the same still.

    `came_of`: what `inputs` said before it was made.
    """
    with suppress(OSError):
        if came_of is not None and inputs(path) == came_of:
            packed = [zlib.compress(part, _LEVEL) for part in found]
            data = b"".join(PART.pack(len(part)) + part for part in packed)
            regular_file.write(path.with_suffix(_ENDING), came_of + data)


def kept(path: Path) -> list[bytes] | None:
    """The parts of the trace that was kept; None if there is none, or it came of something else."""
    try:
        data = regular_file.content(path.with_suffix(_ENDING), MOST_BYTES)
        came_of = inputs(path)
        if came_of is None or not data.startswith(came_of):
            return None
        return list(_unpacked(data[len(came_of) :]))
    except (OSError, TraceError, zlib.error):
        return None


def _unpacked(data: bytes) -> Iterator[bytes]:
    room = MOST_BYTES
    for part in parts(data):
        unpack = zlib.decompressobj()
        whole = unpack.decompress(part, room)
        if not unpack.eof:
            raise TraceError("its trace is cut, or larger than it may be")
        room -= len(whole)
        yield whole


def _digest(path: Path) -> bytes:
    found = hashlib.sha256(f"{VERSION} {_software()}\n".encode())
    for file in own_files(path):
        with regular_file.opened(file, links=False) as stream:
            most = _MOST_RECORDED if file == path else regular_file.LARGEST
            if os.fstat(stream.fileno()).st_size > most:
                raise OSError(errno.EFBIG, f"has more than {most} bytes", str(file))
            found.update(f"{file.name} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode())
    return found.digest()


@cache
def _software() -> str:
    found = hashlib.sha256()
    for package in _MAKERS:
        for file in sorted((REPOSITORY / package).rglob("*.py")):
            found.update(file.read_bytes())
    return found.hexdigest()
