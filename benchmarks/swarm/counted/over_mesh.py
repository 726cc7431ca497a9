"""One robot's step over Zenoh: system calls, context switches, bytes recorded, of all processes together."""

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.statistics.commands import ACRC, spent
from benchmarks.swarm.counted.in_memory import recorded_bytes
from benchmarks.swarm.counted.steps import ROBOTS, CountedSteps
from benchmarks.swarm.task import SwarmTask

_TRACER: Final = "strace"
_VOLUNTARY: Final = "voluntary"
_FORCED: Final = "forced"


@dataclass(frozen=True)
class MeshCounts:
    """Of one robot in one step, all processes' work for it included; scheduling moves them a little."""

    system_calls: dict[str, float] | None
    """By name; None: strace is not installed."""
    voluntary: float
    """Context switches that a process asked for: it waited for something."""
    forced: float
    """Context switches that the kernel forced on a process that could have gone on."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""


def counted(window: CountedSteps) -> MeshCounts:
    """What a longer run has more than a shorter one. Raises AcrcError if a run fails."""
    switches, recorded = zip(*map(_plain, window.tasks), strict=True)
    by_kind = window.per_step(*switches)
    traced = None
    if shutil.which(_TRACER):
        traced = window.per_step(*map(_traced, window.tasks))
    return MeshCounts(traced, by_kind[_VOLUNTARY], by_kind[_FORCED], window.per_step(*recorded))


def _plain(task: SwarmTask) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Context switches and recorded bytes of one run."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        of = spent([*ACRC, *_words(task, out)])
        return {_VOLUNTARY: of.voluntary, _FORCED: of.forced}, recorded_bytes(out)


def _traced(task: SwarmTask) -> Mapping[str, float]:
    """System calls of one run by name, from its start to its end."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        table = Path(folder) / "calls"
        words = _words(task, Path(folder) / "out")
        spent([_TRACER, "-f", "-c", "-U", "name,calls", "-o", str(table), *ACRC, *words])
        return read_calls(table.read_text())


def read_calls(table: str) -> dict[str, float]:
    """The rows of strace's table of names and calls, between two rules."""
    rows = (line.split() for line in table.split("\n"))
    return {
        row[0]: float(row[1]) for row in rows if len(row) == 2 and row[1].isdecimal() and row[0] != "total"
    }


def _words(task: SwarmTask, out: Path) -> Sequence[str]:
    return (
        *("run", str(task.scenario), "--robots", str(ROBOTS), "--seed", str(task.seed)),
        *("--duration", f"{task.seconds:g}", "--bus", "zenoh", "--json", "--out", str(out)),
    )
