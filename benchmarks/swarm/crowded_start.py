"""Many robots that start on a computer which is busy with other things: whether all get there, and when."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from benchmarks.statistics.commands import answer
from benchmarks.statistics.measured import Measured, table_of

_SPIN: Final = (sys.executable, "-c", "while True: pass")


_SIMULATED_S: Final = 2.0
_PATIENCE_S: Final = 1800.0
"""After so long a run counts as hung."""


def check(robots: int = 100, hogs_per_core: int = 4) -> Measured:
    """Start them with and without company; it holds where all runs end with one digest.

    `hogs_per_core`: processes that do nothing but compute, for each of the computer's cores.
    """
    hogs = hogs_per_core * (os.cpu_count() or 1)
    rows = [
        _row("in memory", ("--bus", "memory"), 0, robots),
        _row("processes", (), 0, robots),
        _row("processes, busy computer", (), hogs, robots),
    ]
    table = table_of(rows, f"{robots} robots, {_SIMULATED_S:g} s simulated")
    return Measured(rows, (table,), len({row["digest"] for row in rows}) == 1)


def _row(name: str, words: Sequence[str], hogs: int, robots: int) -> dict[str, object]:
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder, busy(hogs):
        told = answer(
            "run", "--robots", str(robots), "--duration", f"{_SIMULATED_S:g}", "--json", *words,
            "--out", str(Path(folder) / "out"), patience_s=_PATIENCE_S,
        )  # fmt: skip
    result = json.loads(told)
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
