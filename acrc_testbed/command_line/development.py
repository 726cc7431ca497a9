"""Commands `acrc test` and `acrc check`, for developers of the testbed."""

import os
import subprocess
import sys
import threading
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self, TextIO

import typer
from rich.console import Console
from rich.text import Text

from actors.console import create_console
from actors.installation.repository import clone


@dataclass(frozen=True)
class Check:
    """A program that checks the sources."""

    name: str
    command: tuple[str, ...]
    """Arguments of the Python interpreter."""


CHECKS: Final = (
    Check("ruff format --check", ("-m", "ruff", "format", "--check", ".")),
    Check("ruff check", ("-m", "ruff", "check", ".")),
    Check("portable arithmetic", ("-m", "acrc_testbed.command_line.portability")),
    Check("mypy", ("-m", "mypy")),
    Check("lint-imports", ("-c", "import sys; from importlinter import cli; cli.lint_imports_command()")),
)


def run_checks(root: Path, console: Console, checks: tuple[Check, ...] = CHECKS) -> bool:
    """Run all checks in the folder `root`, also after a failure; return whether all passed."""
    failed = []
    for check in checks:
        console.rule(Text(check.name, style="bold"), align="left")
        if subprocess.run([sys.executable, *check.command], cwd=root, check=False).returncode:
            failed.append(check.name)
    console.rule(align="left")
    if failed:
        console.print(f"{len(failed)} of {len(checks)} checks failed: {', '.join(failed)}", style="bold red")
    else:
        console.print(f"all {len(checks)} checks passed: {', '.join(c.name for c in checks)}", style="green")
    return not failed


NIGHTLY: Final = "nightly"
"""Marker of tests that only `acrc test --nightly` runs."""
BY_FILE: Final = ("--dist", "loadfile", "--no-loadscope-reorder", "--max-worker-restart", "0")
"""One worker per file creates its fixtures once, in the order of tests/conftest.py. A crashed worker ends the
suite: a replacement can block the others (pytest-dev/pytest-xdist#1378)."""
BUDGET: Final = Path("tests", "development", "budget.toml")
"""File with the maximum number of processes of the suite."""
_PERIOD_S: Final = 0.02


def run_suite(root: Path, words: Sequence[str]) -> int:
    """Run pytest in the folder `root` and return its exit code.

    `words` go to pytest unchanged, in one process. Without words the suite runs in several workers and its
    processes are counted; the only word `--nightly` runs all tests in several workers.
    """
    nightly = list(words) == [f"--{NIGHTLY}"]
    if words and not nightly:
        return run_pytest(root, words)
    selected = () if nightly else ("-m", f"not {NIGHTLY}")
    workers = str((os.cpu_count() or 1) + 1)  # one more: some tests wait most of the time
    with ProcessCounter() as started:
        code = run_pytest(root, (*selected, "-n", workers, *BY_FILE))
    exceeded = not nightly and _is_over_budget(root, started.count)
    return code or int(exceeded)


class ProcessCounter:
    """Counter of new descendants that samples /proc; may miss processes of under 20 ms."""

    def __init__(self) -> None:
        self._own, self._foreign = {os.getpid()}, set[int]()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._foreign = _processes() - self._own
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    @property
    def count(self) -> int:
        """Number of descendants so far."""
        return len(self._own) - 1

    def _watch(self) -> None:
        while not self._ended.wait(_PERIOD_S):
            present = _processes()
            self._foreign &= present
            for pid in sorted(present - self._own - self._foreign):
                with suppress(OSError):
                    stat = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace")
                    parent = int(stat.rpartition(")")[2].split()[1])
                    (self._own if parent in self._own else self._foreign).add(pid)


def _processes() -> set[int]:
    return {int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()}


def _is_over_budget(root: Path, started: int) -> bool:
    """Print the number of started processes; return whether it exceeds the budget."""
    if not (root / BUDGET).is_file():
        return False
    limit = int(tomllib.loads((root / BUDGET).read_text())["suite"]["processes"])
    sys.stderr.write(f"{started} processes were started; {BUDGET} allows {limit}\n")
    return started > limit


def run_pytest(root: Path, words: Sequence[str], stdout: TextIO | None = None) -> int:
    """Run pytest with byte code caching, since tests start many interpreters; return the exit code."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name != "PYTHONDONTWRITEBYTECODE" and not name.startswith("PYTEST_")
    }
    environment["PYTHONPATH"] = str(root)  # nothing else: a sourced ROS adds pytest plugins
    return subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=root, env=environment, stdout=stdout, check=False
    ).returncode


def test(context: typer.Context) -> None:
    """Run the tests; arguments go to pytest (-h: its help)."""
    root = clone("test")
    words = [_absolute_argument(word) for word in context.args]
    from actors.processes.kernel_compilation import compile_kernels

    compile_kernels()  # first: its messages would appear in the output that tests read
    raise typer.Exit(run_suite(root, words))


def check() -> None:
    """Check style, types, imports and arithmetic of the sources."""
    if not run_checks(clone("check"), create_console()):
        raise typer.Exit(1)


def _absolute_argument(word: str) -> str:
    """Make an argument that names a file, or a test in one, absolute."""
    path, colons, name = word.partition("::")
    return f"{Path(path).absolute()}{colons}{name}" if Path(path).exists() else word
