"""Dispatchers of kernels, with a cache keyed by source content; imported on the first call of a kernel."""

import hashlib
import pickle
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache as remembered
from pathlib import Path
from typing import Any, Final

import numba
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.extending import typeof_impl
from numba.misc.appdirs import AppDirs

from actors.kernels import Kernel, cache_folder, imported_sources, module_name, source_hash
from actors.portable import extensions

_PART: Final = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a kernel called by another kernel: no wrappers for Python and C, which unpack arguments."""
extensions.register()
# Load numba's registries now, as they import SciPy where the caller has not hidden it.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()


def dispatcher(kernel: Kernel) -> Any:
    """Return a kernel's dispatcher.

    Entry points for Python and for kernels are compiled separately, each on its first call: most kernels are
    called by kernels only, and wrappers for Python take a tenth of the compile time.
    """

    def compiled(kind: str, **more: bool) -> Any:
        made = numba.njit(**kernel.options, **more)(kernel.function)
        if kernel.cached:
            made._cache = _Cache(kernel.function, kind)
        return made

    @remembered  # created on first use: a kernel loaded from the cache needs none
    def part() -> Any:
        return compiled("part", **_PART)

    whole = compiled("whole")
    whole.get_call_template = lambda *asked: part().get_call_template(*asked)
    whole.get_overload = lambda *asked: part().get_overload(*asked)
    return whole


@typeof_impl.register(Kernel)  # type: ignore[untyped-decorator]
def _typeof_kernel(kernel: Kernel, _: Any) -> Any:
    """Return the numba type of a kernel that another kernel calls."""
    return types.Dispatcher(kernel.dispatcher)


class _Locator(_CacheLocator):  # type: ignore[misc]  # numba has no types
    """Names the cache entries of a function for numba, by the content of its sources."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        source = Path(file)
        self._py_file = file  # required by numba's warnings
        self._line = function.__code__.co_firstlineno
        self._state = f"{module_name(source)}-{source_hash(imported_sources(source))}"

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
