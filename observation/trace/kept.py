"""Traces kept beside the recordings that they were made from, under the digest of all that they came of.

A trace in a folder that somebody else made is his word, as his recordings are: `acrc replay` holds those
against the strategy.
"""

import errno
import hashlib
import os
import stat
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime import regular_file
from observation.trace.coding import MOST_BYTES, PART, TraceError, parts
from observation.trace.rows import VERSION

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
