"""Decorator for numba kernels, which imports numba on the first call of a kernel; folder of their cache."""

import importlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache as remembered
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])
_HERE: Final = Path(__file__).parent


class Kernel:
    """A kernel that has not been called from Python yet.

    Its first call replaces it by its dispatcher in the global names of all modules but numba's and numpy's.
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
        if not module.startswith(("numba.", "numpy.")):
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


def write_file(path: Path, content: bytes) -> bool:
    """Write a file of the cache atomically; return False if that is impossible."""
    part = path.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(path)
        return True
    with suppress(OSError):
        part.unlink()
    return False
