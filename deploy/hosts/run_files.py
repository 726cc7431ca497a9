"""The files of a run on two computers: what comes in is written below one folder, what grows is sent on."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from deploy.hosts.host_messages import PART, FilePart

_ODD: Final = frozenset({"", ".", ".."})


class FilePartError(AcrcError):
    """A part of a file that cannot be taken."""


class Incoming:
    """Writes what comes in, in those folders below `folder` that are allowed, up to `most` bytes."""

    def __init__(self, folder: Path, allows: Callable[[str], bool], most: int) -> None:
        """`folder`: without links. `allows`: tells by a folder's name."""
        self._folder = folder
        self._allows = allows
        self._left = most

    def take(self, part: FilePart) -> None:
        """Write it behind what has come of its file. Raises FilePartError, and OSError."""
        words = part.path.split("/")
        if len(words) < 2 or not self._allows(words[0]) or _ODD & {*words} or "\0" in part.path:
            raise FilePartError(f"a file {part.path[:200]!r}, which is none of its own")
        self._left -= len(part.data)
        if self._left < 0:
            raise FilePartError("more than its robots may write")
        path = self._folder.joinpath(*words)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._check(path)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(path, flags, 0o644), "ab") as file:
            file.write(part.data)

    def _check(self, path: Path) -> None:
        """Raise FilePartError where a link leads elsewhere."""
        if path.parent.resolve() != path.parent or not path.parent.is_relative_to(self._folder):
            raise FilePartError(f"a file {path}, to which a link leads")


class GrowingFile:
    """One file that is sent while it grows, from its beginning."""

    def __init__(self, folder: Path, path: Path) -> None:
        self._name = path.relative_to(folder).as_posix()
        self._path = path
        self._file: BinaryIO | None = None
        self._begun = False

    def part(self) -> FilePart | None:
        """What comes next in it; None if nothing has been written since. Of an empty file one, empty."""
        if self._file is None:
            try:
                self._file = regular_file.opened(self._path, links=False)
            except OSError:
                return None
        data = self._file.read(PART)
        if not data and self._begun:
            return None
        self._begun = True
        return FilePart(self._name, data)

    def close(self) -> None:
        """Close it."""
        if self._file is not None:
            self._file.close()


def parts(folder: Path, below: Path) -> Iterator[FilePart]:
    """All regular files below a folder in `folder`, in order; links are left out."""
    for path in sorted(below.rglob("*")):
        if path.is_symlink() or not path.is_file():
            continue
        file = GrowingFile(folder, path)
        while (part := file.part()) is not None:
            yield part
        file.close()
