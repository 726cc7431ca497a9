"""A folder for what is needed for a moment only, beside the system's other temporary files."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from actors.runtime.errors import AcrcError

_PROBE_BYTES: Final = 65536


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder that is removed at the end; its path without links.

    Raises AcrcError, with the folder's place, where what fails inside fails because nothing can be written
    there any more.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="acrc-")
    except OSError as error:
        raise _full(os.environ.get("TMPDIR", "/tmp"), reason(error)) from error
    with made as name:
        folder = Path(name).resolve()
        try:
            yield folder
        except (OSError, AcrcError) as error:
            why = write_fault(folder)
            if why is None:
                raise
            fault = _full(folder.parent, why)
            refused = isinstance(error, OSError) or isinstance(error.__cause__, OSError)
            raise (fault if refused else AcrcError(f"{error}; {fault}")) from error


def write_fault(folder: Path) -> str | None:
    """Why nothing can be written there, found out by trying; None if something can, or there is no folder."""
    if not folder.is_dir():
        return None
    probe = folder / f".probe-{os.getpid()}"
    try:
        with probe.open("xb") as file:
            file.write(bytes(_PROBE_BYTES))
    except OSError as error:
        return reason(error)
    finally:
        with suppress(OSError):
            probe.unlink()
    return None


def reason(error: OSError) -> str:
    """What the system says, to go on after a colon."""
    return (error.strerror or str(error)).lower()


def _full(where: object, why: str) -> AcrcError:
    return AcrcError(
        f"{where}: temporary files cannot be written: {why}; make room there, or set TMPDIR to another folder"
    )
