"""Decorator for this package's numba kernels, which imports numba on the first call of a kernel.

numba checks only a kernel's own file, not the files of kernels that it calls and inlines: after a change
there it would run outdated code, and a run would have an outdated digest. The cache is therefore keyed by the
content of all sources that a kernel imports.
"""

import hashlib
import importlib
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache as remembered
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])
_HERE: Final = Path(__file__).parent
_COMPILED: Final = re.compile(r"import (?:\(\s*)?(?:njit|kernel)\b|(?:from|import) numba\b")
_IMPORTED: Final = re.compile(r"(?:from|import) (actors[\w.]*)(?: import (\([^)]*\)|.*))?")
_ALWAYS: Final = ("actors.portable.extensions", "actors.kernel_dispatchers")
"""Modules on which all kernels depend without an import: numba extensions, and the cache's format."""
_STATES: Final = "states"
"""File in the cache with the states of all modules, and the key of their files."""
_KEPT: Final = 2
"""Source states kept per module: the current and the previous one, in case the sources are reverted."""


class Kernel:
    """A kernel that has not been called from Python yet.

    Its first call replaces it by its dispatcher in the global names of all modules.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self.function, self.options = function, options
        self.call: Callable[..., Any] = self
        """Calls the kernel; for code that keeps it elsewhere than in a global name, such as a closure."""

    @cached_property
    def dispatcher(self) -> Any:
        """The dispatcher of numba."""
        return load_numba().dispatcher(self)

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel."""
        if self.call is self:
            self.call = self.dispatcher
            for names, name in _names_of(self):
                names[name] = self.call
        return self.call(*arguments)


def njit(**options: Any) -> Any:
    """Return a decorator as `numba.njit`; results are cached by the content of the sources."""
    return lambda function: Kernel(function, options)


_searched: Final[set[str]] = set()
"""Modules whose global names have been searched for kernels."""
_found: Final[dict[Kernel, list[tuple[dict[str, Any], str]]]] = {}
"""Global names of each kernel: the dictionary of the module and the name."""


def _names_of(kernel: Kernel) -> list[tuple[dict[str, Any], str]]:
    """Return the global names in which this kernel has to be replaced."""
    for module in sys.modules.keys() - _searched:
        names = getattr(sys.modules[module], "__dict__", {})
        for name, value in names.items():
            if type(value) is Kernel:
                _found.setdefault(value, []).append((names, name))
    _searched.update(sys.modules)
    return _found.pop(kernel, [])


@remembered
def load_numba() -> Any:
    """Import and return the module that needs numba."""
    with hidden_scipy():
        return importlib.import_module("actors.kernel_dispatchers")


@contextmanager
def hidden_scipy() -> Iterator[None]:
    """Let numba import no SciPy, which it does where SciPy is installed, for linear algebra in kernels."""
    hidden = "scipy" not in sys.modules
    if hidden:
        sys.modules["scipy"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules["scipy"]


def kernel(function: F) -> F:
    """Compile a function with `njit`, cached, keeping its type for type checkers."""
    return cast(F, njit()(function))


def cache_folder() -> Path:
    """Return the preferred folder for compiled kernels: NUMBA_CACHE_DIR, else beside the sources."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    return Path(named) if named else _HERE / "__pycache__" / "kernels"


def kernel_sources() -> tuple[Path, ...]:
    """Return every file with kernels, and the files of this package that those import, recursively."""
    named = _named()
    found = {one for source in named.values() if _has_kernels(source) for one in imported_sources(source)}
    return tuple(sorted(found))


@remembered
def imported_sources(source: Path) -> tuple[Path, ...]:
    """Return a kernel file and all files of this package that it imports, recursively, sorted."""
    named, found = _named(), {source}
    todo = [source]
    while todo:
        for package, names in _IMPORTED.findall(_text(todo.pop())):
            for name in (*_ALWAYS, package, *(f"{package}.{one}" for one in re.findall(r"\w+", names))):
                other = named.get(name)
                if other is not None and other not in found:
                    found.add(other)
                    todo.append(other)
    return tuple(sorted(found))


def module_state(module: str) -> str | None:
    """Return the hash of a module and all that it imports; None: not a module of this package.

    The name "" stands for all kernel sources.
    """
    return _states().get(module)


@remembered
def _states() -> dict[str, str]:
    """Return the states by module; saved, because searching all sources takes half a second."""
    hashed, path = hashlib.sha256(version("numba").encode()), cache_folder() / _STATES
    for source in _named().values():
        found = source.stat()
        hashed.update(f"{source} {found.st_size} {found.st_mtime_ns} {found.st_ctime_ns}\n".encode())
    key, states = hashed.hexdigest(), {}
    with suppress(OSError, ValueError):
        states = json.loads(path.read_text())
    if states.get("key") != key:
        states = {module: source_hash(imported_sources(source)) for module, source in _named().items()}
        states |= {"": source_hash(kernel_sources()), "key": key}
        write_file(path, json.dumps(states).encode())
    return cast(dict[str, str], states)


def write_file(path: Path, content: bytes) -> bool:
    """Write a file of the cache atomically; return False if that is impossible."""
    import tempfile  # noqa: PLC0415

    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            try:
                file.write(content)
                file.flush()
                Path(file.name).chmod(0o644)
                Path(file.name).replace(path)
            except OSError:
                Path(file.name).unlink(missing_ok=True)
                raise
        return True
    return False


@remembered
def source_hash(sources: tuple[Path, ...]) -> str:
    """Return a hash of these files and numba's version."""
    hashed = hashlib.sha256(version("numba").encode())
    for source in sources:
        hashed.update(_text(source).encode())
    return hashed.hexdigest()[:16]


def prune_cache() -> None:
    """Remove kernels of outdated source states; a process that still needs one compiles it again."""
    states: dict[str, list[tuple[float, Path]]] = {}
    with suppress(OSError):
        for folder in cache_folder().iterdir():
            if folder.is_dir() and re.fullmatch(r"actors[\w.]*-[0-9a-f]{16}", folder.name):
                module = folder.name.rpartition("-")[0]
                with suppress(OSError):  # removed by another process
                    states.setdefault(module, []).append((folder.stat().st_mtime, folder))
    for module, found in states.items():
        now = f"{module}-{module_state(module)}"
        old = [folder for _, folder in sorted(found, reverse=True) if folder.name != now]
        for folder in old[_KEPT - 1 :]:
            shutil.rmtree(folder, ignore_errors=True)


@remembered
def _named() -> dict[str, Path]:
    return {module_name(source): source for source in sorted(_HERE.rglob("*.py"))}


@remembered
def _text(source: Path) -> str:
    return source.read_text(encoding="utf-8")


def _has_kernels(source: Path) -> bool:
    return _COMPILED.search(_text(source)) is not None


def module_name(source: Path) -> str:
    """Return the dotted name of a source file of this package."""
    *folders, name = source.relative_to(_HERE.parent).with_suffix("").parts
    return ".".join(folders if name == "__init__" else (*folders, name))
