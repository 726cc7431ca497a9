"""Result of a benchmark: figures, tables, goals, verdict; cost of commands."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from typing import Any, Final, Self

from rich.table import Table

from actors.console import show
from actors.runtime.errors import AcrcError

_WIDTH: Final = 250
"""Characters that the widest table needs, where no terminal says how wide it is."""


@dataclass(frozen=True)
class Measured:
    """The figures, and how a person reads them."""

    figures: Any
    """For JSON."""
    shown: Sequence[Table | str]
    """Tables and sentences, in their order."""
    holds: bool | None = None
    """Whether what was claimed holds; None: nothing was claimed."""

    def with_line(self, line: str) -> Self:
        """Return the same with one more sentence at the end."""
        return replace(self, shown=(*self.shown, line))

    def tell(self, *, json_output: bool) -> int:
        """Print it for people or as JSON; return the exit code, 1 if the claim does not hold."""
        if json_output:
            sys.stdout.write(json.dumps(self.figures) + "\n")
        else:
            show(self.shown, None if sys.stdout.isatty() else _WIDTH)
        return 1 if self.holds is False else 0


@dataclass(frozen=True)
class SpeedGoal:
    """A goal, beside what was reached."""

    words: str
    figure: float
    goal: float
    met: bool

    def __str__(self) -> str:
        """A sentence."""
        figure = f"{self.figure:,.0f}" if abs(self.figure) >= 1000 else f"{self.figure:.4g}"
        return f"goal, {self.words}: {figure}, {'met' if self.met else 'MISSED'}"


def at_least(what: str, figure: float, goal: float) -> SpeedGoal:
    """Return the goal that the figure is at least `goal`."""
    return SpeedGoal(f"{what}, at least {goal:,.6g}", figure, goal, figure >= goal)


def at_most(what: str, figure: float, goal: float) -> SpeedGoal:
    """Return the goal that the figure is at most `goal`."""
    return SpeedGoal(f"{what}, at most {goal:,.6g}", figure, goal, figure <= goal)


def table_of(rows: Sequence[Mapping[str, object]], title: str, form: str = "") -> Table:
    """Tabulate at least one row, each with the same columns by name; `form`: of values that are not text."""
    table = Table(*rows[0], title=title)
    for row in rows:
        cells = ("-" if value is None else value for value in row.values())
        table.add_row(*(cell if isinstance(cell, str) else format(cell, form) for cell in cells))
    return table


ACRC: Final = (sys.executable, "-P", "-m", "acrc_testbed.command_line")
_LAST_WORDS: Final = 300
"""Characters of what a failed command said."""


@dataclass(frozen=True)
class Spent:
    """Cost of a command and of all processes that it started."""

    answer: str
    """Its standard output."""
    wall_s: float
    cpu_s: float
    voluntary: int
    """Context switches of a process that waited for something."""
    forced: int
    """Context switches of a process that could have gone on."""


def spent(words: Sequence[str], cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Spent:
    """Run a command while this process has no other one. Raises AcrcError with its last words if it fails.

    If this process is ended meanwhile, so are all processes that the command has started.
    """
    before, began = getrusage(RUSAGE_CHILDREN), time.monotonic()
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
    wall_s, after = time.monotonic() - began, getrusage(RUSAGE_CHILDREN)
    if process.returncode != 0:
        raise AcrcError(f"{shlex.join(words)} fails: {err.strip()[-_LAST_WORDS:]}")
    return Spent(
        out,
        wall_s,
        after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime,
        after.ru_nvcsw - before.ru_nvcsw,
        after.ru_nivcsw - before.ru_nivcsw,
    )
