"""Loading of user code: modules in additional folders, and objects named by an entry string."""

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import FileFinder, ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, NamedTuple

from actors.installation.repository import PACKAGES, REPOSITORY
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note

_LARGEST: Final = 16_000_000
"""Bytes of a module."""


class RecordedModules(NamedTuple):
    """Modules that a run loaded from additional folders."""

    hashes: Mapping[str, str]
    """SHA-256 by path relative to the folder."""
    whole: bool = True
    """False: the run ended early and may have loaded more."""


class _HashingLoader(SourceFileLoader):
    """Loader that compiles exactly the bytes that it has hashed and ignores cached bytecode."""

    def get_code(self, fullname: str) -> CodeType:
        file = self.get_filename(fullname)
        data = self.get_data(file)
        FINDER.record(file, data)
        return self.source_to_code(data, file)

    def get_data(self, path: str) -> bytes:
        return regular_file.read_bytes(Path(path), _LARGEST)


class _FolderFinder(MetaPathFinder):
    """Finder of modules in additional folders, searched after Python's path."""

    def __init__(self) -> None:
        self.folders: tuple[Path, ...] = ()
        self.task_folders: tuple[Path, ...] = ()
        """Folders of tasks, searched after `folders`."""
        self.any_content = False
        self.expected: RecordedModules | None = None
        self._roots: dict[str, Path] = {}
        """Folder of each module found, by module name."""
        self._taken: dict[str, str] = {}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a module's spec; all submodules of a package come from the package's folder."""
        parent = fullname.rpartition(".")[0]
        if path is None:
            found = (
                None
                if python_spec(fullname) is not None
                else _spec(fullname, (*self.folders, *self.task_folders))
            )
        elif parent not in self._roots:
            return None
        else:
            found = _spec(fullname, [Path(one) for one in path])
            if found is None:
                raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)
        if found is not None:
            place = _place(found)
            self._roots[fullname] = self._roots.get(parent) or self._root(place) or place.parent
            _check_link(place, self._roots[fullname])
        return found

    def record(self, file: str, data: bytes) -> None:
        """Record the hash of a loaded file. Raises AcrcError if it differs from the recorded run's."""
        root = self._root(Path(file))
        name = file if root is None else Path(file).relative_to(root).as_posix()
        now = hashlib.sha256(data).hexdigest()
        if self.expected is not None and not self.any_content:
            then = self.expected.hashes.get(name)
            if then is None and self.expected.whole:
                raise AcrcError(f"{file}: not loaded by the recorded run; --trust loads it anyway")
            if then is not None and now != then:
                raise AcrcError(
                    f"{file}: differs from the file of the recorded run: sha256 {now[:12]}, recorded "
                    f"{then[:12]}; --trust loads it anyway"
                )
        self._taken[file] = now

    def hashes(self) -> dict[str, str]:
        """Return the hashes of the files loaded so far, as in `RecordedModules`."""
        return {
            Path(file).relative_to(root).as_posix(): sha256
            for file, sha256 in sorted(self._taken.items())
            if (root := self._root(Path(file))) is not None
        }

    def _root(self, place: Path) -> Path | None:
        return next(
            (folder for folder in (*self.folders, *self.task_folders) if place.is_relative_to(folder)), None
        )


FINDER: Final = _FolderFinder()


def set_folders(folders: Sequence[Path], *, any_content: bool = False) -> None:
    """Search modules in these folders, in order, after Python's path; replaces previous folders.

    `any_content`: ignore recorded hashes.
    """
    FINDER.any_content = any_content
    FINDER.folders = tuple(dict.fromkeys(folder.absolute() for folder in folders))
    _install_finder()


def set_task_folders(folders: Sequence[Path]) -> None:
    """Also search modules in these folders, which the user has named on the command line."""
    FINDER.task_folders = tuple(dict.fromkeys(folder.absolute() for folder in folders))
    _install_finder()


def _install_finder() -> None:
    if FINDER not in sys.meta_path:
        sys.meta_path.insert(0, FINDER)  # before finders that would load bytecode from these folders


def expect_hashes(recorded: RecordedModules | None) -> None:
    """Require that modules match the recorded hashes from now on; None: accept all."""
    FINDER.expected = recorded


def module_file(module: str, folder: Path) -> Path | None:
    """Return the file of a module (a folder for a namespace); None if it is not in `folder`.

    If a submodule is missing, returns the package's file. Imports nothing. Raises AcrcError for a link that
    leads out of the folder.
    """
    folder, found = folder.absolute(), None
    search = [folder]
    for name in module_prefixes(module):
        spec = _spec(name, search)
        if spec is None:
            break
        found = _place(spec)
        _check_link(found, folder)
        search = [Path(one) for one in spec.submodule_search_locations or ()]
    return found


