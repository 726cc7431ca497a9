"""The traces of robots of a run: those that are kept, and the others made, in sandboxes, and kept."""

import errno
import hashlib
import os
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from acrc_testbed.replay.run_recordings import all_recordings, run_of
from acrc_testbed.replay.sandboxed import Bounds, Call, CallOutcome, ask, check_trust
from acrc_testbed.trace.rows import VERSION, Trace, misfit
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.foreign import Permit
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError, printable
from actors.runtime.recording.reading import report_damage

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
_MAKERS: Final = ("actors", "deeco", "cleaning", "acrc_testbed/trace", "acrc_testbed/replay")
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


BOUNDS: Final = Bounds(MOST_BYTES)


@dataclass(frozen=True)
class Traced:
    """What came of one process: parts of its trace, or why there are none."""

    actor: str
    parts: tuple[Trace, ...] = ()
    fault: str | None = None

    def whole(self) -> Trace:
        """All rows, with what was looked at closely of the first part. TraceError for a fault."""
        trace = joined(self.parts) if self.parts else None
        if trace is None or trace.fault is not None:
            raise TraceError(self.fault or (trace and trace.fault) or f"{self.actor}: has no trace")
        return trace


def traces(
    out: Path, actors: Sequence[str], *, permit: Permit, isolate: bool, bounds: Bounds = BOUNDS
) -> Iterator[Traced]:
    """The trace of each process, as it is there; those that are kept first.

    `isolate`: see `actors.runtime.isolation.sandbox`. Of code that the permit does not cover the fault says
    that it was not run. What was made by code that need not be the recorded one is not kept.
    """
    files, wanted = all_recordings(out), list[str]()
    for actor in actors:
        if actor in files:
            report_damage(files[actor])
        found = _kept(files, actor) if not permit.trust else None
        if found is None:
            wanted.append(actor)
        else:
            yield found
    came_of = {actor: inputs(files[actor]) for actor in wanted if actor in files}
    words = ("--file-mb", str(max(1, bounds.most_bytes // 1_000_000)))
    calls = [Call(actor, (actor,), words) for actor in wanted]
    for answer in ask(out, "acrc_testbed.trace.program", calls, bounds, permit=permit, isolate=isolate):
        traced = _read(answer)
        if traced.parts and traced.parts[-1].fault is None and may_keep(out, traced.actor, permit):
            assert answer.data is not None
            keep(files[traced.actor], came_of[traced.actor], parts(answer.data))
        yield traced


def may_keep(out: Path, actor: str, permit: Permit) -> bool:
    """True if what made a trace is known to be the recorded code: this project's, or by its hashes."""
    known = run_of(all_recordings(out)[actor]).code is not None
    return not permit.trust and (known or check_trust(out, actor, permit) == ())


def _kept(files: dict[str, Path], actor: str) -> Traced | None:
    found = kept(files[actor]) if actor in files else None
    if not found:
        return None
    try:
        return Traced(actor, tuple(map(decode, found)))
    except TraceError:
        return None


def _read(answer: CallOutcome) -> Traced:
    if answer.data is None:
        return Traced(answer.name, fault=answer.fault)
    try:
        return Traced(answer.name, tuple(map(decode, parts(answer.data))))
    except TraceError as error:
        return Traced(answer.name, fault=f"{answer.name}: {error}")
