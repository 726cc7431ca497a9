"""Commands of this project, called as a user does."""

import subprocess
import sys
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError

ACRC: Final = (sys.executable, "-P", "-m", "command_line")
_LAST_WORDS: Final = 300
"""Characters of what a failed command said."""


def answer(*words: str, patience_s: float | None = None) -> str:
    """What a command writes on its standard output; AcrcError with its last words where it fails."""
    done = subprocess.run(
        [*ACRC, *words], cwd=REPOSITORY, capture_output=True, text=True, timeout=patience_s, check=False
    )
    if done.returncode != 0:
        raise AcrcError(f"acrc {words[0]} fails: {done.stderr.strip()[-_LAST_WORDS:]}")
    return done.stdout
