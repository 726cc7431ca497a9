"""Version of the software."""

import functools
import re
import subprocess
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import IS_CLONE, REPOSITORY

COMMIT: Final = "COMMIT"
"""File in a robot's bundle that names the commit it was built from."""


def package_version() -> str:
    """Return the package's version."""
    return version("acrc-testbed")


@functools.cache
def software_version() -> str:
    """Return the commit, with "+" if files differ from it; outside a clone the package's version.

    Determined once per process: later edits do not change loaded code.
    """
    if not IS_CLONE:  # the environment may lie in an unrelated repository
        return package_version()
    if (REPOSITORY / COMMIT).is_file():
        return (REPOSITORY / COMMIT).read_text().strip()
    try:
        commit = _git("rev-parse", "HEAD")
        return commit + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return package_version()


def _git(*words: str) -> str:
    asked = ["git", "-C", str(REPOSITORY), *words]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()


def changed_since(commit: str) -> tuple[Path, ...] | None:
    """Return the files changed since an earlier commit; None: the commit is not an ancestor.

    Includes uncommitted changes. None also outside a clone.
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


class PinnedPackage(NamedTuple):
    """One package pinned to its tested version."""

    name: str
    version: str
    hashes: tuple[str, ...]
    """Hashes of its files, as for pip's option `--hash`."""

    @property
    def requirement(self) -> str:
        """The pin as a line of a requirements file."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash={one}" for one in self.hashes)])


def sections(constraints: str, minor: int) -> dict[str, list[PinnedPackage]]:
    """Return the pins in the text of constraints.txt for Python 3.`minor`, by section."""
    found: dict[str, list[PinnedPackage]] = {}
    for line in constraints.replace("\\\n", " ").splitlines():
        if header := re.fullmatch(r"# \[(\w+)\]", line):
            pins = found.setdefault(header[1], [])
        elif (pin := _PIN.fullmatch(line)) and _applies(pin, minor):
            hashes = (word.removeprefix("--hash=") for word in pin["hashes"].split())
            pins.append(PinnedPackage(pin["name"], pin["version"], tuple(hashes)))
    return found


def requirements(constraints: str, minor: int, wanted: Collection[str]) -> list[str]:
    """Return requirement lines for pip, sorted and unique: the pins of the `wanted` sections with hashes."""
    found = sections(constraints, minor)
    return sorted({pin.requirement for name in wanted for pin in found[name]})


def _applies(pin: re.Match[str], minor: int) -> bool:
    return pin["order"] is None or (minor < int(pin["minor"])) is (pin["order"] == "<")
