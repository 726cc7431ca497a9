"""Compilation of the numeric kernels before the first run, which takes half a minute to two minutes."""

import os
import platform
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from actors.console import create_console
from actors.kernels import cache_folder, imported_sources, kernel_sources, prune_cache, source_hash
from actors.runtime.process_table import python_command
from actors.runtime.processor import KernelModule, fingerprints, processor

_WORDS: Final = "compiling numeric kernels (once after an installation or a source change)"
_DONE: Final = "complete"
"""File in the cache that lists the source states and machines for which all kernels are compiled."""

_MAX_PROCESSES: Final = 4
"""Most processes: one module alone takes a quarter of the time."""
_COMPILER: Final = """
import importlib, sys
from actors.runtime.processor import fingerprints
for line in sys.stdin:
    fingerprints([importlib.import_module(line.strip())])
    print(line.strip(), flush=True)
"""


def compile_kernels(*, quiet: bool = False, onboard: bool = False) -> None:
    """Compile all kernels of a run, unless they are compiled; show the progress.

    `onboard`: only a robot's kernels: its computer has no world, and maybe no pymunk.
    """
    stamp, sources = cache_folder() / _DONE, source_hash(kernel_sources())
    here, whole = (f"{sources} {_machine()}, {part}" for part in ("robot" if onboard else "all", "all"))
    with suppress(OSError):
        if {here, whole} & set(stamp.read_text().splitlines()):
            return
    modules = kernel_modules(onboard=onboard)
    with _progress(len(modules), quiet=quiet) as tell:
        _Compilation(modules, tell).run()
    prune_cache()
    with suppress(OSError):  # without a cache they are checked again next time
        stamp.parent.mkdir(parents=True, exist_ok=True)
        with stamp.open("a") as file:
            file.write(f"{here}\n")


class _Compilation:
    """Parallel compilation of modules, each after those whose kernels it calls.

    So no kernel is compiled twice. If a process fails, this process compiles.
    """

    def __init__(self, modules: Sequence[KernelModule], tell: Callable[[], None]) -> None:
        self._tell = tell
        self._change = threading.Condition()
        self._todo = {Path(str(sys.modules[module.__name__].__file__)): module for module in modules}
        self._undone = set(self._todo)

    def run(self) -> None:
        """Compile all modules."""
        lanes = min(len(os.sched_getaffinity(0)), _MAX_PROCESSES, len(self._todo))
        with ThreadPoolExecutor(lanes) as pool:
            failed = [module for module in pool.map(self._lane, range(lanes)) if module is not None]
        for module in (*failed, *self._todo.values()):
            fingerprints([module])
            self._tell()

    def _lane(self, _: int) -> KernelModule | None:
        """Compile modules in one process; return the module at which it failed, if any."""
        with subprocess.Popen(
            [*python_command(), "-c", _COMPILER], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True, bufsize=1,
        ) as helper:  # fmt: skip
            try:
                while (found := self._next()) is not None:
                    source, module = found
                    done = _compile(helper, module.__name__)
                    with self._change:
                        self._undone.discard(source)
                        self._change.notify_all()
                        if not done:
                            return module
                        self._tell()
            finally:
                with suppress(OSError):  # unread data of a failed process
                    helper.stdin.close()  # type: ignore[union-attr]
        return None

    def _next(self) -> tuple[Path, KernelModule] | None:
        """Wait for and return the next module whose callees are compiled; None: all are taken."""
        with self._change:
            while self._todo:
                for source in self._todo:
                    if not (self._undone & set(imported_sources(source))) - {source}:
                        return source, self._todo.pop(source)
                if len(self._undone) == len(self._todo):  # none is being compiled: circular imports
                    return self._todo.popitem()
                self._change.wait()
        return None


def _compile(helper: "subprocess.Popen[str]", module: str) -> bool:
    """Compile a module in another process; return whether it succeeded."""
    assert helper.stdin is not None and helper.stdout is not None
    try:
        helper.stdin.write(f"{module}\n")
        return helper.stdout.readline() == f"{module}\n"
    except OSError:
        return False


def _machine() -> str:
    """Return what compiled code depends on besides the sources: CPU, Python and -O, numba, numpy."""
    release = f"{platform.python_version()}{' -O' * sys.flags.optimize}"
    return f"{processor()} Python {release} numba {version('numba')} numpy {np.__version__}"


def kernel_modules(*, onboard: bool = False) -> Sequence[KernelModule]:
    """Return the modules with kernels of a run, or of a robot only; importing them takes a second."""
    from actors.robot.assembly import KERNELS as ROBOT  # noqa: PLC0415
    from actors.runtime.recording import scans  # noqa: PLC0415

    if onboard:
        return (*ROBOT, scans)
    from actors.radio.program import KERNELS as RADIO  # noqa: PLC0415
    from actors.world.program import KERNELS as WORLD  # noqa: PLC0415

    return tuple({module.__name__: module for module in (*RADIO, *WORLD, *ROBOT, scans)}.values())


@contextmanager
def _progress(count: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each of `count` modules."""
    console, began = create_console(stderr=True), time.monotonic()
    if quiet:
        yield lambda: None
    elif console.is_terminal:
        columns = (TextColumn(_WORDS), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("", total=count)
            yield lambda: bar.advance(task)
    else:
        console.print(f"acrc: {_WORDS}: {count} modules")
        yield lambda: None
        console.print(f"acrc: compiled in {time.monotonic() - began:.0f} s")
