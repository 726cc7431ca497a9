"""What a worker of a cluster is asked to do for a run: describe its computer, and be a host for a while.

Both by a process of its own: the worker's stays what it is, and is free to tell how the other one ended.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from deploy.hosts.host_program import ERRAND, KEYS, RECORDED
from deploy.hosts.run_tls import PemKeys

FOLDER: Final = "acrc-"
"""So begins the name of a folder for one run, among the computer's temporary ones."""
_MOST_SAID: Final = 4000
_COMPILING_S: Final = 900.0
"""How long a computer may take to describe itself, which compiles the kernels if they are not."""


def describe() -> tuple[int, str, str]:
    """The exit code, output and last words of `host_probe` on the worker's computer."""
    words = [sys.executable, "-P", "-m", "deploy.hosts.host_probe"]
    try:
        done = subprocess.run(
            words, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=_COMPILING_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return 1, "", f"took longer than {_COMPILING_S:g} s"
    return done.returncode, done.stdout, done.stderr[-_MOST_SAID:]


def serve(errand: bytes, keys: tuple[bytes, bytes, bytes]) -> tuple[int, str]:
    """Be a host until its run has ended; exit code and last words of its process.

    `keys`: as of PemKeys. Recordings stay in its folder where they are to, or nobody could be sent them.
    """
    folder = Path(tempfile.mkdtemp(prefix=FOLDER))
    (folder / ERRAND).write_bytes(errand)
    PemKeys(*keys).write(folder / KEYS)
    words = [sys.executable, "-P", "-m", "deploy.hosts.host_program", str(folder)]
    done = subprocess.run(
        words, cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    useless = folder / KEYS if done.returncode == RECORDED else folder
    shutil.rmtree(useless, ignore_errors=True)
    return done.returncode, done.stderr[-_MOST_SAID:]
