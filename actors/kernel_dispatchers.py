"""Dispatchers of kernels, with a cache keyed by source content; imported on the first call of a kernel.

The repository contains the machine code of all kernels for every processor of an architecture, so that most
computers compile none. An outdated archive costs only time: kernels whose sources have changed are compiled.
"""

import hashlib
import lzma
import pickle
import platform
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache as remembered
from pathlib import Path
from typing import Any, Final

import llvmlite.binding as llvm
import msgspec
import numba
from numba import types
from numba.core import entrypoints
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.compiler import CompileResult, compile_result
from numba.core.environment import Environment, lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python
from numba.core.serialize import dumps
from numba.extending import typeof_impl
from numba.misc.appdirs import AppDirs

from actors.kernel_sources import module_name, module_state
from actors.kernels import Kernel, cache_folder, hidden_scipy, write_file
from actors.portable import extensions

_PART: Final = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a kernel called by another kernel: no wrappers for Python and C, which unpack arguments."""
ARCHIVE: Final = Path(__file__).parent / f"kernels-{platform.machine()}.xz"
Kernels = dict[str, dict[str, bytes]]
"""Machine code by module with its state, and by the name of the file without the part for the processor."""
PYTHON: Final = f"{sys.version_info.major}.{sys.version_info.minor}"
extensions.register()
entrypoints._already_initialized = True  # kernels use no extensions of installed packages


def dispatcher(kernel: Kernel) -> Any:
    """Return a kernel's dispatcher.

    Entry points for Python and for kernels are compiled separately, each on its first call: most kernels are
    called by kernels only, and wrappers for Python take a tenth of the compile time.
    """

    @remembered  # created on first use: a kernel loaded from the cache needs none
    def part() -> Any:
        made = numba.njit(**kernel.options, **_PART)(kernel.function)
        made._cache = _Cache(kernel.function, "part", _Impl)
        return made

    whole = numba.njit(**kernel.options)(kernel.function)
    whole._cache = _Cache(kernel.function, "whole", _ObjectImpl)
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
        module = module_name(source)
        state = module_state(module)
        assert state is not None, f"kernel that imports neither kernel nor njit: {source}"
        self._state = f"{module}-{state}"

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
        return ""


class _Impl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _ObjectImpl(_Impl):
    """Saves object code only, without the intermediate code for inlining, which takes longer to load."""

    def reduce(self, cres: CompileResult) -> Any:
        cres.fndesc.typemap = cres.fndesc.calltypes = None
        found = cres._find_referenced_environments()
        environments = [(one.env_name, one.globals["__name__"], one.consts) for one in found]
        code = cres.library._get_compiled_object()
        return code, cres.fndesc, cres.environment, cres.signature, environments

    def rebuild(self, target_context: Any, payload: Any) -> CompileResult:
        code, fndesc, environment, signature, environments = payload
        _add_runtime_symbols()
        library = _ObjectLoader(target_context.codegen(), code)
        entry_point = target_context.get_executable(library, fndesc, environment)
        kept = tuple(_environment(*one) for one in environments)
        for one in kept:
            library.codegen.set_env(one.env_name, one)
        return compile_result(
            typing_context=target_context.typing_context, target_context=target_context, library=library,
            environment=environment, entry_point=entry_point, fndesc=fndesc, signature=signature,
            lifted=(), objectmode=False, referenced_envs=kept,  # the code has their addresses only
        )  # fmt: skip


@remembered
def _add_runtime_symbols() -> None:
    """Make the C functions of numba's runtime known to LLVM; only new code needs the rest of the runtime."""
    for name, address in _nrt_python.c_helpers.items():
        llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def _environment(name: str, module: str, constants: list[Any]) -> Environment:
    """Return numba's record of a function's constants; only interpreted code uses the module."""
    found = lookup_environment(name)
    if found is None:
        found = Environment._memo[name] = Environment({"__name__": module})
        found.env_name = name
        found.consts[:] = constants
    return found


class _ObjectLoader:
    """Loads object code of a kernel that is called from Python only."""

    def __init__(self, codegen: Any, code: bytes) -> None:
        self.codegen = codegen
        engine = codegen._engine._ee
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        self.get_pointer_to_function = engine.get_function_address


class _Cache(FunctionCache):  # type: ignore[misc]
    def __init__(self, function: Callable[..., Any], kind: str, impl: type[_Impl]) -> None:
        self._impl_class = impl
        super().__init__(function)
        base = f"{self._impl.locator.get_cache_path()}/{self._impl.filename_base}"
        self._cache_file = _Files(f"{base}.{kind}")

    def _index_key(self, signature: Any, codegen: Any) -> str:
        function = self._py_func
        cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
        return f"{_hash((signature, function.__code__.co_code, cells and dumps(cells)))}.{_machine()}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load without numba's registries of functions, which only compilation needs."""
        found = self._load_overload(sig, target_context)
        if found is None and unpack_kernels():
            found = self._load_overload(sig, target_context)
        if found is None:
            with hidden_scipy():
                target_context.typing_context.refresh()
                target_context.refresh()
        return found


class _Files:
    """Cache of a kernel: one file per signature and processor, without an index that could be corrupted."""

    def __init__(self, base: str) -> None:
        self._base = base

    def load(self, key: str) -> Any:
        """Return the saved data from the first folder that has it; None: no folder has it."""
        for root in _roots():
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                return pickle.loads((root / self._name(key)).read_bytes())
        return None

    def save(self, key: str, data: object) -> None:
        """Save atomically in the first writable folder; without one, nothing is saved."""
        content = dumps(data)
        for root in _roots():
            if write_file(root / self._name(key), content):
                return

    def _name(self, key: str) -> str:
        return f"{self._base}.{key}.nbc"


@remembered
def _machine() -> str:
    """Return a hash of the processor for which kernels are compiled."""
    return _hash(cpu_target.target_context.codegen().magic_tuple())


def _hash(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:16]


def _roots() -> tuple[Path, Path]:
    return cache_folder(), Path(AppDirs(appname="acrc", appauthor=False).user_cache_dir, "kernels")


@remembered
def unpack_kernels() -> set[str]:
    """Copy the current kernels of the archive into the cache, once; return the names of their modules."""
    archived = read_archive().get(PYTHON, {})
    found = set()
    for folder, codes in archived.items():
        module, _, state = folder.rpartition("-")
        if state == module_state(module):
            found.add(module)
            for name, code in codes.items():
                path = cache_folder() / folder / f"{name}.{_machine()}.nbc"
                if not path.exists() and not write_file(path, code):
                    return set()
    return found


def read_archive() -> dict[str, Kernels]:
    """Return the kernels of the archive by Python version; {}: none for this processor, or it is damaged."""
    with suppress(OSError, lzma.LZMAError, msgspec.MsgspecError):
        content = lzma.decompress(ARCHIVE.read_bytes())
        return msgspec.msgpack.decode(content, type=dict[str, Kernels])
    return {}
