"""The folder for what a run writes: one that is asked for, or a new one that no other run takes."""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Final

from actors.installation.usage import OptionError
from actors.processes.launcher import reason, write_fault
from actors.processes.signals import Interrupted
from actors.runtime.errors import AcrcError

_OF_THE_MACHINE: Final = frozenset({
    errno.EACCES, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ELOOP, errno.EMFILE, errno.ENAMETOOLONG,
    errno.ENFILE, errno.ENOSPC, errno.ENOTDIR, errno.EPERM, errno.EROFS, errno.ESTALE,
})  # fmt: skip
"""Errors of a disk or a path rather than of this program."""
_ENDPOINT_MARKS: Final = "?#"
"""Characters that end the path of a socket in a Zenoh endpoint."""


def claim(parent: Path, name: str) -> Path:
    """Make a folder `name` in `parent`, or `name-2` and so on where that exists; its path as of `checked`.

    To make it is to claim it, so two that ask in the same instant get two. Raises AcrcError.
    """
    for number in count(1):
        folder = Path(os.path.realpath(parent)) / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            if isinstance(error, FileExistsError) and folder.parent.is_dir():
                continue
            raise _unusable(folder, error) from None
        return folder
    raise AssertionError("there is always one more number")


def newest(parent: Path) -> Path | None:
    """The run in `parent` that was begun last; None if there is none."""
    runs = [file.parent for file in parent.glob("*/scenario.toml")]
    return max(runs, key=lambda run: ((run / "scenario.toml").stat().st_mtime_ns, run), default=None)


@contextmanager
def dropped_if_empty(folder: Path) -> Iterator[None]:
    """Whatever is raised takes the folder along if nothing has been written to it yet.

    Where something has, and the cause is Interrupted, that names the folder.
    """
    try:
        yield
    except BaseException as error:
        with suppress(OSError):
            folder.rmdir()
        if isinstance(error, Interrupted) and folder.is_dir():
            error.recorded = folder
        raise


def checked(out: Path, *, mesh: bool) -> Path:
    """The folder's absolute path, without links: a sandbox has none of those that lead to it.

    `mesh`: sockets will lie in it. Raises OptionError for a folder that can be seen to be of no use.
    """
    try:
        if out.exists() and not out.is_dir():
            raise OptionError(f"--out: {out} is a file; must be a folder that is new or empty")
        real = Path(os.path.realpath(out))
    except OSError as error:
        raise OptionError(
            f"--out: {_short(out)} cannot be used: {reason(error)}; must be a folder that is new or empty"
        ) from None
    mark = next((mark for mark in _ENDPOINT_MARKS if mark in str(real)), None)
    if mesh and mark is not None:
        raise OptionError(
            f'--out: {real} has a "{mark}", which cannot be part of a socket\'s address; must be a '
            "folder without one, or stand with --bus memory"
        )
    return real


def make_folder(out: Path) -> None:
    """Make the folder for the results. OptionError if there is something, AcrcError if it cannot be."""
    check_new(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unusable(out, error) from None


def check_new(out: Path) -> None:
    """Raise OptionError if there is something already in the folder, AcrcError if it is closed."""
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise OptionError(f"--out: {out} already exists and is not empty; choose a new folder")
    except OSError as error:
        raise _unusable(out, error) from None


@contextmanager
def replacing(out: Path, mark: str) -> Iterator[None]:
    """Remove the folder `out` at the end, or leave it as it was if nothing was written in its place.

    `mark`: a file that is in every folder of the kind. Raises OptionError for one that lacks it, unless it is
    empty or does not exist.
    """
    if not out.is_dir() or not any(out.iterdir()):
        yield
        return
    if not (out / mark).is_file():
        raise OptionError(
            f"--out: {out} has other content, and no {mark}; must be what can be replaced, or new"
        )
    with tempfile.TemporaryDirectory(prefix=f"{out.name}.replaced-", dir=out.parent) as name:
        old = out.rename(Path(name) / out.name)
        try:
            yield
        finally:
            if not out.exists():
                old.rename(out)


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """What the system refuses while results are written there becomes an AcrcError.

    Any other AcrcError is told with it if nothing can be written there any more: a process that cannot write
    cannot say why it ended.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _OF_THE_MACHINE:
            raise
        where = error.filename if isinstance(error.filename, str) else out
        raise AcrcError(f"{where}: cannot be written: {reason(error)}") from error
    except AcrcError as error:
        why = write_fault(out)
        if why is None or why in str(error):
            raise
        raise AcrcError(f"{error}; {out}: cannot be written: {why}") from error


def _unusable(out: Path, error: OSError) -> AcrcError:
    return AcrcError(f"--out: {_short(out)} cannot be made: {reason(error)}; choose another place")


def _short(path: Path) -> str:
    """A path as it can be read; one that is too long for the system is too long for a person."""
    text = str(path)
    return text if len(text) <= 200 else f"{text[:200]}…"
