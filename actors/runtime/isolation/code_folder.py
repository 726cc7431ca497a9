"""What a robot sees of a folder with the user's code: its entries as they are now, but no run of anybody."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

_DEPTH: Final = 3
"""So many folders deep runs are looked for; what appears later beside a run that was found is not seen."""


def entries(folder: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """Files and folders in `folder` that may be shown whole; `folder` itself if it is a file.

    Left out are what `hidden` names, names that begin with a dot, empty folders and every run's folder. A
    folder that holds such a thing is gone into.
    """
    if os.path.isfile(folder):  # noqa: PTH113 — Path.is_file raises where access is denied
        yield folder
    yield from _shown(folder, hidden, _DEPTH)


def is_run(folder: Path) -> bool:
    """True for a folder that a run writes to or has written to."""
    inside = [entry for entry in _listed(folder) if _is_folder(entry)]
    if (folder / "scenario.toml").is_file() and {"world", "laboratory"} & {entry.name for entry in inside}:
        return True
    return any(
        name.name.endswith(".mcap") or name.name == "setup.json" for one in inside for name in _listed(one)
    )


def _shown(folder: Path, hidden: Sequence[Path], depth: int) -> Iterator[Path]:
    for entry in sorted(_listed(folder), key=lambda entry: entry.name):
        path = folder / entry.name
        if entry.name.startswith(".") or path in hidden:
            continue
        if not _is_folder(entry):
            yield path
        elif not any(_listed(path)) or is_run(path):
            continue
        elif any(one.is_relative_to(path) for one in hidden) or _holds_run(path, depth - 1):
            yield from _shown(path, hidden, depth - 1)
        else:
            yield path


def _holds_run(folder: Path, depth: int) -> bool:
    if depth <= 0:
        return False
    inside = [folder / entry.name for entry in _listed(folder) if _is_folder(entry) and entry.name[0] != "."]
    return any(is_run(path) or _holds_run(path, depth - 1) for path in inside)


def _listed(folder: str | os.PathLike[str]) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return list(found)
    except OSError:  # closed to us, or gone
        return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False
