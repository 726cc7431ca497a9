"""Decorator for this package's numba kernels, with a cache keyed by source content.

numba checks only a kernel's own file, not the files of kernels that it calls and inlines: after a change
there it would run outdated code, and a run would have an outdated digest. This cache is keyed by the content
of all sources that a kernel imports. It changes no global state of the process.
"""

import hashlib
import os
import pickle
import re
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache as remembered
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

F = TypeVar("F", bound=Callable[..., Any])
_HERE: Final = Path(__file__).parent
_COMPILED: Final = re.compile(r"import (?:\(\s*)?(?:njit|kernel)\b|(?:from|import) numba\b")
_IMPORTED: Final = re.compile(r"(?:from|import) (actors[\w.]*)(?: import (\([^)]*\)|.*))?")
_EXTENSIONS: Final = "actors.portable.compiled"
"""numba extensions for all kernels, whether imported or not."""
_PART: Final = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a kernel called by another kernel: no wrappers for Python and C, which unpack arguments."""
_KEPT: Final = 2
"""Source states kept per module: the current and the previous one, in case the sources are reverted."""


def njit(**options: Any) -> Any:
    """Return `numba.njit` for a function of this package; `cache=True` uses this module's cache.

    Entry points for Python and for kernels are compiled separately, each on its first call: most kernels are
    called by kernels only, and wrappers for Python take a tenth of the compile time.
    """
    cached = options.pop("cache", False)

    def decorated(function: Callable[..., Any]) -> Any:
        def compiled(kind: str, **more: bool) -> Any:
            kernel = numba.njit(**options, **more)(function)
            if cached:
                kernel._cache = _Cache(function, kind)
            return kernel

        @remembered  # created on first use: a kernel loaded from the cache needs none
        def part() -> Any:
            return compiled("part", **_PART)

        kernel = compiled("whole")
        kernel.get_call_template = lambda *asked: part().get_call_template(*asked)
        kernel.get_overload = lambda *asked: part().get_overload(*asked)
        return kernel

    return decorated


def kernel(function: F) -> F:
    """Compile a function with `njit`, cached, keeping its type for type checkers."""
    return cast(F, njit(cache=True)(function))


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
            for name in (_EXTENSIONS, package, *(f"{package}.{one}" for one in re.findall(r"\w+", names))):
                other = named.get(name)
                if other is not None and other not in found:
                    found.add(other)
                    todo.append(other)
    return tuple(sorted(found))


@remembered
def source_hash(sources: tuple[Path, ...]) -> str:
    """Return a hash of these files and numba's version."""
    hashed = hashlib.sha256(numba.__version__.encode())
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
        source = _named().get(module)
        now = "" if source is None else f"{module}-{source_hash(imported_sources(source))}"
        old = [folder for _, folder in sorted(found, reverse=True) if folder.name != now]
        for folder in old[_KEPT - 1 :]:
            shutil.rmtree(folder, ignore_errors=True)


class _Locator(_CacheLocator):  # type: ignore[misc]  # numba has no types
    """Names the cache entries of a function for numba, by the content of its sources."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        source = Path(file)
        self._py_file = file  # required by numba's warnings
        self._line = function.__code__.co_firstlineno
        self._state = f"{_module(source)}-{source_hash(imported_sources(source))}"

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        return cls(py_func, py_file)

    def ensure_cache_path(self) -> None:
        """Do nothing: the folder is created on the first write."""

    def get_cache_path(self) -> str:
        return self._state

    def get_source_stamp(self) -> str:
        return self._state

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Impl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _Cache(FunctionCache):  # type: ignore[misc]
    _impl_class = _Impl

    def __init__(self, function: Callable[..., Any], kind: str) -> None:
        super().__init__(function)
        base = f"{self._impl.locator.get_cache_path()}/{self._impl.filename_base}"
        self._cache_file = _Files(f"{base}.{kind}")


class _Files:
    """Cache of a kernel: one file per signature and processor, without an index that could be corrupted."""

    def __init__(self, base: str) -> None:
        self._base = base

    def load(self, key: object) -> Any:
        """Return the saved data from the first folder that has it; None: no folder has it."""
        for root in _roots():
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                return pickle.loads((root / self._name(key)).read_bytes())
        return None

    def save(self, key: object, data: object) -> None:
        """Save atomically in the first writable folder; without one, nothing is saved."""
        content = dumps(data)
        for root in _roots():
            path = root / self._name(key)
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
                return

    def _name(self, key: object) -> str:
        return f"{self._base}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"


def _roots() -> tuple[Path, Path]:
    return cache_folder(), Path(AppDirs(appname="acrc", appauthor=False).user_cache_dir, "kernels")


@remembered
def _named() -> dict[str, Path]:
    return {_module(source): source for source in sorted(_HERE.rglob("*.py"))}


@remembered
def _text(source: Path) -> str:
    return source.read_text(encoding="utf-8")


def _has_kernels(source: Path) -> bool:
    return _COMPILED.search(_text(source)) is not None


def _module(source: Path) -> str:
    *folders, name = source.relative_to(_HERE.parent).with_suffix("").parts
    return ".".join(folders if name == "__init__" else (*folders, name))
