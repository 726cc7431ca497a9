"""Whose code runs: what is installed, what the command line names, and nothing else without the user's trust.

A scenario, a study, a fleet or a recording names a strategy's module, and may have come from anybody. Where
it says that the module lies is a hint for the user, and no reason to load it from there.
"""

import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Final

from actors.installation.repository import PACKAGES, REPOSITORY
from actors.installation.usage import OptionError
from actors.robot.behaviour import handover
from actors.robot.behaviour.loading import located, own_spec, prefixes
from actors.runtime.errors import AcrcError


@dataclass(frozen=True)
class Permit:
    """What a command line says of code that is not installed."""

    modules: tuple[Path, ...] = ()
    """Folders that it may be loaded from."""
    typed: str = ""
    """An entry that the command line itself names: its module may lie where the user stands."""
    trust: bool = False
    """It may also be loaded from where a file says that it lies, and need not be as it was recorded."""


_IGNORED: Final = "; ./acrc ignores PYTHONPATH" if os.environ.get("ACRC_IGNORED_PYTHONPATH") else ""
INSTALLED: Final = Permit()
"""Nothing but what is installed."""


def permit_of(modules: Sequence[Path] | None, *, trust: bool = False, typed: str = "") -> Permit:
    """What the options say. Raises OptionError."""
    for folder in modules or ():
        if not folder.is_dir():
            raise OptionError(f"--modules: {folder} is no folder; must be one with modules")
    return Permit(tuple(folder.resolve() for folder in modules or ()), typed, trust)


def admitted(source: Path, entry: str, hints: Sequence[Path], permit: Permit) -> tuple[Path, ...]:
    """The folders in which an entry's modules may be looked for, behind what is installed; none if all are.

    `source` is the file that names it, `hints` are the folders that it says they lie in. Nothing is imported.
    Raises AcrcError for what the permit does not cover, and for what is not here.
    """
    typed = handover.names(permit.typed) if permit.typed else ()
    used: list[Path] = []
    for name in handover.names(entry):
        module = name.partition(":")[0]
        if is_installed(module) or _is_taken(module):
            _check_name(source, name, permit)
            continue
        own = (Path.cwd().resolve(),) if name in typed else ()
        known = tuple(Path(os.path.realpath(folder)) for folder in hints if "\0" not in str(folder))
        named = (*permit.modules, *own, *(known if permit.trust else ()))
        folder = _holder(module, named)
        if folder is None:
            _refuse(source, name, module, (*known, Path.cwd()))
        else:
            used.append(folder)
    return tuple(dict.fromkeys(used))


def is_installed(module: str) -> bool:
    """Whether Python itself finds every part of a module, in its library, what is installed or this project.

    What merely lies beside this project's packages is none of it, although it may lie on Python's path.
    """
    names = prefixes(module)
    spec = own_spec(names[0]) or PathFinder.find_spec(names[0]) if names else None
    if spec is None or not _is_home(spec):
        return False
    for name in names[1:]:
        spec = PathFinder.find_spec(name, list(spec.submodule_search_locations or ()))
        if spec is None:
            return False
    return spec.origin is not None


def _is_home(spec: ModuleSpec) -> bool:
    """False for what lies in this repository and is not its code, and for a folder that is not installed."""
    if spec.loader is None:  # a folder without `__init__.py`
        places = [Path(one) for one in spec.submodule_search_locations or ()]
        return all(one.is_relative_to(sys.prefix) or one.is_relative_to(sys.base_prefix) for one in places)
    if not spec.has_location:
        return True  # built into Python
    place = Path(spec.origin or "").absolute()
    home = place.parent.parent if spec.submodule_search_locations else place.parent
    return home.resolve() != REPOSITORY or REPOSITORY.is_relative_to(sys.prefix) or spec.name in PACKAGES


def _is_taken(module: str) -> bool:
    """Whether what is installed has the name of the package, which no folder can have beside it."""
    names = prefixes(module)
    spec = own_spec(names[0]) if names else None
    return spec is not None and _is_home(spec)


def _check_name(source: Path, name: str, permit: Permit) -> None:
    """Raise AcrcError where the user means a module of his own, or what is installed has no such."""
    module = name.partition(":")[0]
    top = module.partition(".")[0]
    spec = own_spec(top)
    there = None if spec is None or not spec.has_location else Path(spec.origin or "").resolve()
    for folder in permit.modules:
        own = located(top, folder) if top == module else None
        if own is not None and own.suffix == ".py" and own.resolve() != there:
            raise AcrcError(
                f"{source} names the strategy {name}, but {own} has the name of what is installed, {top!r}; "
                "a module of your own must have a name of its own"
            )
    if not is_installed(module):
        raise AcrcError(
            f"{source} names the strategy {name}, but {top!r} is an installed package without such a module; "
            f"if {top}/ is your own folder, rename it"
        )


def _holder(module: str, folders: Sequence[Path]) -> Path | None:
    return next((folder for folder in folders if located(module, folder) is not None), None)


def _refuse(source: Path, name: str, module: str, folders: Sequence[Path]) -> None:
    """Say where it lies, if it does."""
    folder = _holder(module, folders)
    if folder is None:
        where = " and ".join(map(str, dict.fromkeys(folders)))
        raise AcrcError(
            f"{source} names the strategy {name}, and there is no module {module!r} here, nor in {where}; "
            "must be installed or lie in a folder that --modules DIR names" + _IGNORED
        )
    word = "." if folder == Path.cwd() else shlex.quote(str(folder))
    raise AcrcError(
        f"{source} names the strategy {name}, whose code {located(module, folder)} is neither installed nor "
        f"in a folder that you have named; read it, then say --modules {word}, or --trust"
    )
