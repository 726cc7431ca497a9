"""Program of a compiling process: reads names of modules and prints the name of each that it has compiled.

Changes to numba in this process save compile time: compile times are not recorded, as each nested compilation
would add a listener to all events, and the garbage collector runs rarely. Machine code contains no paths and
addresses of this process, so that it is the same on every computer.
"""

import gc
import importlib
import itertools
import sys
from functools import cache
from typing import Any, Final

from actors.installation.repository import REPOSITORY
from actors.kernels import hidden_scipy
from actors.runtime.processor import fingerprints

with hidden_scipy():
    from numba.core import cpu, event, ir, pythonapi
    from numba.np.ufunc import array_exprs

    from actors import kernel_dispatchers

_INIT_LOCATION: Final = ir.Loc.__init__
_THRESHOLDS: Final = (50_000, 20, 100)
"""Thresholds of the garbage collector; without it, the process takes twice the memory."""


def change_numba() -> None:
    """Change numba in this process as described above."""
    gc.freeze()
    gc.set_threshold(*_THRESHOLDS)
    event.start_event = event.end_event = lambda *_, **__: None
    kernel_dispatchers.unpack_kernels = cache(set)
    ir.Loc.__init__ = _init_location
    cpu.CPUContext.__repr__ = lambda _: "CPUContext"
    numbers = itertools.count()
    pythonapi.id = array_exprs.hash = lambda _: next(numbers)  # parts of names


def _init_location(self: ir.Loc, filename: str, *others: Any, **named: Any) -> None:
    """Shorten the path of a source to that in its package or repository."""
    name = filename.rpartition("/site-packages/")[2].removeprefix(f"{REPOSITORY}/")
    _INIT_LOCATION(self, name, *others, **named)


def main() -> None:
    """Compile each module named in a line of standard input."""
    change_numba()
    for line in sys.stdin:
        fingerprints([importlib.import_module(line.strip())])
        sys.stdout.write(line)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
