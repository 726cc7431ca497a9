"""Commands of this project as processes, with the time that they take."""

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from typing import Final

from actors.runtime.errors import AcrcError

ACRC: Final = (sys.executable, "-P", "-m", "acrc_testbed.command_line")
_LAST_WORDS: Final = 300
"""Characters of what a failed command said."""


@dataclass(frozen=True)
class Spent:
    """What a command and all the processes that it started took."""

    answer: str
    """What it wrote on its standard output."""
    wall_s: float
    cpu_s: float
    voluntary: int
    """Context switches of a process that waited for something."""
    forced: int
    """Context switches of a process that could have gone on."""


def spent(words: Sequence[str], cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Spent:
    """Run a command while this process has no other one; AcrcError with its last words where it fails."""
    before, began = getrusage(RUSAGE_CHILDREN), time.monotonic()
    code, out, err = _run(words, cwd, env)
    wall_s, after = time.monotonic() - began, getrusage(RUSAGE_CHILDREN)
    if code != 0:
        raise AcrcError(f"{shlex.join(words)} fails: {err.strip()[-_LAST_WORDS:]}")
    return Spent(
        out,
        wall_s,
        after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime,
        after.ru_nvcsw - before.ru_nvcsw,
        after.ru_nivcsw - before.ru_nivcsw,
    )


def _run(words: Sequence[str], cwd: Path | None, env: Mapping[str, str] | None) -> tuple[int, str, str]:
    """Exit code and streams; if this process is ended meanwhile, so are all that the command has started."""
    try:
        process = subprocess.Popen(
            words, cwd=cwd, env=env, start_new_session=True, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
    except OSError as error:
        raise AcrcError(f"{words[0]} cannot be started: {error.strerror}") from None
    with process:
        try:
            out, err = process.communicate()
        except BaseException:
            os.killpg(process.pid, signal.SIGTERM)
            raise
    return process.returncode, out, err
