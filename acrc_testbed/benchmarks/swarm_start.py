"""`acrc bench start`: duration of short commands, and time until the first step of `acrc run`."""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from rich.table import Table

from acrc_testbed.benchmarks.benchmark_result import (
    BenchmarkResult,
    SpeedGoal,
    final_note,
    make_table,
    max_goal,
    run_timed,
)
from actors.installation.repository import clone
from actors.runtime.process_setup import SETUP

ROBOTS: Final = (4, 20, 100)
_STEP_GOAL_S: Final = 2.5
_COMMANDS: Final = {
    "list strategies": 0.4,
    "scenario maps/corridor.yaml": 0.8,
    "scenario scenarios/corridor.toml": 0.8,
    "run --bus memory --robots 2 --duration 1 --out OUT": 1.5,
    "run --robots 4 --duration 1 --out OUT": 2.2,
    "causes RUN": 1.0,
    "view RUN --png": 2.0,
}
"""Goal of each command's duration, s. RUN: a recorded run; OUT: a new folder."""
_RUN_S: Final = 60
"""Simulated duration of that run, s."""


def measure(robots: Sequence[int] = ROBOTS, repeat: int = 10) -> BenchmarkResult:
    """Return medians of `repeat` calls of each command and runs of each size, after one warm-up each."""
    root = clone("acrc bench start")
    acrc = str(root / "acrc")
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        run = Path(folder, "run")
        run_timed([acrc, "run", "--bus", "memory", "--duration", str(_RUN_S), "--out", str(run)])
        commands = [{"command": one, **_time_command(acrc, one, run, root, repeat)} for one in _COMMANDS]
    runs = [{"robots": count, **_time_first_step(acrc, count, repeat)} for count in robots]
    goals = list(_goals(commands, runs))
    shown: list[Table | str] = [
        make_table(commands, f"duration of commands, medians of {repeat}"),
        make_table(runs, f"acrc run over Zenoh: time to first step, medians of {repeat}"),
        *map(str, goals),
    ]
    return BenchmarkResult({"commands": commands, "first_step": runs}, shown)


def _goals(commands: Sequence[Mapping[str, Any]], runs: Sequence[Mapping[str, Any]]) -> Iterator[SpeedGoal]:
    for row in commands:
        command = row["command"]
        yield max_goal(f"s for acrc {command}", row["s"], _COMMANDS[command])
    for row in runs:
        if row["robots"] == ROBOTS[0]:
            yield max_goal(f"s until the first step of {row['robots']} robots", row["all s"], _STEP_GOAL_S)


def _time_command(acrc: str, command: str, run: Path, root: Path, repeat: int) -> dict[str, float]:
    """Return wall and CPU time of a command from start to exit; `run`: the recorded run."""
    samples = []
    # with byte code, as users have it
    env = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    for number in range(repeat + 1):
        folders = {"RUN": str(run), "OUT": f"{run}-{number}"}
        words = [folders.get(word, word) for word in command.split()]
        samples.append(run_timed([acrc, *words], root, env))
        shutil.rmtree(folders["OUT"], ignore_errors=True)
    return {
        "s": round(median(one.wall_s for one in samples[1:]), 2),
        "CPU s": round(median(one.cpu_s for one in samples[1:]), 2),
    }


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
        first = final_note(out / "world" / "world.mcap").started_s
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
