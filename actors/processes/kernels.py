"""Compilation of the numeric kernels before the first run, which takes half a minute, or two."""

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

from actors.console import screen
from actors.kernels import cache_folder, kernel_sources, prune, reachable, state
from actors.runtime.process_table import python
from actors.runtime.processor import KernelModule, fingerprints, processor

_WORDS: Final = "compiling the numeric kernels, once after an installation or a change of the sources"
_DONE: Final = "complete"
"""File in the cache: for which states of the sources and machines all kernels have been compiled."""

_LANES: Final = 4
"""Most processes: one module alone takes a quarter of the time."""
_HELPER: Final = """
import importlib, sys
from actors.runtime.processor import fingerprints
for line in sys.stdin:
    fingerprints([importlib.import_module(line.strip())])
    print(line.strip(), flush=True)
"""


def compile_kernels(*, quiet: bool = False, onboard: bool = False) -> None:
    """Compile all kernels of a run, unless that was done; show the progress.

    `onboard`: only a robot's kernels: its computer has no world and need not have pymunk.
    """
    stamp, sources = cache_folder() / _DONE, state(kernel_sources())
    here, whole = (f"{sources} {_machine()}, {part}" for part in ("robot" if onboard else "all", "all"))
    with suppress(OSError):
        if {here, whole} & set(stamp.read_text().splitlines()):
            return
    modules = kernel_modules(onboard=onboard)
    with _told(len(modules), quiet=quiet) as tell:
        _Compilation(modules, tell).run()
    prune()
    with suppress(OSError):  # without a cache there is one more bar the next time
        stamp.parent.mkdir(parents=True, exist_ok=True)
        with stamp.open("a") as file:
            file.write(f"{here}\n")


class _Compilation:
    """Modules compiled by as many processes as there are cores, each after those whose kernels it calls.

    So no kernel is compiled twice. Where a process fails, this one compiles.
    """

    def __init__(self, modules: Sequence[KernelModule], tell: Callable[[], None]) -> None:
        self._tell = tell
        self._change = threading.Condition()
        self._todo = {Path(str(sys.modules[module.__name__].__file__)): module for module in modules}
        self._undone = set(self._todo)

    def run(self) -> None:
        """Compile them all."""
        lanes = min(len(os.sched_getaffinity(0)), _LANES, len(self._todo))
        with ThreadPoolExecutor(lanes) as pool:
            failed = [module for module in pool.map(self._lane, range(lanes)) if module is not None]
        for module in (*failed, *self._todo.values()):
            fingerprints([module])
            self._tell()

    def _lane(self, _: int) -> KernelModule | None:
        """Compile by one process; return the module at which it failed, if it did."""
        with subprocess.Popen(
            [*python(), "-c", _HELPER], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True, bufsize=1,
        ) as helper:  # fmt: skip
            try:
                while (found := self._next()) is not None:
                    source, module = found
                    done = _asked(helper, module.__name__)
                    with self._change:
                        self._undone.discard(source)
                        self._change.notify_all()
                        if not done:
                            return module
                        self._tell()
            finally:
                with suppress(OSError):  # of what a dead one has not read
                    helper.stdin.close()  # type: ignore[union-attr]
        return None

    def _next(self) -> tuple[Path, KernelModule] | None:
        """Return the next module whose callees are compiled, after a wait; None: all are taken."""
        with self._change:
            while self._todo:
                for source in self._todo:
                    if not (self._undone & set(reachable(source))) - {source}:
                        return source, self._todo.pop(source)
                if len(self._undone) == len(self._todo):  # none is being compiled: they import one another
                    return self._todo.popitem()
                self._change.wait()
        return None


def _asked(helper: "subprocess.Popen[str]", module: str) -> bool:
    """Have a process compile a module; return whether it did."""
    assert helper.stdin is not None and helper.stdout is not None
    try:
        helper.stdin.write(f"{module}\n")
        return helper.stdout.readline() == f"{module}\n"
    except OSError:
        return False


def _machine() -> str:
    """Return what compiled code depends on beside the sources: CPU, Python with -O, numba, numpy."""
    release = f"{platform.python_version()}{' -O' * sys.flags.optimize}"
    return f"{processor()} Python {release} numba {version('numba')} numpy {np.__version__}"


def kernel_modules(*, onboard: bool = False) -> Sequence[KernelModule]:
    """Return the modules with kernels of a run, or only of a robot; importing them takes a second."""
    from actors.robot.assembly import KERNELS as ROBOT  # noqa: PLC0415
    from actors.runtime.recording import scans  # noqa: PLC0415

    if onboard:
        return (*ROBOT, scans)
    from actors.radio.program import KERNELS as RADIO  # noqa: PLC0415
    from actors.world.program import KERNELS as WORLD  # noqa: PLC0415

    return tuple({module.__name__: module for module in (*RADIO, *WORLD, *ROBOT, scans)}.values())


@contextmanager
def _told(count: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function to be called after each of so many modules."""
    console, began = screen(stderr=True), time.monotonic()
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
