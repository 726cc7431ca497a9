"""The command and the environment variables with which the processes of a run start."""

import sys
from collections.abc import Mapping
from typing import Final

_NAMES: Final = frozenset(
    {
        "PATH", "HOME", "LANG", "LANGUAGE", "TZ", "TMPDIR", "TERM", "COLUMNS", "VIRTUAL_ENV",
        "LD_LIBRARY_PATH", "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "XDG_RUNTIME_DIR", "GLIBC_TUNABLES",
    }
)  # fmt: skip
_BEGINNINGS: Final = (
    "LC_",
    "PYTHON",
    "NUMBA_",
    "NPY_",
    "OPENBLAS_",
    "OMP_",
    "MKL_",
    "ZENOH_",
    "RERUN_",
    "WGPU_",
)
"""Of the libraries that a run uses."""


def python() -> list[str]:
    """Return this interpreter's command, without the working directory on its path, with this -O."""
    return [sys.executable, "-P", *["-O"] * sys.flags.optimize]


def passed_on(shell: Mapping[str, str]) -> dict[str, str]:
    """What interpreter, libraries and viewer go by, out of the environment `shell`.

    Nothing else: a variable may hold a key or password of the user's, and is a note that all robots read.
    """
    return {name: value for name, value in shell.items() if name in _NAMES or name.startswith(_BEGINNINGS)}
