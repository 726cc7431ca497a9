"""The recordings of a run: which files there are, and whose."""

import re
from pathlib import Path
from typing import Final

from actors.runtime.recording import RecordingError
from observation.results.hosts_file import elsewhere, where

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
                f"{path}: no recording of a run: in this folder it would be called {folder.name}.mcap, or "
                f"{folder.name}.1.mcap for a process that was started again"
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
