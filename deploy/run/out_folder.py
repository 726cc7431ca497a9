"""Output folders of runs: checks, creation, replacement and write errors."""

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
from actors.processes.signals import Interruption
from actors.runtime.errors import AcrcError

_ENVIRONMENT_ERRORS: Final = frozenset({
    errno.EACCES, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ELOOP, errno.EMFILE, errno.ENAMETOOLONG,
    errno.ENFILE, errno.ENOSPC, errno.ENOTDIR, errno.EPERM, errno.EROFS, errno.ESTALE,
})  # fmt: skip
"""Errors caused by a disk or path rather than by this program."""
_ENDPOINT_MARKS: Final = "?#"
"""Characters that end a socket's path in a Zenoh endpoint."""


def claim(parent: Path, name: str) -> Path:
    """Create the folder `name` in `parent`, or `name-2` and so on if it exists; return its real path.

    Creation is atomic, so concurrent runs get different folders. Raises AcrcError.
    """
    for number in count(1):
        folder = Path(os.path.realpath(parent)) / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            if isinstance(error, FileExistsError) and folder.parent.is_dir():
                continue
            raise _creation_error(folder, error) from None
        return folder
    raise AssertionError("there is always one more number")


def newest_run(parent: Path) -> Path | None:
    """Return the latest run in `parent`; None if there is none."""
    runs = [file.parent for file in parent.glob("*/scenario.toml")]
    return max(runs, key=lambda run: ((run / "scenario.toml").stat().st_mtime_ns, run), default=None)


@contextmanager
def remove_if_empty(folder: Path) -> Iterator[None]:
    """Remove the folder after an error if it is empty; otherwise add its path to an Interruption."""
    try:
        yield
    except BaseException as error:
        with suppress(OSError):
            folder.rmdir()
        if isinstance(error, Interruption) and folder.is_dir():
            error.recorded = folder
        raise


def checked_path(out: Path, *, mesh: bool) -> Path:
    """Return the folder's absolute path without symbolic links, which a sandbox would lack.

    `mesh`: the folder will contain sockets. Raises OptionError for an unusable folder.
    """
    try:
        if out.exists() and not out.is_dir():
            raise OptionError(f"--out: {out} is a file; choose a new or empty folder")
        real = Path(os.path.realpath(out))
    except OSError as error:
        raise OptionError(
            f"--out: {_truncated(out)} cannot be used: {reason(error)}; choose a new or empty folder"
        ) from None
    mark = next((mark for mark in _ENDPOINT_MARKS if mark in str(real)), None)
    if mesh and mark is not None:
        raise OptionError(
            f'--out: {real} contains "{mark}", which a socket address cannot; choose another '
            "folder, or use --bus memory"
        )
    return real


def make_folder(out: Path) -> None:
    """Create an output folder. Raises OptionError if it is not empty, AcrcError if it cannot be created."""
    check_new(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _creation_error(out, error) from None


def check_new(out: Path) -> None:
    """Raise OptionError if the folder is not empty, AcrcError if it cannot be read."""
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise OptionError(f"--out: {out} already exists and is not empty; choose a new folder")
    except OSError as error:
        raise _creation_error(out, error) from None


@contextmanager
def replace_folder(out: Path, marker_file: str) -> Iterator[None]:
    """Replace the folder `out`; restore it if nothing is written in its place.

    `marker_file`: identifies a folder of this kind. Raises OptionError for a folder without it, unless
    empty or missing.
    """
    if not out.is_dir() or not any(out.iterdir()):
        yield
        return
    if not (out / marker_file).is_file():
        raise OptionError(f"--out: {out} has no {marker_file} and is not replaced; choose a new folder")
    with tempfile.TemporaryDirectory(prefix=f"{out.name}.replaced-", dir=out.parent) as name:
        old = out.rename(Path(name) / out.name)
        try:
            yield
        finally:
            if not out.exists():
                old.rename(out)


@contextmanager
def convert_write_errors(out: Path) -> Iterator[None]:
    """Convert operating-system errors while results are written into AcrcErrors.

    If the folder is no longer writable, that reason is appended to any other AcrcError: a process that
    cannot write cannot record why it exited.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _ENVIRONMENT_ERRORS:
            raise
        where = error.filename if isinstance(error.filename, str) else out
        raise AcrcError(f"{where}: cannot be written: {reason(error)}") from error
    except AcrcError as error:
        why = write_fault(out)
        if why is None or why in str(error):
            raise
        raise AcrcError(f"{error}; {out}: cannot be written: {why}") from error


def _creation_error(out: Path, error: OSError) -> AcrcError:
    return AcrcError(f"--out: {_truncated(out)} cannot be created: {reason(error)}; choose another folder")


def _truncated(path: Path) -> str:
    """Return a path, truncated if too long."""
    text = str(path)
    return text if len(text) <= 200 else f"{text[:200]}…"
