"""numba's decorator for this package's kernels, and where compiled ones are kept.

numba itself looks at a kernel's own file only, not at those of the kernels that it calls and inlines: after a
change there it would go on with old code, and a run with an old digest. Here a kernel belongs to the state
of all sources that it can reach. Nothing of the process is changed for that.
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
_TAUGHT: Final = "actors.portable.compiled"
"""What numba is taught for all kernels, whoever imports it."""
_PART: Final = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""How a kernel is compiled for another one: without ways in from Python and C, which unpack arguments."""
_KEPT: Final = 2
"""States of one module that are kept: this one, and the last before it, to which one may go back."""


def njit(**options: Any) -> Any:
    """`numba.njit` for a function of this package; `cache=True` keeps what is compiled as said above.

    What Python calls and what kernels call is compiled separately, each once it is called: most are only
    called by kernels, and ways in from Python take a tenth of all compiling.
    """
    cached = options.pop("cache", False)

    def decorated(function: Callable[..., Any]) -> Any:
        def compiled(kind: str, **more: bool) -> Any:
            kernel = numba.njit(**options, **more)(function)
            if cached:
                kernel._cache = _Cache(function, kind)
            return kernel

        @remembered  # made for the first kernel that asks: a loaded one needs none
        def part() -> Any:
            return compiled("part", **_PART)

        kernel = compiled("whole")
        kernel.get_call_template = lambda *asked: part().get_call_template(*asked)
        kernel.get_overload = lambda *asked: part().get_overload(*asked)
        return kernel

    return decorated


def kernel(function: F) -> F:
    """Compile a function with `njit`, cached; type checkers see the function as it is written."""
    return cast(F, njit(cache=True)(function))


def cache_folder() -> Path:
    """Where compiled kernels are kept if possible: where numba is told to, else beside the sources."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    return Path(named) if named else _HERE / "__pycache__" / "kernels"


def kernel_sources() -> tuple[Path, ...]:
    """Every file with kernels, and whatever those import of this package, from one to the next."""
    named = _named()
    found = {one for source in named.values() if _has_kernels(source) for one in reachable(source)}
    return tuple(sorted(found))


@remembered
def reachable(source: Path) -> tuple[Path, ...]:
    """The files of this package that a kernel in this one is made of: it, and what it imports, sorted."""
    named, found = _named(), {source}
    todo = [source]
    while todo:
        for package, names in _IMPORTED.findall(_text(todo.pop())):
            for name in (_TAUGHT, package, *(f"{package}.{one}" for one in re.findall(r"\w+", names))):
                other = named.get(name)
                if other is not None and other not in found:
                    found.add(other)
                    todo.append(other)
    return tuple(sorted(found))


@remembered
def state(sources: tuple[Path, ...]) -> str:
    """A name for what these files hold, and for numba's release."""
    told = hashlib.sha256(numba.__version__.encode())
    for source in sources:
        told.update(_text(source).encode())
    return told.hexdigest()[:16]


def prune() -> None:
    """Remove kernels of states long gone; whoever still uses them compiles them again."""
    states: dict[str, list[tuple[float, Path]]] = {}
    with suppress(OSError):
        for folder in cache_folder().iterdir():
            if folder.is_dir() and re.fullmatch(r"actors[\w.]*-[0-9a-f]{16}", folder.name):
                module = folder.name.rpartition("-")[0]
                with suppress(OSError):  # another process prunes, too
                    states.setdefault(module, []).append((folder.stat().st_mtime, folder))
    for module, found in states.items():
        source = _named().get(module)
        now = "" if source is None else f"{module}-{state(reachable(source))}"
        old = [folder for _, folder in sorted(found, reverse=True) if folder.name != now]
        for folder in old[_KEPT - 1 :]:
            shutil.rmtree(folder, ignore_errors=True)


class _Locator(_CacheLocator):  # type: ignore[misc]  # of a library without types
    """Tells numba where a function's code is kept; it is found by the content of sources."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        source = Path(file)
        self._py_file = file  # numba's own name, for its warnings
        self._line = function.__code__.co_firstlineno
        self._state = f"{_module(source)}-{state(reachable(source))}"

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        return cls(py_func, py_file)

    def ensure_cache_path(self) -> None:
        """Made when it is written to."""

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
    """One file for each signature of a kernel on each processor: no index that two processes could part."""

    def __init__(self, base: str) -> None:
        self._base = base

    def load(self, key: object) -> Any:
        """What was saved, wherever that was possible; None if nothing was."""
        for root in _roots():
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                return pickle.loads((root / self._name(key)).read_bytes())
        return None

    def save(self, key: object, data: object) -> None:
        """Keep it in the first folder that can be written, whole or not at all; else it is compiled again."""
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
