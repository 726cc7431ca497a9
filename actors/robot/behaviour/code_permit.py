"""Permission to run user code: installed code, folders named on the command line, or trusted files.

A scenario, study, fleet or recording that names a strategy's module may come from an untrusted source. The
folder that it names is only a hint for the user; modules are loaded from there with --trust only.
"""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from actors.installation.usage import OptionError
from actors.robot.behaviour import handover
from actors.runtime.errors import AcrcError
from actors.user_code import (
    is_home,
    is_installed,
    module_file,
    module_prefixes,
    python_spec,
    set_task_folders,
)


class Permit(msgspec.Struct, frozen=True):
    """Permission of a command line to load code that is not installed."""

    modules: tuple[Path, ...] = ()
    """Folders from which modules may be loaded."""
    typed: str = ""
    """Entry given on the command line: its module may be in the working directory."""
    trust: bool = False
    """Also load modules from folders that a file names, and ignore recorded checksums."""


_IGNORED: Final = "; ./acrc ignores PYTHONPATH" if os.environ.get("ACRC_IGNORED_PYTHONPATH") else ""
INSTALLED: Final = Permit()
"""Permission for installed code only."""


def permit_of(modules: Sequence[Path] | None, *, trust: bool = False, typed: str = "") -> Permit:
    """Return the permission given by the options; tasks may be loaded from these folders from now on.

    Raises OptionError.
    """
    for folder in modules or ():
        if not folder.is_dir():
            raise OptionError(f"--modules: {folder} is not a folder; give a folder of Python modules")
    folders = tuple(folder.resolve() for folder in modules or ())
    set_task_folders(folders)
    return Permit(folders, typed, trust)


def permitted_folders(
    source: Path, entry: str, hints: Sequence[Path], permit: Permit, kind: str = "strategy"
) -> tuple[Path, ...]:
    """Return the folders from which an entry's modules may be loaded; empty if all are installed.

    `source`: the file that names the entry of this `kind`; `hints`: the folders that this file names. Imports
    nothing.
    Raises AcrcError for a missing module and for one that `permit` does not cover.
    """
    typed = handover.names(permit.typed) if permit.typed else ()
    used: list[Path] = []
    for name in handover.names(entry):
        module = name.partition(":")[0]
        if is_installed(module) or _is_taken(module):
            _check_name(f"{source}: {kind} {name}", name, permit)
            continue
        own = (Path.cwd().resolve(),) if name in typed else ()
        known = tuple(Path(os.path.realpath(folder)) for folder in hints if "\0" not in str(folder))
        named = (*permit.modules, *own, *(known if permit.trust else ()))
        folder = _holder(module, named)
        if folder is None:
            _refuse(f"{source}: {kind} {name}", module, (*known, Path.cwd()))
        else:
            used.append(folder)
    return tuple(dict.fromkeys(used))


def _is_taken(module: str) -> bool:
    """Return True if an installed package has the module's top-level name."""
    names = module_prefixes(module)
    spec = python_spec(names[0]) if names else None
    return spec is not None and is_home(spec)


def _check_name(where: str, name: str, permit: Permit) -> None:
    """Raise AcrcError if a user's module has the name of an installed one, or a submodule is missing."""
    module = name.partition(":")[0]
    top = module.partition(".")[0]
    spec = python_spec(top)
    there = None if spec is None or not spec.has_location else Path(spec.origin or "").resolve()
    for folder in permit.modules:
        own = module_file(top, folder) if top == module else None
        if own is not None and own.suffix == ".py" and own.resolve() != there:
            raise AcrcError(
                f"{where}: {own} has the name of the installed module {top!r}; rename your module"
            )
    if not is_installed(module):
        raise AcrcError(
            f"{where}: {top!r} is an installed package without such a module; "
            f"if {top}/ is your own folder, rename it"
        )


def _holder(module: str, folders: Sequence[Path]) -> Path | None:
    return next((folder for folder in folders if module_file(module, folder) is not None), None)


def _refuse(where: str, module: str, folders: Sequence[Path]) -> None:
    """Raise AcrcError for a missing or untrusted module, with the folder that contains it."""
    folder = _holder(module, folders)
    if folder is None:
        places = " and ".join(map(str, dict.fromkeys(folders)))
        raise AcrcError(
            f"{where}: there is no module {module!r} here or in {places}; "
            "install it, or name its folder with --modules DIR" + _IGNORED
        )
    word = "." if folder == Path.cwd() else shlex.quote(str(folder))
    raise AcrcError(
        f"{where}: its code {module_file(module, folder)} is neither installed "
        f"nor in a permitted folder; read it, then add --modules {word}, or --trust"
    )
