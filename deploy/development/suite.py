"""The test suite in two halves: what leaves the clock alone runs a worker per core, the rest one by one."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

ALONE: Final = "alone"
"""The marker of tests that measure wall time or want every core."""
NO_TESTS: Final = 5
"""pytest's exit code where nothing was left to run; of one half of the suite it is no fault."""


def run_suite(root: Path, words: Sequence[str]) -> int:
    """Run pytest in the folder `root`; its exit code, or the first one that is not 0.

    `words` go to pytest as they are, in one process, since whoever names tests also wants `--pdb` or `-s`;
    without any the whole suite runs, in two halves.
    """
    if words:
        return _pytest(root, words)
    workers = str(os.cpu_count() or 1)
    beside = _pytest(root, ("-m", f"not {ALONE}", "-n", workers, "--dist", "worksteal"))
    alone = _pytest(root, ("-m", ALONE))
    if beside == alone == NO_TESTS:
        return NO_TESTS
    return next((code for code in (beside, alone) if code not in (0, NO_TESTS)), 0)


def _pytest(root: Path, words: Sequence[str]) -> int:
    return subprocess.run([sys.executable, "-m", "pytest", *words], cwd=root, check=False).returncode
