"""`acrc bench start`: time until the first output of commands and the first step of `acrc run`."""

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Final

import msgspec
from rich.table import Table

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, SpeedGoal, at_most, run_timed, table_of
from actors.installation.repository import clone
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import read_notes

ROBOTS: Final = (4, 20, 100)
_STEP_S: Final = 2.5
_WORD_S: Final = 0.5
_COMMANDS: Final = (
    "--help",
    "list strategies",
    "list presets",
    "run --help",
    "run --robbots 4",
    "run wrong.toml",
)
"""Valid commands, a wrong option, and a scenario with a wrong key."""
_WRONG: Final = "[robots]\ncuont = 4\n"
_NO_BYTECODE: Final = "PYTHONDONTWRITEBYTECODE"


def measure(robots: Sequence[int] = ROBOTS, repeat: int = 10) -> BenchmarkResult:
    """Return medians of `repeat` calls of each command and runs of each size, after one warm-up each."""
    acrc = str(clone("acrc bench start") / "acrc")
    words = [{"command": command, **_first_word(acrc, command, repeat)} for command in _COMMANDS]
    runs = [{"robots": count, **_first_step(acrc, count, repeat)} for count in robots]
    goals = list(_goals(words, runs))
    shown: list[Table | str] = [
        table_of(words, f"time to first output, medians of {repeat}"),
        table_of(runs, f"acrc run over Zenoh: time to first step, medians of {repeat}"),
        *map(str, goals),
    ]
    return BenchmarkResult({"first_word": words, "first_step": runs}, shown)


def _goals(
    words: Sequence[Mapping[str, object]], runs: Sequence[Mapping[str, object]]
) -> Iterator[SpeedGoal]:
    slowest = max(float(str(row[name])) for row in words for name in ("s", "s without byte code"))
    yield at_most("s until the first output of the slowest command", slowest, _WORD_S)
    for row in runs:
        if row["robots"] == ROBOTS[0]:
            yield at_most(
                f"s until the first step of {row['robots']} robots", float(str(row["all s"])), _STEP_S
            )


def _first_word(acrc: str, command: str, repeat: int) -> dict[str, float]:
    """Return wall time until the first output and CPU time, also with PYTHONDONTWRITEBYTECODE."""
    figures: dict[str, float] = {}
    plain = {name: value for name, value in os.environ.items() if name != _NO_BYTECODE}
    for kind, env in (("", plain), (" without byte code", plain | {_NO_BYTECODE: "1"})):
        found = [_word(acrc, command, env) for _ in range(repeat + 1)][1:]
        figures |= {f"s{kind}": round(median(wall for wall, _ in found), 2)}
        figures |= {f"CPU s{kind}": round(median(cpu for _, cpu in found), 2)}
    return figures


def _word(acrc: str, command: str, env: Mapping[str, str]) -> tuple[float, float]:
    before, began = os.times(), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        (Path(folder) / "wrong.toml").write_text(_WRONG)
        with subprocess.Popen(
            [acrc, *command.split()],
            cwd=folder,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        ) as process:
            assert process.stdout is not None
            first = process.stdout.read(1)
            wall_s = time.monotonic() - began
            process.stdout.read()
    after = os.times()
    if not first:
        raise AcrcError(f"acrc {command} printed nothing")
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    return wall_s, cpu_s


def _first_step(acrc: str, robots: int, repeat: int) -> dict[str, float]:
    """Return medians of the wall time until the first step, by part, and of the command's CPU time."""
    found = [_parts(acrc, robots) for _ in range(repeat + 1)][1:]
    return {name: round(median(one[name] for one in found), 2) for name in found[0]}


def _parts(acrc: str, robots: int) -> dict[str, float]:
    """Time the phases of a run of one second, by modification times of the files written between them."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        words = [acrc, "run", "--robots", str(robots), "--duration", "1", "--json", "--out", str(out)]
        enter = time.time()
        of = run_timed(words, Path(folder))
        notes = read_notes(out / "world" / "world.mcap")
        first = msgspec.json.decode(notes["final"], type=FinalNote).started_s
        planned = first - float(json.loads(of.output)["startup_s"])
        stamps = {
            "imports, planning": planned,
            "forkserver, preflight": _written(out / "scenario.toml"),
            "folders": _written(out / "world" / SETUP),
            "starting world and radio": _written(out / "r1" / SETUP),
            "starting robots": max(_written(file) for file in out.glob(f"r*/{SETUP}")),
            "first step": first,
        }
    parts, before = {}, enter
    for name, at in stamps.items():
        parts[name], before = at - before, at
    return {"all s": first - enter, **parts, "CPU s of the command": of.cpu_s}


def _written(file: Path) -> float:
    return file.stat().st_mtime
