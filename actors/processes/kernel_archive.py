"""Machine code of the kernels in the repository, so that most computers compile none.

`python -m actors.processes.kernel_compilation` compiles all kernels for every processor of this architecture,
and puts them into the archive in place of those of the same Python version. It does so in one process with
a fixed order, so that the same sources and libraries give the same bytes. A test finds an outdated archive,
which costs only time: kernels whose sources have changed since are compiled.
"""

import lzma
import os
import platform
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from actors.kernel_sources import module_state
from actors.kernels import cache_folder, load_numba, write_file
from actors.runtime.process_table import python_command

ARCHIVE: Final = Path(__file__).parents[1] / f"kernels-{platform.machine()}.xz"
_GENERIC: Final = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
_Kernels = dict[str, dict[str, bytes]]
"""Machine code by module with its state, and by the name of the file without the part for the processor."""
PYTHON: Final = f"{sys.version_info.major}.{sys.version_info.minor}"
COMPILER: Final = ("-m", "actors.processes.kernel_compiler")
"""Options of Python for a process that compiles the modules in its input and prints their names."""


def unpack_kernels() -> set[str]:
    """Copy all kernels of the archive that are current into the cache; return the names of their modules."""
    archived = read_archive().get(PYTHON, {})
    states = {module: one for one in archived if one == _state(module := one.rpartition("-")[0])}
    ending = load_numba().machine_ending() if states else ""
    for state in states.values():
        for name, code in archived[state].items():
            path = cache_folder() / state / f"{name}{ending}"
            if not path.exists() and not write_file(path, code):
                return set()
    return set(states)


def read_archive() -> dict[str, _Kernels]:
    """Return the kernels of the archive by Python version; {}: none for this processor, or it is damaged."""
    with suppress(OSError, lzma.LZMAError, msgspec.MsgspecError):
        content = lzma.decompress(ARCHIVE.read_bytes())
        return msgspec.msgpack.decode(content, type=dict[str, _Kernels])
    return {}


def compile_archived(modules: list[str]) -> _Kernels:
    """Compile these modules for every processor of this architecture; return their machine code."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, **_GENERIC, "NUMBA_CACHE_DIR": folder}
        names = "".join(f"{module}\n" for module in modules)
        subprocess.run(
            [*python_command(), *COMPILER], input=names, env=environment, text=True, check=True,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        found: _Kernels = {_state(module): {} for module in modules}
        for path in Path(folder).glob("*/*.whole.*"):
            found.setdefault(path.parent.name, {})[path.with_suffix("").stem] = path.read_bytes()
        return found


def _state(module: str) -> str:
    return f"{module}-{module_state(module)}"


def write_archive(modules: list[str]) -> None:
    """Compile these modules and put them into the archive, in place of those of this Python version."""
    content = msgspec.msgpack.encode(read_archive() | {PYTHON: compile_archived(modules)}, order="sorted")
    write_file(ARCHIVE, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))
