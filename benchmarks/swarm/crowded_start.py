"""Many robots that start on a computer which is busy with other things: whether all get there, and when."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from benchmarks.statistics.rows import print_rows

_ACRC: Final = (sys.executable, "-P", "-m", "command_line")
_SPIN: Final = (sys.executable, "-c", "while True: pass")


@dataclass(frozen=True)
class CrowdedStartTask:
    """What is tried."""

    robots: int = 100
    simulated_s: float = 2.0
    hogs_per_core: int = 4
    """Processes that do nothing but compute, for each of the computer's cores; own choice."""
    patience_s: float = 1800.0
    """After so long a run counts as hung."""


def run(task: CrowdedStartTask, json_output: bool = False) -> bool:
    """Start them with and without company, print, and say whether all runs ended with one digest."""
    rows = [
        _row("in memory", ("--bus", "memory"), 0, task),
        _row("processes", (), 0, task),
        _row("processes, busy computer", (), task.hogs_per_core * (os.cpu_count() or 1), task),
    ]
    print_rows(rows, f"{task.robots} robots, {task.simulated_s:g} s simulated", json_output=json_output)
    return len({row["digest"] for row in rows}) == 1


def _row(name: str, words: Sequence[str], hogs: int, task: CrowdedStartTask) -> dict[str, object]:
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder, busy(hogs):
        done = subprocess.run(
            [
                *_ACRC, "run", "--robots", str(task.robots), "--duration", f"{task.simulated_s:g}", "--json",
                *words, "--out", str(Path(folder) / "out"),
            ],
            capture_output=True, text=True, cwd=REPOSITORY, timeout=task.patience_s, check=False,
        )  # fmt: skip
    if done.returncode != 0:
        raise AcrcError(f"{name}: {task.robots} robots do not run: {done.stderr.strip()[-300:]}")
    result = json.loads(done.stdout)
    return {
        "run": name,
        "other processes": hogs,
        "whole run [s]": round(time.monotonic() - began_s, 1),
        "messages undelivered": result["undelivered"],
        "digest": result["digest"][:8],
    }


@contextmanager
def busy(hogs: int) -> Iterator[None]:
    """So many processes compute meanwhile."""
    spinning = [subprocess.Popen(_SPIN) for _ in range(hogs)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()
