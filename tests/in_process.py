"""Commands called in the process of the test, without starting an interpreter."""

import gc
import io
import subprocess
import sys
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from acrc_testbed.command_line import app
from actors.installation.repository import REPOSITORY
from actors.user_code import expect_hashes, set_folders, set_task_folders


def acrc(
    *words: object, cwd: Path = REPOSITORY, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `acrc WORDS…` in this process and return its exit code and output.

    `env` is added to the environment. Modules imported from outside the repository are unloaded afterwards.
    """
    out, err, threshold, loaded = io.StringIO(), io.StringIO(), gc.get_threshold(), set(sys.modules)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(app, "protect_standard_streams", lambda: None)
        patch.setattr(sys, "argv", ["acrc", *map(str, words)])
        patch.setattr(sys, "path", list(sys.path))
        for name, value in {"COLUMNS": "100", **(env or {})}.items():
            patch.setenv(name, value)
        patch.chdir(cwd)
        try:
            app.main()
            code = 0
        except SystemExit as leave:
            code = leave.code if isinstance(leave.code, int) else int(leave.code is not None)
        finally:
            gc.set_threshold(*threshold)
            set_folders(())  # reset the search path of modules
            set_task_folders(())
            expect_hashes(None)
            _unload_foreign(loaded)
    return subprocess.CompletedProcess([*map(str, words)], code, out.getvalue(), err.getvalue())


def _unload_foreign(loaded: set[str]) -> None:
    for name in set(sys.modules) - loaded:
        file = getattr(sys.modules[name], "__file__", None)
        if file and not file.startswith((str(REPOSITORY), sys.prefix, sys.base_prefix)):
            del sys.modules[name]
