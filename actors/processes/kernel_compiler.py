"""Program of a compiling process: reads names of modules and prints the name of each that it has compiled.

Changes to numba in this process save compile time; the machine code that Python calls stays the same:

- Kernels that only kernels call get no machine code of their own: their callers contain it.
- Compile times are not recorded: each nested compilation would add a listener to all events.
- The garbage collector runs rarely.
"""

import gc
import importlib
import sys
from typing import Any, Final

import llvmlite.binding as llvm

from actors.kernels import hidden_scipy
from actors.runtime.processor import fingerprints

with hidden_scipy():
    from numba.core import event
    from numba.core.codegen import JITCodeLibrary
    from numba.core.environment import Environment, lookup_environment
    from numba.core.registry import cpu_target

_THRESHOLDS: Final = (50_000, 20, 100)
"""Thresholds of the garbage collector; without it, the process takes twice the memory."""


class DeferredCompilation(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Compiled functions whose machine code is generated once Python asks for the address of one."""

    _is_deferred = False

    def get_pointer_to_function(self, name: str) -> int:
        """Return the function's address; 0: it is not in this library."""
        self._ensure_finalized()
        if self._is_deferred:
            if name not in {function.name for function in self.get_defined_functions()}:
                return 0
            self._is_deferred = False
            super()._finalize_final_module()
            for variable, environment in self._environments():
                self._codegen.set_env(variable.name, environment)
        return int(super().get_pointer_to_function(name))

    def _finalize_final_module(self) -> None:
        if self._object_caching_enabled and self._compiled_object:  # loaded from the cache
            super()._finalize_final_module()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = self._is_deferred = True

    def _get_compiled_object(self) -> Any:
        """Return the machine code; before it exists, the variables that numba sets when it loads them."""
        if not self._is_deferred:
            return super()._get_compiled_object()
        variables = "\n".join(str(variable) for variable, _ in self._environments())
        return self._codegen._tm.emit_object(llvm.parse_assembly(variables))

    def _environments(self) -> list[tuple[Any, Environment]]:
        """Return numba's records of the functions' constants, each with the variable that points to it."""
        found = [(one, lookup_environment(one.name)) for one in self._final_module.global_variables]
        return [(variable, environment) for variable, environment in found if environment is not None]


def change_numba() -> None:
    """Change numba in this process as described above."""
    gc.freeze()
    gc.set_threshold(*_THRESHOLDS)
    event.start_event = event.end_event = lambda *_, **__: None
    codegen = type(cpu_target.target_context.codegen())
    codegen._library_class = DeferredCompilation
    set_env = codegen.set_env

    def set_existing(self: Any, name: str, environment: Environment) -> None:
        if self._engine.get_global_value_address(name):  # else once machine code is generated
            set_env(self, name, environment)

    codegen.set_env = set_existing


def main() -> None:
    """Compile each module named in a line of standard input."""
    change_numba()
    for line in sys.stdin:
        fingerprints([importlib.import_module(line.strip())])
        sys.stdout.write(line)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
