"""Where a robot sees its own folder and its code: under names that tell nothing of run and scenario."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime.isolation import mounts
from actors.runtime.isolation.sandbox import Confinement, code_entries, file_view, unseen

NAMES: Final = "names.json"
"""File in the folder of a run with a strategy of the user's own."""


class StrategyFolders(msgspec.Struct, frozen=True):
    """What isolated robots saw under other names; absolute paths, as they were then."""

    out: str
    """The run's folder; a robot's own lies in it."""
    code: tuple[str, ...] = ()
    """The folders that a strategy was looked for in."""


FOLDER: Final = Path("/robot")
"""The robot's own folder of the run."""
CODE: Final = Path("/code")
"""Of the folders that its strategy is looked for in, the first is seen as /code/1, the next as /code/2, …"""
RECORDING: Final = 3
"""The descriptor at which such a robot finds its recording open."""


@dataclass(frozen=True)
class Names:
    """What is called otherwise outside; absolute paths."""

    folder: str
    """The robot's own folder of the run; its part `own` can be written to."""
    record: str
    """The new file of its recording."""
    code: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    """What is not seen although it lies beside the code: the run's folder, the scenario."""


def own_folder(folder: Path) -> Path:
    """In the folder of an actor, the part that it may write to, and that no other process writes to or reads.

    What others rely on lies beside it: recordings and logs, which the actor keeps open and cannot replace.
    """
    return folder / "own"


def code(count: int) -> tuple[Path, ...]:
    """Where so many folders with code are seen."""
    return tuple(CODE / str(number) for number in range(1, count + 1))


def outside(text: str, names: Names) -> str:
    """What a robot said, with its paths as they are called outside."""
    for seen, path in ((FOLDER, names.folder), *zip(code(len(names.code)), names.code, strict=True)):
        text = text.replace(f"{seen}/", f"{path}/")
    return text


def view(names: Names) -> mounts.FileView:
    """The file tree of such a robot."""
    folder = Path(names.folder)
    own, hidden = own_folder(folder), (*map(Path, names.hidden), folder.parent)
    plain = file_view(Confinement(own=own, hidden=hidden))
    not_seen = unseen(hidden)
    entries = {
        seen / found.relative_to(path): found
        for seen, path in zip(code(len(names.code)), map(Path, names.code), strict=True)
        for found in code_entries(path, not_seen)
    }
    sealed = [path for path in plain.sealed if path not in hidden]
    return plain._replace(sealed=sealed, home=own_folder(FOLDER), renamed={FOLDER: folder, **entries})
