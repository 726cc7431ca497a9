"""Recording files of a run, and their first records."""

import os
import re
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import msgspec

from acrc_testbed.results.seal import fetch_sentence, remote_recordings
from actors.orders import Order
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import NAMES, StrategyFolders
from actors.runtime.process import RunNote
from actors.runtime.recording import RecordingError, decode_note, read_notes

_RESTART: Final = re.compile(r"\.[0-9]{1,9}")


def recordings(out: Path) -> dict[str, Path]:
    """Return the local recordings of a run by actor, in order of creation.

    Those of a restarted robot are named `r2.1`, `r2.2`, …. Raises RecordingError if there is none, or for one
    with an unexpected name.
    """
    found: dict[str, Path] = {}
    # by folder, then by restart number
    for path in sorted(out.glob("*/*.mcap"), key=lambda path: (path.parent.name, len(path.stem), path.stem)):
        actor, folder = path.stem, path.parent
        if folder.is_symlink():
            raise RecordingError(f"{folder}: is a symbolic link; a run's folders must not be links")
        if actor != folder.name and not _RESTART.fullmatch(actor.removeprefix(folder.name)):
            raise RecordingError(
                f"{path}: unexpected recording; this folder may contain {folder.name}.mcap, and "
                f"{folder.name}.1.mcap of a restarted process"
            )
        if actor in found:
            raise RecordingError(f"{found[actor]} and {path}: two recordings of {actor}")
        found[actor] = path
    if not found:
        raise RecordingError(
            f"{out}: {'not a run folder: it contains no */*.mcap' if out.exists() else 'does not exist'}"
        )
    return found


def all_recordings(out: Path) -> dict[str, Path]:
    """Return all recordings of a run. Raises RecordingError also if some are still on other hosts."""
    if left := remote_recordings(out):
        raise RecordingError(fetch_sentence(out, left))
    return recordings(out)


class RecordedOrder(NamedTuple):
    """An order of an operator, a tool or the scenario."""

    step: int
    """Step at whose start it was executed."""
    order: Order


S = TypeVar("S", bound=msgspec.Struct)
_MAX_NAMES: Final = 100_000
"""Limit of the file with code folders, bytes."""


def read_run_note(path: Path) -> RunNote:
    """Return the first record of a recording. Raises RecordingError if there is none."""
    notes = read_notes(path)
    if "run" not in notes:
        raise RecordingError(f"{path}: ends before its first record")
    return decode_note(path, "run", notes["run"], RunNote)


def read_setup(path: Path, kind: type[S], actor: str) -> S:
    """Return the set-up of a recorded process; `actor`: the expected kind for errors, such as "a robot".

    Paths are relative to the recording's folder. Raises RecordingError.
    """
    return decode_setup(path, read_run_note(path), kind, actor)


def decode_setup(path: Path, run: RunNote, kind: type[S], actor: str) -> S:
    """Decode the set-up in a first record; see `read_setup`."""
    try:
        return typed_json.decode(run.setup, kind)
    except (ValueError, AcrcError) as error:
        raise RecordingError(
            f"{path}: the first record is not the set-up of {actor}: {str(error)[:300]}"
        ) from None


def code_folders(out: Path) -> tuple[Path, ...]:
    """Return the recorded code folders of a run's strategy. Raises RecordingError."""
    file = out / NAMES
    if not file.is_file() or file.is_symlink():
        return ()
    try:
        real = typed_json.decode(regular_file.read_bytes(file, _MAX_NAMES), StrategyFolders)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{file}: {error}") from None
    return tuple(_folder(Path(code), Path(real.out), out.resolve()) for code in real.code if "\0" not in code)


def _folder(code: Path, then: Path, now: Path) -> Path:
    """Return the original folder if it exists, else its location relative to the run's folder."""
    return code if code.is_dir() else Path(os.path.normpath(now / os.path.relpath(code, then)))
