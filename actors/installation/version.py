"""Which version of the software made a run."""

import functools
import re
import subprocess
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import IS_CLONE, REPOSITORY

COMMIT: Final = "COMMIT"
"""File of a robot's bundle, in place of a repository: the commit that it was made of."""


def release() -> str:
    """The package's version."""
    return version("acrc-testbed")


@functools.cache
def software() -> str:
    """Return the commit, with a plus sign where files differ from it; outside a clone the package's version.

    Asked once per process: later edits of files change no code that is loaded.
    """
    if not IS_CLONE:  # an environment that lies in somebody's repository is none of its commits
        return release()
    if (REPOSITORY / COMMIT).is_file():
        return (REPOSITORY / COMMIT).read_text().strip()
    try:
        commit = _git("rev-parse", "HEAD")
        return commit + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return release()


def _git(*words: str) -> str:
    asked = ["git", "-C", str(REPOSITORY), *words]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()


def changed_since(commit: str) -> tuple[Path, ...] | None:
    """The files that differ from those of an earlier commit; None: this software does not descend from it.

    Changes that are in no commit yet count, too. None also outside a clone, where nobody knows.
    """
    if not IS_CLONE:
        return None
    try:
        _git("merge-base", "--is-ancestor", "--end-of-options", commit, "HEAD")
        names = _git("diff", "--name-only", "--no-renames", "-z", "--end-of-options", commit, "--")
    except (OSError, subprocess.CalledProcessError):
        return None
    return tuple(REPOSITORY / name for name in names.split("\0") if name)


MINORS: Final = (11, 12, 13, 14)
"""Minor versions of Python 3 whose wheels have hashes in constraints.txt, for Linux on x86-64 and ARM."""
_PIN: Final = re.compile(
    r"(?P<name>[A-Za-z0-9_.-]+)==(?P<version>[^\s;]+)"
    r"(?:; python_version (?P<order><|>=) \"3\.(?P<minor>\d+)\")?(?P<hashes>(?: +--hash=\S+)*) *"
)


class Pin(NamedTuple):
    """One package at the one version that is tested."""

    name: str
    version: str
    hashes: tuple[str, ...]
    """Hashes of its files, as for pip's option `--hash`."""

    @property
    def requirement(self) -> str:
        """As a line of a requirements file."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash={one}" for one in self.hashes)])


def sections(constraints: str, minor: int) -> dict[str, list[Pin]]:
    """The pins in the text of constraints.txt that apply to Python 3.`minor`, by section."""
    found: dict[str, list[Pin]] = {}
    for line in constraints.replace("\\\n", " ").splitlines():
        if header := re.fullmatch(r"# \[(\w+)\]", line):
            pins = found.setdefault(header[1], [])
        elif (pin := _PIN.fullmatch(line)) and _applies(pin, minor):
            hashes = (word.removeprefix("--hash=") for word in pin["hashes"].split())
            pins.append(Pin(pin["name"], pin["version"], tuple(hashes)))
    return found


def requirements(constraints: str, minor: int, wanted: Collection[str]) -> list[str]:
    """Lines for pip, sorted: the pins of the `wanted` sections with their hashes, each once."""
    found = sections(constraints, minor)
    return sorted({pin.requirement for name in wanted for pin in found[name]})


def _applies(pin: re.Match[str], minor: int) -> bool:
    return pin["order"] is None or (minor < int(pin["minor"])) is (pin["order"] == "<")
