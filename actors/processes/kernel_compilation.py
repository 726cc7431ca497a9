"""The numeric kernels before the first run: unpacked, or compiled, which takes up to two minutes.

`python -m actors.processes.kernel_compilation` compiles all kernels for every processor of this architecture,
and puts them into the archive in place of those of the same Python version. It does so in one process with
a fixed order, so that the same sources and libraries give the same bytes.
"""

import lzma
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from graphlib import TopologicalSorter
from importlib.metadata import version
from pathlib import Path
from queue import SimpleQueue
from typing import Final

import msgspec
import numpy as np

from actors.kernel_sources import module_state, prune_cache, used_modules
from actors.kernels import cache_folder, load_numba, write_file
from actors.runtime.process_table import python_command
from actors.runtime.processor import KernelModule, fingerprints, processor

_TITLE: Final = "compiling numeric kernels (once after an installation or a source change)"
_DONE: Final = "complete"
"""File in the cache that lists the source states and machines for which all kernels are compiled."""

_COMPILER: Final = ("-m", "actors.processes.kernel_compiler")
"""Options of Python for a process that compiles the modules in its input and prints their names."""
_GENERIC: Final = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
_MAX_PROCESSES: Final = 4
"""Most processes: one module alone takes a quarter of the time."""


def compile_kernels(*, quiet: bool = False, onboard: bool = False) -> None:
    """Unpack or compile all kernels of a run, unless they are in the cache; show the progress.

    `onboard`: only a robot's kernels: its computer has no world, and maybe no pymunk.
    """
    if are_compiled(onboard=onboard):
        return
    found = load_numba().unpack_kernels()
    modules = [one for one in kernel_modules(onboard=onboard) if one.__name__ not in found]
    if modules:
        with _progress(len(modules), quiet=quiet) as report_progress:
            _compile(modules, report_progress)
    prune_cache()
    with suppress(OSError):  # without a cache they are checked again next time
        stamp = cache_folder() / _DONE
        stamp.parent.mkdir(parents=True, exist_ok=True)
        with stamp.open("a") as file:
            file.write(f"{_entry(onboard=onboard)}\n")


def are_compiled(*, onboard: bool = False) -> bool:
    """Return whether all kernels of a run are compiled; `onboard`: those of a robot."""
    with suppress(OSError):
        done = (cache_folder() / _DONE).read_text().splitlines()
        return _entry(onboard=onboard) in done or _entry(onboard=False) in done
    return False


@cache
def _entry(*, onboard: bool) -> str:
    """Return the line of the stamp for these sources and this computer."""
    part = "robot" if onboard else "all"
    return f"{module_state('')} {_environment()}, {part}"


def _compile(modules: Sequence[KernelModule], report_progress: Callable[[], None]) -> None:
    """Compile modules in parallel, each after those whose kernels it calls, so that none is compiled twice.

    This process compiles the modules that another one fails to compile.
    """
    named = {module.__name__: module for module in modules}
    order = TopologicalSorter({name: named.keys() & used_modules(name) - {name} for name in named})
    order.prepare()
    idle = SimpleQueue[subprocess.Popen[bytes]]()
    processes = min(len(os.sched_getaffinity(0)), _MAX_PROCESSES, len(modules))
    with ExitStack() as stack, ThreadPoolExecutor(processes) as pool:
        for _ in range(processes):
            compiler = subprocess.Popen(
                [*python_command(), *_COMPILER], bufsize=0,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            idle.put(stack.enter_context(compiler))
        running = {}
        while order.is_active():
            for name in order.get_ready():
                running[pool.submit(_compile_in, idle, name.encode())] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                if not future.result():
                    fingerprints([named[name]])
                report_progress()
                order.done(name)


def _compile_in(idle: "SimpleQueue[subprocess.Popen[bytes]]", module: bytes) -> bool:
    """Compile a module in one of the processes; return whether it succeeded."""
    compiler = idle.get()
    assert compiler.stdin is not None and compiler.stdout is not None
    try:
        compiler.stdin.write(module + b"\n")
        return compiler.stdout.readline() == module + b"\n"
    except OSError:
        return False
    finally:
        idle.put(compiler)


def _environment() -> str:
    """Return CPU, Python, -O, numba and numpy, which compiled code depends on besides the sources."""
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
    from actors.world.program import PEOPLE_KERNELS  # noqa: PLC0415

    modules = (*RADIO, *WORLD, *PEOPLE_KERNELS, *ROBOT, scans)
    return tuple({module.__name__: module for module in modules}.values())


def archived_modules() -> list[str]:
    """Return the names of all modules with kernels, tasks' included, in the order of their compilation."""
    return [*(module.__name__ for module in kernel_modules()), "cleaning.visits"]


def compile_archived(modules: list[str]) -> dict[str, dict[str, bytes]]:
    """Compile these modules for every processor of this architecture; return their `Kernels`."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, **_GENERIC, "NUMBA_CACHE_DIR": folder}
        subprocess.run(
            [*python_command(), *_COMPILER], input="\n".join(modules), env=environment, text=True, check=True,
            capture_output=True,
        )  # fmt: skip
        found: dict[str, dict[str, bytes]] = {f"{one}-{module_state(one)}": {} for one in modules}
        for path in Path(folder).glob("*/*.whole.*"):
            found.setdefault(path.parent.name, {})[path.with_suffix("").stem] = path.read_bytes()
        return found


def write_archive() -> None:
    """Compile all kernels and put them into the archive, in place of those of this Python version."""
    numba = load_numba()
    archived = numba.read_archive() | {numba.PYTHON: compile_archived(archived_modules())}
    content = msgspec.msgpack.encode(archived, order="sorted")
    write_file(numba.ARCHIVE, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))


@contextmanager
def _progress(count: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each of `count` modules."""
    from rich import progress  # noqa: PLC0415  # rarely needed

    from actors.console import create_console  # noqa: PLC0415

    console, began = create_console(stderr=True), time.monotonic()
    if quiet:
        yield lambda: None
    elif console.is_terminal:
        columns = (
            progress.TextColumn(_TITLE), progress.BarColumn(), progress.MofNCompleteColumn(),
            progress.TimeElapsedColumn(),
        )  # fmt: skip
        with progress.Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("", total=count)
            yield lambda: bar.advance(task)
    else:
        console.print(f"acrc: {_TITLE}: {count} modules")
        yield lambda: None
        console.print(f"acrc: compiled in {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    write_archive()
