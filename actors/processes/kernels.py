"""Compiles the numeric kernels before the first run, and says so: it takes half a minute, or two."""

import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from actors.runtime.fingerprint import KernelModule, fingerprints
from actors.runtime.processor import processor

_WORDS: Final = "compiling the numeric kernels, once after an installation or a change of the sources"
_DONE: Final = "complete"
"""File in the cache of one state of the sources: on which machine all of them have been compiled."""


def compile_kernels(*, quiet: bool = False, onboard: bool = False) -> None:
    """Compile whatever a run computes with, unless that was done; tells a person how far it is.

    `onboard`: only what a robot computes with, whose computer has no world and need not have pymunk.
    """
    stamp = Path(os.environ["NUMBA_CACHE_DIR"]) / _DONE  # actors has set it
    here, whole = (f"{_machine()}, {part}" for part in ("robot" if onboard else "all", "all"))
    with suppress(OSError):
        if {here, whole} & set(stamp.read_text().splitlines()):
            return
    modules = kernel_modules(onboard=onboard)
    with _told(len(modules), quiet=quiet) as tell:
        for module in modules:
            fingerprints([module])
            tell()
    with suppress(OSError), stamp.open("a") as file:  # without a cache there is one more bar the next time
        file.write(f"{here}\n")


def _machine() -> str:
    """What compiled code depends on beside the sources; numpy is loaded here, as it tells the features."""
    return f"{processor()} Python {platform.python_version()} numba {version('numba')} numpy {np.__version__}"


def kernel_modules(*, onboard: bool = False) -> Sequence[KernelModule]:
    """Every module with kernels that a run, or only a robot, computes with; importing them takes a second."""
    from actors.robot.assembly import KERNELS as ROBOT  # noqa: PLC0415
    from actors.runtime.recording import scans  # noqa: PLC0415

    if onboard:
        return (*ROBOT, scans)
    from actors.radio.program import KERNELS as RADIO  # noqa: PLC0415
    from actors.world.program import KERNELS as WORLD  # noqa: PLC0415

    return tuple({module.__name__: module for module in (*WORLD, *RADIO, *ROBOT, scans)}.values())


@contextmanager
def _told(count: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """What is to be called after each of so many modules."""
    console, began = Console(stderr=True, soft_wrap=True, highlight=False), time.monotonic()
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
