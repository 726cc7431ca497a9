"""Files that somebody else may have laid out: only regular ones are read, and only so much of them."""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO, Final

LARGEST: Final = 64_000_000
"""Bytes of what a run or a campaign writes beside its recordings; a result of 1000 robots has 1 MB."""


def opened(path: Path) -> BinaryIO:
    """The file, open for reading. OSError, at once, for a pipe, socket, device or folder."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
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


def text(path: Path, most: int = LARGEST) -> str:
    """The same as text. OSError, also for what is not UTF-8."""
    try:
        return content(path, most).decode()
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"byte {error.start} is not UTF-8", str(path)) from None
