"""Result of a benchmark, and timing of commands."""

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

import msgspec
from rich.table import Table

from actors.console import print_parts
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes

_WIDTH: Final = 250
"""Columns of the widest table; used without a terminal."""


@dataclass(frozen=True)
class BenchmarkResult:
    """Result of a benchmark or comparison."""

    figures: Any
    """Figures for JSON."""
    shown: Sequence[Table | str]
    """Tables and sentences, in order."""
    holds: bool | None = None
    """True if the claim holds; None: no claim was made."""

    def with_line(self, line: str) -> Self:
        """Return a copy with one more sentence at the end."""
        return replace(self, shown=(*self.shown, line))

    def report(self, *, json_output: bool) -> int:
        """Print tables or JSON; return the exit code, 1 if the claim does not hold."""
        if json_output:
            sys.stdout.write(json.dumps(self.figures) + "\n")
        else:
            print_parts(self.shown, None if sys.stdout.isatty() else _WIDTH)
        return 1 if self.holds is False else 0


@dataclass(frozen=True)
class SpeedGoal:
    """A performance goal and the measured figure."""

    words: str
    figure: float
    goal: float
    met: bool

    def __str__(self) -> str:
        """Return one sentence."""
        figure = f"{self.figure:,.0f}" if abs(self.figure) >= 1000 else f"{self.figure:.4g}"
        return f"goal, {self.words}: {figure}, {'met' if self.met else 'MISSED'}"


def min_goal(name: str, figure: float, goal: float) -> SpeedGoal:
    """Return the goal that the figure is at least `goal`."""
    return SpeedGoal(f"{name}, at least {goal:,.6g}", figure, goal, figure >= goal)


def max_goal(name: str, figure: float, goal: float) -> SpeedGoal:
    """Return the goal that the figure is at most `goal`."""
    return SpeedGoal(f"{name}, at most {goal:,.6g}", figure, goal, figure <= goal)


def make_table(rows: Sequence[Mapping[str, object]], title: str, form: str = "") -> Table:
    """Return a table of at least one row, given by column; `form`: format of values that are not text."""
    table = Table(*rows[0], title=title)
    for row in rows:
        cells = ("-" if value is None else value for value in row.values())
        table.add_row(*(cell if isinstance(cell, str) else format(cell, form) for cell in cells))
    return table


def final_note(recording: Path) -> FinalNote:
    """Return the final record of a process that exited as planned. Raises RecordingError."""
    return msgspec.json.decode(read_notes(recording)["final"], type=FinalNote)


ACRC: Final = (sys.executable, "-P", "-m", "acrc_testbed.command_line")
_ERROR_LENGTH: Final = 300
"""Characters of a failed command's standard error that are shown."""


@dataclass(frozen=True)
class CommandCost:
    """Output and cost of a command, including its child processes."""

    output: str
    """Standard output."""
    wall_s: float
    cpu_s: float
    voluntary: int
    """Voluntary context switches."""
    forced: int
    """Involuntary context switches."""


def run_timed(
    words: Sequence[str], cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> CommandCost:
    """Run a command while this process has no other children. Raises AcrcError if it fails.

    Signals that interrupt this process also terminate the command's process group.
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
        raise AcrcError(f"{shlex.join(words)} fails: {err.strip()[-_ERROR_LENGTH:]}")
    return CommandCost(
        out,
        wall_s,
        after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime,
        after.ru_nvcsw - before.ru_nvcsw,
        after.ru_nivcsw - before.ru_nivcsw,
    )
