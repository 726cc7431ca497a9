"""Which version of the software made a run."""

import subprocess
from importlib.metadata import version

from actors.installation.repository import IS_CLONE, REPOSITORY


def release() -> str:
    """The package's version."""
    return version("acrc-testbed")


def software() -> str:
    """The commit, with a plus sign where files were changed since; outside a clone the package's version."""
    if not IS_CLONE:  # an environment that lies in somebody's repository is none of its commits
        return release()
    try:
        commit = _git("rev-parse", "HEAD")
        return commit + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return release()


def _git(*words: str) -> str:
    asked = ["git", "-C", str(REPOSITORY), *words]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()
