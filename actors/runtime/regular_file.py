"""Safe file access in folders with untrusted content: read regular files only, and never write through links.

A pipe or device could block a reader forever; a link could lead a writer out of the folder.
"""

import errno
import hashlib
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Final

LARGEST: Final = 64_000_000
"""Bytes; limit of files beside the recordings of a run or campaign; a result of 1000 robots has 1 MB."""


def open_regular(path: Path, *, links: bool = True) -> BufferedReader:
    """Open a regular file for reading. OSError, without blocking, for a pipe, socket, device or folder.

    `links`: follow a link; False: OSError for a link.
    """
    follow = 0 if links else os.O_NOFOLLOW
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC | follow)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "is not a regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path, most: int = LARGEST) -> bytes:
    """Return the content of a regular file. OSError if it is longer than `most` bytes."""
    with open_regular(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"has more than {most} bytes", str(path))
    return data


def size_and_sha256(path: Path) -> tuple[int, str]:
    """Return a regular file's size in bytes and its SHA-256 in hexadecimal. OSError also for a link."""
    with open_regular(path, links=False) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return file.tell(), digest


@contextmanager
def atomic_replacement(path: Path) -> Iterator[Path]:
    """Yield the path of a new file that atomically replaces `path` at the end of the context.

    It has the same suffix. A link at `path` is replaced; its target is unchanged.
    """
    part = path.with_name(f".{path.stem[:100]}.{secrets.token_hex(8)}{path.suffix}")
    try:
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666))
        yield part
        part.replace(path)
    except OSError as error:
        if error.filename == str(part):
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        part.unlink(missing_ok=True)


def write_atomically(path: Path, data: bytes, *, durable: bool = False) -> None:
    """Write a file atomically, as `atomic_replacement` does.

    `durable`: sync to disk; after a power failure there is either the old file or the new one.
    """
    with atomic_replacement(path) as part:
        part.write_bytes(data)
        if durable:
            _sync(part)
    if durable:
        _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_no_link(folder: Path) -> Path:
    """Return the folder, which need not exist. OSError if it is a symbolic link."""
    if folder.is_symlink():
        raise OSError(errno.ELOOP, "is a symbolic link, and must be a folder", str(folder))
    return folder
