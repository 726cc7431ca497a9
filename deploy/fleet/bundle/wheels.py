"""Wheels for another computer, fetched by pip as it is configured here: pinned, with hashes, none built."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from actors.processes.scratch import scratch_folder
from actors.runtime.errors import AcrcError, printable

MACHINES: Final = {"x86-64": "x86_64", "aarch64": "aarch64"}
"""Processors that there are wheels for, each as `uname -m` names it."""
_PLATFORMS: Final = ("manylinux2014", "manylinux_2_17", "manylinux_2_26", "manylinux_2_27", "manylinux_2_28")
_PATIENCE_S: Final = 900.0
_ERROR: Final = re.compile(r"^ *ERROR: (.+)$", re.MULTILINE)


def fetch(place: Path, requirements: Sequence[str], minor: int, machine: str) -> None:
    """Fetch them into the folder `place`, for Python 3.`minor` on `machine`, one of MACHINES.

    `requirements`: lines with hashes, as `actors.installation.pins` gives them. Raises AcrcError.
    """
    platforms = [
        word for name in (*(f"{p}_{MACHINES[machine]}" for p in _PLATFORMS), "any")
        for word in ("--platform", name)
    ]  # fmt: skip
    with scratch_folder() as folder:
        listed = folder / "requirements.txt"
        listed.write_text("".join(f"{line}\n" for line in requirements))
        said = _run(sys.executable, "-P", "-m", "venv", str(folder / "pip"))
        if not said:
            said = _run(
                *(str(folder / "pip" / "bin" / "python"), "-P", "-m", "pip"),
                *("--disable-pip-version-check", "-q"),
                *("download", "--only-binary", ":all:", "--no-deps", "--require-hashes"),
                *("--python-version", f"3.{minor}", *platforms, "-r", str(listed), "-d", str(place)),
            )
    if said:
        raise AcrcError(
            f"wheels for {machine} and Python 3.{minor} cannot be fetched: {said}; connect to a network, or "
            "set PIP_FIND_LINKS to a folder that has them"
        )


def _run(*command: str) -> str:
    """Why it failed, in words; empty if it did not."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"pip has not ended well: {type(error).__name__}"
    if not done.returncode:
        return ""
    errors = _ERROR.findall(done.stderr) or done.stderr.strip().splitlines() or ["pip said nothing"]
    return printable(errors[-1])
