"""Somebody else's code: named to the user before it runs, and not run without a word of his."""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path

from actors.robot.behaviour import succession
from actors.runtime.errors import AcrcError
from deploy.repository import REPOSITORY
from deploy.scenario.tables import Scenario


class ForeignCodeError(AcrcError):
    """Somebody else's code that the user has not said he trusts."""


class MissingCodeError(AcrcError):
    """Somebody's code that is not here."""


def refuse_missing(source: Path, entry: str, folders: Sequence[Path]) -> None:
    """Raise MissingCodeError if `entry` is to be found neither in `folders` nor on Python's path.

    `source` is the file that names it. Nothing is imported.
    """
    for name in succession.names(entry):
        top = name.partition(":")[0].partition(".")[0]
        if top and found(name, folders) is None and find_spec(top) is None:
            where = ", ".join(map(str, dict.fromkeys(folders)))
            raise MissingCodeError(
                f"{source} runs {name}, and there is no module {top!r} here; must be in one of {where} or on "
                "Python's path"
            )


def refuse_foreign(source: Path, entry: str, folders: Sequence[Path]) -> None:
    """Raise ForeignCodeError if `entry` (module:function), looked for in `folders` first, is somebody's code.

    That is code found neither in this project nor among what is installed nor below the working directory.
    `source` is the file that names it. Nothing is imported.
    """
    for name in succession.names(entry):
        file = found(name, folders)
        if file is None or any(file.is_relative_to(home) for home in _homes()):
            continue
        raise ForeignCodeError(
            f"{source} runs code from {file}, which is neither this project's nor installed nor below the "
            "folder where you stand; read it, and say --trust if it may run"
        )


def found(entry: str, folders: Sequence[Path]) -> Path | None:
    """The file or folder that an entry's top-level module would come from; None if there is none."""
    spec = _spec(entry, [*map(str, folders), *sys.path])
    if spec is None:
        return None
    places = list(spec.submodule_search_locations or ())
    origin = spec.origin if spec.has_location else (places[0] if places else None)
    return None if origin is None else Path(origin).resolve()


def beside(scenario: Scenario) -> tuple[Path, ...]:
    """Where a strategy of one's own may lie: beside the scenario, and where one stands."""
    own = (Path(scenario.run.modules),) if scenario.run.modules else ()
    return tuple(dict.fromkeys((*own, Path.cwd())))


def folder_of(entry: str, folders: Sequence[Path]) -> Path | None:
    """The first of the folders in which the top-level module of an entry, or of one in it, lies."""
    names = succession.names(entry)
    return next((path for path in folders if any(_spec(name, [str(path)]) for name in names)), None)


def _spec(entry: str, folders: Sequence[str]) -> ModuleSpec | None:
    """Where the top-level module of an entry is, without importing it."""
    name = entry.partition(":")[0].partition(".")[0]
    sound = [folder for folder in folders if "\0" not in folder]
    return PathFinder.find_spec(name, sound) if name else None


def _homes() -> list[Path]:
    installed = {sys.prefix, sys.base_prefix, *(path for path in sys.path if path)}
    return [Path.cwd().resolve(), REPOSITORY.resolve(), *(Path(path).resolve() for path in installed)]
