"""The command line called in the process of the test: for commands of which no process is tested."""

import gc
import io
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from command_line import app, streams


def acrc(*words: object, cwd: Path = REPOSITORY) -> subprocess.CompletedProcess[str]:
    """Run `acrc WORDS…` in this process and return its exit code and what it printed."""
    out, err, threshold = io.StringIO(), io.StringIO(), gc.get_threshold()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(streams, "settle", lambda: None)
        patch.setattr(sys, "argv", ["acrc", *map(str, words)])
        patch.chdir(cwd)
        try:
            app.main()
            code = 0
        except SystemExit as leave:
            code = leave.code if isinstance(leave.code, int) else int(leave.code is not None)
        finally:
            gc.set_threshold(*threshold)
    return subprocess.CompletedProcess([*map(str, words)], code, out.getvalue(), err.getvalue())
