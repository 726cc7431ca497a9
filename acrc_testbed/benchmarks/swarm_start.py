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

from acrc_testbed.benchmarks.benchmark_result import (
    BenchmarkResult,
    SpeedGoal,
    make_table,
    max_goal,
    run_timed,
)
from actors.installation.repository import clone
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import read_notes

ROBOTS: Final = (4, 20, 100)
_STEP_GOAL_S: Final = 2.5
_OUTPUT_GOAL_S: Final = 0.5
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
    outputs = [{"command": command, **_time_first_output(acrc, command, repeat)} for command in _COMMANDS]
    runs = [{"robots": count, **_time_first_step(acrc, count, repeat)} for count in robots]
    goals = list(_goals(outputs, runs))
    shown: list[Table | str] = [
        make_table(outputs, f"time to first output, medians of {repeat}"),
        make_table(runs, f"acrc run over Zenoh: time to first step, medians of {repeat}"),
        *map(str, goals),
    ]
    return BenchmarkResult({"first_word": outputs, "first_step": runs}, shown)


def _goals(
    outputs: Sequence[Mapping[str, object]], runs: Sequence[Mapping[str, object]]
) -> Iterator[SpeedGoal]:
    slowest = max(float(str(row[name])) for row in outputs for name in ("s", "s without byte code"))
    yield max_goal("s until the first output of the slowest command", slowest, _OUTPUT_GOAL_S)
    for row in runs:
        if row["robots"] == ROBOTS[0]:
            yield max_goal(
                f"s until the first step of {row['robots']} robots", float(str(row["all s"])), _STEP_GOAL_S
            )


def _time_first_output(acrc: str, command: str, repeat: int) -> dict[str, float]:
    """Return wall time until the first output and CPU time, also with PYTHONDONTWRITEBYTECODE."""
    figures: dict[str, float] = {}
    plain = {name: value for name, value in os.environ.items() if name != _NO_BYTECODE}
    for kind, env in (("", plain), (" without byte code", plain | {_NO_BYTECODE: "1"})):
        samples = [_first_output(acrc, command, env) for _ in range(repeat + 1)][1:]
        figures |= {f"s{kind}": round(median(wall for wall, _ in samples), 2)}
        figures |= {f"CPU s{kind}": round(median(cpu for _, cpu in samples), 2)}
    return figures


def _first_output(acrc: str, command: str, env: Mapping[str, str]) -> tuple[float, float]:
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


def _time_first_step(acrc: str, robots: int, repeat: int) -> dict[str, float]:
    """Return medians of the wall time until the first step, by part, and of the command's CPU time."""
    samples = [_time_phases(acrc, robots) for _ in range(repeat + 1)][1:]
    return {name: round(median(one[name] for one in samples), 2) for name in samples[0]}


def _time_phases(acrc: str, robots: int) -> dict[str, float]:
    """Time the phases of a run of one second, by modification times of the files written between them."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        outputs = [acrc, "run", "--robots", str(robots), "--duration", "1", "--json", "--out", str(out)]
        enter = time.time()
        cost = run_timed(outputs, Path(folder))
        notes = read_notes(out / "world" / "world.mcap")
        first = msgspec.json.decode(notes["final"], type=FinalNote).started_s
        planned = first - float(json.loads(cost.output)["startup_s"])
        stamps = {
            "imports, planning": planned,
            "forkserver, preflight": _modified_s(out / "scenario.toml"),
            "folders": _modified_s(out / "world" / SETUP),
            "starting world and radio": _modified_s(out / "r1" / SETUP),
            "starting robots": max(_modified_s(file) for file in out.glob(f"r*/{SETUP}")),
            "first step": first,
        }
    parts, before = {}, enter
    for name, at in stamps.items():
        parts[name], before = at - before, at
    return {"all s": first - enter, **parts, "CPU s of the command": cost.cpu_s}


def _modified_s(file: Path) -> float:
    return file.stat().st_mtime
