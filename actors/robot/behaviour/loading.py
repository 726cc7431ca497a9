"""Loading of a user's strategy: modules in folders that the command line names, and the entry function."""

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import FileFinder, ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, NamedTuple, cast

from actors.robot.behaviour.ports import Behaviour, Start
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note
from deeco import DeecoError

_LARGEST: Final = 16_000_000
"""Bytes of a module."""


class RecordedModules(NamedTuple):
    """The modules that a run loaded from such folders."""

    hashes: Mapping[str, str]
    """Sha256 by the file's place in its folder."""
    whole: bool = True
    """False: it did not end as planned, and may have loaded more."""


class _Source(SourceFileLoader):
    """Compiles the bytes that it has hashed, and looks at no bytecode beside them."""

    def get_code(self, fullname: str) -> CodeType:
        file = self.get_filename(fullname)
        data = self.get_data(file)
        FOLDERS.take(file, data)
        return self.source_to_code(data, file)

    def get_data(self, path: str) -> bytes:
        return regular_file.content(Path(path), _LARGEST)


class _Folders(MetaPathFinder):
    """Where modules are looked for behind Python's own path, and what was found there."""

    def __init__(self) -> None:
        self.folders: tuple[Path, ...] = ()
        self.any_content = False
        self.expected: RecordedModules | None = None
        self._roots: dict[str, Path] = {}
        """The folder of each module that was found, by its name."""
        self._taken: dict[str, str] = {}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Where a module is; of a package that lies in a folder every part is found here, or nowhere."""
        parent = fullname.rpartition(".")[0]
        if path is None:
            found = None if own_spec(fullname) is not None else _spec(fullname, self.folders)
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

    def take(self, file: str, data: bytes) -> None:
        """Note what is loaded from a file. Raises AcrcError if the recorded run had something else."""
        root = self._root(Path(file))
        name = file if root is None else Path(file).relative_to(root).as_posix()
        now = hashlib.sha256(data).hexdigest()
        if self.expected is not None and not self.any_content:
            then = self.expected.hashes.get(name)
            if then is None and self.expected.whole:
                raise AcrcError(
                    f"{file}: the recorded run has loaded no such file; --trust loads it all the same"
                )
            if then is not None and now != then:
                raise AcrcError(
                    f"{file}: is not what the recorded run has loaded: sha256 {now[:12]}, recorded "
                    f"{then[:12]}; --trust loads it all the same"
                )
        self._taken[file] = now

    def hashes(self) -> dict[str, str]:
        """What was loaded from the folders so far, as in `RecordedModules`."""
        return {
            Path(file).relative_to(root).as_posix(): sha256
            for file, sha256 in sorted(self._taken.items())
            if (root := self._root(Path(file))) is not None
        }

    def _root(self, place: Path) -> Path | None:
        return next((folder for folder in self.folders if place.is_relative_to(folder)), None)


FOLDERS: Final = _Folders()


def look_in(folders: Sequence[Path], *, any_content: bool = False) -> None:
    """Let Python find modules in these folders, too, the first one first, and in none that were named before.

    `any_content`: whatever is expected, also modules that were not recorded so.
    """
    FOLDERS.any_content = any_content
    FOLDERS.folders = tuple(dict.fromkeys(folder.absolute() for folder in folders))
    if FOLDERS not in sys.meta_path:
        sys.meta_path.insert(0, FOLDERS)  # before what would load bytecode from a package that lies there


def expect(recorded: RecordedModules | None) -> None:
    """From here on a module in the folders must be as it was recorded; None: as it is."""
    FOLDERS.expected = recorded


def located(module: str, folder: Path) -> Path | None:
    """The file that a module would be loaded from, a folder for a namespace; None if it is not in `folder`.

    Of a package whose part is not there: the package's. Nothing is imported. Raises AcrcError where a link
    leads out of the folder.
    """
    folder, found = folder.absolute(), None
    search = [folder]
    for name in prefixes(module):
        spec = _spec(name, search)
        if spec is None:
            break
        found = _place(spec)
        _check_link(found, folder)
        search = [Path(one) for one in spec.submodule_search_locations or ()]
    return found


def is_name(module: str) -> bool:
    """True for names with dots between them; nothing else leads to a module."""
    return all(part.isidentifier() for part in module.split("."))


def own_spec(module: str) -> ModuleSpec | None:
    """What Python itself finds for a module of no package; a folder without `__init__.py` is nothing."""
    finders = (finder for finder in sys.meta_path if finder is not FOLDERS)
    found = (finder.find_spec(module, None) for finder in finders if hasattr(finder, "find_spec"))
    return next((spec for spec in found if spec is not None and spec.loader is not None), None)


def prefixes(module: str) -> list[str]:
    """`a`, `a.b`, `a.b.c` of `a.b.c`; none of what is no name of a module."""
    parts = module.split(".") if is_name(module) else []
    return [".".join(parts[: count + 1]) for count in range(len(parts))]


def _spec(name: str, folders: Sequence[Path]) -> ModuleSpec | None:
    """Of a source file or a package, or else of a folder without `__init__.py`."""
    finders = (FileFinder(str(folder), (_Source, [".py"])) for folder in folders if "\0" not in str(folder))
    found = [spec for finder in finders if (spec := finder.find_spec(name)) is not None]
    return next((spec for spec in found if spec.loader is not None), found[0] if found else None)


def _place(spec: ModuleSpec) -> Path:
    return Path(spec.origin or next(iter(spec.submodule_search_locations or ())))


def _check_link(place: Path, folder: Path) -> None:
    real, home = place.resolve(), folder.resolve()
    if not real.is_relative_to(home):
        raise AcrcError(f"{place}: leads to {real}; code in {home} must lie there itself")


class BehaviourError(AcrcError):
    """A behaviour that cannot be used, or that asks for something impossible."""


def load_behaviour(entry: str, start: Start) -> Behaviour:
    """The behaviour that the function `entry` makes for a robot.

    Raises BehaviourError if there is no such function or if what it gives is no behaviour. An error inside
    of the user's module or function is his own and is passed on.
    """
    function = entry_function(entry)
    try:
        made = function(start)
    except DeecoError as error:
        raise BehaviourError(f"behaviour {entry!r}: {error}") from error
    except SystemExit as error:
        raise BehaviourError(f"behaviour {entry!r}: {failure_note('', 0, error).cause}") from None
    if not callable(getattr(made, "advance", None)):
        raise BehaviourError(
            f"behaviour {entry!r} gives a {type(made).__name__}, which has no method advance(view, until)"
        )
    return cast(Behaviour, made)


def entry_function(entry: str) -> Callable[[Start], Any]:
    """The function that the entry string names."""
    module_name, colon, name = entry.partition(":")
    if not (colon and is_name(module_name) and name):
        raise BehaviourError(
            f"behaviour {entry!r} is no entry; it should look like 'package.module:function'"
        )
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        missing = error.name or module_name
        if module_name != missing and not module_name.startswith(f"{missing}."):
            if _is_installed(missing):
                raise  # the module is there, and imports a part of a package that the package has not
            raise BehaviourError(
                f"behaviour {entry!r}: {module_name} imports {missing!r}, which is not installed; "
                "`acrc add NAME` installs a package for good, by the name that pip knows it by"
            ) from None
        raise BehaviourError(
            f"behaviour {entry!r}: there is no module {missing!r} on Python's path"
        ) from None
    except DeecoError as error:
        raise BehaviourError(f"behaviour {entry!r}: {error}") from error
    except SyntaxError as error:  # the traceback would show the importer's lines, and not one of the user's
        line = (error.text or "").strip()
        raise BehaviourError(
            f"behaviour {entry!r}: {error.filename}:{error.lineno}: {error.msg}{line and f': {line}'}"
        ) from None
    except SystemExit as error:
        raise BehaviourError(f"behaviour {entry!r}: {failure_note('', 0, error).cause}") from None
    function = getattr(module, name, None)
    if function is None:
        raise BehaviourError(f"behaviour {entry!r}: module {module_name!r} has no {name!r}")
    if not callable(function):
        raise BehaviourError(
            f"behaviour {entry!r} is a {type(function).__name__}, but should be a function of a Start"
        )
    return cast(Callable[[Start], Any], function)


def _is_installed(module: str) -> bool:
    return importlib.util.find_spec(module.partition(".")[0]) is not None