def is_module_name(module: str) -> bool:
    """Return True for identifiers separated by dots."""
    return all(part.isidentifier() for part in module.split("."))


def python_spec(module: str) -> ModuleSpec | None:
    """Return the spec of a top-level module on Python's path; None for a folder without `__init__.py`."""
    finders = (finder for finder in sys.meta_path if finder is not FINDER)
    found = (finder.find_spec(module, None) for finder in finders if hasattr(finder, "find_spec"))
    return next((spec for spec in found if spec is not None and spec.loader is not None), None)


def module_prefixes(module: str) -> list[str]:
    """Return `a`, `a.b`, `a.b.c` for `a.b.c`; empty for an invalid module name."""
    parts = module.split(".") if is_module_name(module) else []
    return [".".join(parts[: count + 1]) for count in range(len(parts))]


def _spec(name: str, folders: Sequence[Path]) -> ModuleSpec | None:
    """Return the spec of a source file or package, otherwise of a folder without `__init__.py`."""
    finders = (
        FileFinder(str(folder), (_HashingLoader, [".py"])) for folder in folders if "\0" not in str(folder)
    )
    found = [spec for finder in finders if (spec := finder.find_spec(name)) is not None]
    return next((spec for spec in found if spec.loader is not None), found[0] if found else None)


def _place(spec: ModuleSpec) -> Path:
    return Path(spec.origin or next(iter(spec.submodule_search_locations or ())))


def _check_link(place: Path, folder: Path) -> None:
    real, home = place.resolve(), folder.resolve()
    if not real.is_relative_to(home):
        raise AcrcError(f"{place}: links to {real}; copy the code into {home}")


def is_installed(module: str) -> bool:
    """Return True if a module is in the standard library, an installed package or this project.

    Other modules in this repository's folder do not count, although the folder may be on Python's path.
    """
    names = module_prefixes(module)
    spec = python_spec(names[0]) or PathFinder.find_spec(names[0]) if names else None
    if spec is None or not is_home(spec):
        return False
    for name in names[1:]:
        spec = PathFinder.find_spec(name, list(spec.submodule_search_locations or ()))
        if spec is None:
            return False
    return spec.origin is not None


def is_home(spec: ModuleSpec) -> bool:
    """Return False for a module of the repository's folder that is not its code, and for other folders."""
    if spec.loader is None:  # a folder without `__init__.py`
        places = [Path(one) for one in spec.submodule_search_locations or ()]
        return all(one.is_relative_to(sys.prefix) or one.is_relative_to(sys.base_prefix) for one in places)
    if not spec.has_location:
        return True  # built into Python
    place = Path(spec.origin or "").absolute()
    home = place.parent.parent if spec.submodule_search_locations else place.parent
    return home.resolve() != REPOSITORY or REPOSITORY.is_relative_to(sys.prefix) or spec.name in PACKAGES


def entry_object(entry: str, kind: str, error: type[AcrcError], example: str) -> Any:
    """Return the object of an entry string `module:name`. Raises `error`.

    `kind`: names it in errors, such as "behaviour"; `example`: a valid entry. Errors of the module are passed
    on.
    """
    module_name, colon, name = entry.partition(":")
    if not (colon and is_module_name(module_name) and name):
        raise error(f"{kind} {entry!r} is not an entry; it should look like 'package.{example}'")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as fault:
        missing = fault.name or module_name
        if module_name != missing and not module_name.startswith(f"{missing}."):
            if importlib.util.find_spec(missing.partition(".")[0]) is not None:
                raise  # the module exists, but imports a missing submodule of an installed package
            raise error(
                f"{kind} {entry!r}: {module_name} imports {missing!r}, which is not installed; "
                "`acrc add NAME` installs a package by its name on PyPI"
            ) from None
        raise error(f"{kind} {entry!r}: there is no module {missing!r} on Python's path") from None
    except SyntaxError as fault:  # its traceback would not show a line of the user's code
        raise error(
            f"{kind} {entry!r}: {str(fault.filename).rpartition('/')[2]}:{fault.lineno}: {fault.msg}"
            f"{': ' * bool(fault.text)}{(fault.text or '').strip()}"
        ) from None
    except SystemExit as fault:
        raise error(f"{kind} {entry!r}: {failure_note('', 0, fault).cause}") from None
    found = getattr(module, name, None)
    if found is None:
        did_you_mean = example.rpartition(":")[2]
        raise error(f"{kind} {entry!r}: module {module_name!r} has no {name!r}; did you mean {did_you_mean}?")
    return found
