"""Which version of the software made a run."""

import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Final

from actors.installation.repository import IS_CLONE, REPOSITORY

COMMIT: Final = "COMMIT"
"""File of a robot's bundle, in place of a repository: the commit that it was made of."""


def release() -> str:
    """The package's version."""
    return version("acrc-testbed")


def software() -> str:
    """The commit, with a plus sign where files were changed since; outside a clone the package's version."""
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
