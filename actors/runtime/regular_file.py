"""Files in folders that somebody else may have laid out: read if they are regular, and written beside links.

What is no regular file would keep a reader waiting for ever, and a link leads a writer out of the folder.
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
"""Bytes of what a run or a campaign writes beside its recordings; a result of 1000 robots has 1 MB."""


def opened(path: Path, *, links: bool = True) -> BufferedReader:
    """The file, open for reading. OSError, at once, for a pipe, socket, device or folder.

    `links`: follow one; else that is an OSError, too.
    """
    follow = 0 if links else os.O_NOFOLLOW
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC | follow)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "is no regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def content(path: Path, most: int = LARGEST) -> bytes:
    """All that is in a regular file. OSError, also if that is more than `most` bytes."""
    with opened(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"has more than {most} bytes", str(path))
    return data


def summed(path: Path) -> tuple[int, str]:
    """How many bytes a regular file has, and its SHA-256 in hexadecimal. OSError, also for a link."""
    with opened(path, links=False) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return file.tell(), digest


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A new file beside `path`, to be written, that then takes its name and the place of whatever has it.

    It has the same ending. A link at `path` is replaced, and what it leads to stays as it is.
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


def write(path: Path, data: bytes, *, durable: bool = False) -> None:
    """Write a file anew, as `replaced` does.

    `durable`: wait for the disk; after a loss of power it is the old file or the new one.
    """
    with replaced(path) as part:
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


def no_link(folder: Path) -> Path:
    """The folder, or where it is to be. OSError where a link lies there."""
    if folder.is_symlink():
        raise OSError(errno.ELOOP, "is a link, through which nothing is written", str(folder))
    return folder
