"""The recordings of a run: which files there are, and whose."""

import os
import re
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import msgspec

from acrc_testbed.results.seal import elsewhere, where
from actors.orders import Order
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import NAMES, StrategyFolders
from actors.runtime.process import RunNote
from actors.runtime.recording import RecordingError, decoded, read_notes

_RESTART: Final = re.compile(r"\.[0-9]{1,9}")


def recordings(out: Path) -> dict[str, Path]:
    """The recordings of a run by actor, as far as they are here, in the order in which they were made.

    A restarted robot's later ones are named `r2.1`, `r2.2`, …. Raises RecordingError if there is none, or one
    that is not where its process writes.
    """
    found: dict[str, Path] = {}
    for path in sorted(out.glob("*/*.mcap"), key=_place):
        actor, folder = path.stem, path.parent
        if folder.is_symlink():
            raise RecordingError(f"{folder}: a link, and a run's folders never are")
        if actor != folder.name and not _RESTART.fullmatch(actor.removeprefix(folder.name)):
            raise RecordingError(
                f"{path}: unexpected recording; this folder may contain {folder.name}.mcap, and "
                f"{folder.name}.1.mcap of a restarted process"
            )
        if actor in found:
            raise RecordingError(f"{found[actor]} and {path}: two recordings of {actor}")
        found[actor] = path
    if not found:
        raise RecordingError(f"{out}: no run's folder: there is no */*.mcap in it")
    return found


def all_recordings(out: Path) -> dict[str, Path]:
    """All recordings of a run. Raises RecordingError also where some are still on hosts."""
    if left := elsewhere(out):
        raise RecordingError(where(out, left))
    return recordings(out)


def _place(path: Path) -> tuple[str, int, str]:
    """Folders by name; in a folder by the number of the start."""
    return (path.parent.name, len(path.stem), path.stem)


class GivenOrder(NamedTuple):
    """An order of a person, a tool or the scenario."""

    step: int
    """At whose boundary it was taken."""
    order: Order


S = TypeVar("S", bound=msgspec.Struct)
_MOST_NAMES: Final = 100_000
"""Bytes of it."""


def run_of(path: Path) -> RunNote:
    """The first record of a recording. Raises RecordingError if there is none."""
    notes = read_notes(path)
    if "run" not in notes:
        raise RecordingError(f"{path}: ends before its first record")
    return decoded(path, "run", notes["run"], RunNote)


def setup_of(path: Path, kind: type[S], actor: str) -> S:
    """What was told to the process of a recording, which should be what is called `actor`: "a robot".

    Its files are called as they are seen from the recording's folder. Raises RecordingError.
    """
    return told(path, run_of(path), kind, actor)


def told(path: Path, run: RunNote, kind: type[S], actor: str) -> S:
    """As `setup_of`, of a first record that has been read."""
    try:
        return typed_json.decode(run.setup, kind)
    except (ValueError, AcrcError) as error:
        raise RecordingError(
            f"{path}: its first record holds no set-up of {actor}: {str(error)[:300]}"
        ) from None


def code_folders(out: Path) -> tuple[Path, ...]:
    """Where the code of the strategy of a run in the folder `out` is said to lie. Raises RecordingError."""
    file = out / NAMES
    if not file.is_file() or file.is_symlink():
        return ()
    try:
        real = typed_json.decode(regular_file.content(file, _MOST_NAMES), StrategyFolders)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{file}: {error}") from None
    return tuple(_folder(Path(code), Path(real.out), out.resolve()) for code in real.code if "\0" not in code)


def _folder(code: Path, then: Path, now: Path) -> Path:
    """A folder where it was, or else where it lies now as seen from the run's folder."""
    return code if code.is_dir() else Path(os.path.normpath(now / os.path.relpath(code, then)))
