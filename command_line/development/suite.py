"""The test suite in two halves: what leaves the clock alone runs in several workers, the rest one by one.

A few tests repeat, for more seeds, what others of the suite have shown: those are left to the night.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

ALONE: Final = "alone"
"""The marker of tests that measure wall time or want every core."""
NIGHTLY: Final = "nightly"
"""The marker of tests that show for more seeds what others of the suite show for some."""
BY_FILE: Final = ("--dist", "loadfile", "--no-loadscope-reorder", "--max-worker-restart", "0")
"""A file goes to one worker, where its fixtures are made once; tests/conftest.py says which begin. A worker
that has crashed ends the half, with its test's name: replaced, it can leave the others waiting for ever
(pytest-dev/pytest-xdist#1378)."""
NO_TESTS: Final = 5
"""pytest's exit code where nothing was left to run; of one half of the suite it is no fault."""


def run_suite(root: Path, words: Sequence[str]) -> int:
    """Run pytest in the folder `root`; its exit code, or the first one that is not 0.

    `words` go to pytest as they are, in one process, since whoever names tests also wants `--pdb` or `-s`;
    without any the suite runs, in two halves, and with `--nightly` alone all there is of it.
    """
    whole = list(words) == [f"--{NIGHTLY}"]
    if words and not whole:
        return _pytest(root, words)
    now = "" if whole else f" and not {NIGHTLY}"
    workers = str((os.cpu_count() or 1) + 1)  # in each some tests wait while others compute
    beside = _pytest(root, ("-m", f"not {ALONE}{now}", "-n", workers, *BY_FILE))
    alone = _pytest(root, ("-m", f"{ALONE}{now}", *marked_alone(root)))
    if beside == alone == NO_TESTS:
        return NO_TESTS
    return next((code for code in (beside, alone) if code not in (0, NO_TESTS)), 0)


def marked_alone(root: Path) -> list[str]:
    """The files of the second half, lest pytest imports all others once more; none: it looks at all.

    The marker stands in a test's own file, or tests/conftest.py refuses it.
    """
    folder = root / "tests" if (root / "tests").is_dir() else root
    files = sorted(folder.rglob("test_*.py"))
    return [str(path.relative_to(root)) for path in files if says_alone(path)]


def says_alone(path: Path) -> bool:
    """True if this file has tests with the marker."""
    return f"mark.{ALONE}" in path.read_text("utf-8")


def _pytest(root: Path, words: Sequence[str]) -> int:
    """With modules compiled once and kept: the tests start some hundred interpreters, each of which needs a
    thousand modules; compiling them anew takes as long as all else that `acrc` does before a run.
    """
    kept = {
        name: value
        for name, value in os.environ.items()
        if name != "PYTHONDONTWRITEBYTECODE" and not name.startswith("PYTEST_")  # of another environment
    }
    return subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=root, env=kept, check=False
    ).returncode
