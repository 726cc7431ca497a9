"""What a step costs: swarms over Zenoh and in memory, beside a bare Zenoh ping-pong of as many processes."""

import contextlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import msgspec
from rich.console import Console
from rich.table import Table

from actors.installation.repository import REPOSITORY
from actors.instant import in_seconds
from actors.messages import Progress
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

ROBOTS: Final = (1, 4, 10, 20, 50)
IDLE_SCENARIO: Final = Path(__file__).with_name("idle.toml")


@dataclass(frozen=True)
class StepFigures:
    """One swarm, measured."""

    real_time_factor: float
    cpu_us: float
    """CPU time of all processes per robot and step, start and end left out, µs."""
    startup_s: float
    """From the laying out of the run to its first step, the forkserver's own start included, s."""


@dataclass(frozen=True)
class StepRow:
    """Everything for one number of robots."""

    robots: int
    ping_pong_us: float
    """CPU time of the bare ping-pong per robot and step, µs."""
    ping_pong_wall_us: float
    """Wall clock of one of its steps, µs."""
    idle: StepFigures
    """Robots that do nothing, over Zenoh: the step protocol, recording and isolation."""
    idle_memory: StepFigures
    full: StepFigures
    """The shipped scenario over Zenoh."""
    memory: StepFigures
    pss_mb: float
    """Mean proportional set size of the robots' processes, isolated, after 60 simulated seconds, MB."""


def run(robots: Sequence[int] = ROBOTS, seconds: float = 60.0, json_output: bool = False) -> list[StepRow]:
    """Measure, print and give the figures. `seconds` are simulated ones of each run."""
    console = Console(stderr=True)
    rows = []
    for count in robots:
        console.print(f"{count} robots …", highlight=False)
        rows.append(_row(count, seconds))
    if json_output:
        sys.stdout.write(json.dumps([asdict(row) for row in rows]) + "\n")
    else:
        _print(rows, seconds)
    return rows


def _row(count: int, seconds: float) -> StepRow:
    wall_us, cpu_us = ping_pong(count, round(seconds * 10))
    return StepRow(
        robots=count,
        ping_pong_us=cpu_us,
        ping_pong_wall_us=wall_us,
        idle=_measure(IDLE_SCENARIO, count, seconds, "zenoh"),
        idle_memory=_measure(IDLE_SCENARIO, count, seconds, "memory"),
        full=_measure(None, count, seconds, "zenoh"),
        memory=_measure(None, count, seconds, "memory"),
        pss_mb=proportional_set_size(count),
    )


def ping_pong(robots: int, steps: int) -> tuple[float, float]:
    """Wall clock per step, and CPU per robot and step, µs: 100 bytes to each process and back."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        place = Path(folder)

        def player(*words: object) -> subprocess.Popen[bytes]:
            name = "-".join(map(str, words))
            return subprocess.Popen(
                [
                    *(sys.executable, "-m", "benchmarks.swarm.ping_pong", *map(str, words)),
                    *("--socket", str(place / "s"), "--result", str(place / f"{name}.json")),
                ],
                cwd=REPOSITORY,
            )

        players = [player("conductor", "--robots", robots, "--steps", steps)]
        players += [player("robot", "--number", number) for number in range(robots)]
        for process in players:
            if process.wait(timeout=300):
                raise RuntimeError(f"a player of the ping-pong ended with exit code {process.returncode}")
        results = [json.loads(path.read_text()) for path in place.glob("*.json")]
    wall = next(result["wall_s"] for result in results if "wall_s" in result)
    return wall / steps * 1e6, sum(result["cpu_s"] for result in results) / robots / steps * 1e6


def _measure(scenario: Path | None, count: int, seconds: float, bus: str) -> StepFigures:
    overrides = Overrides(robots=count, duration=seconds, step=100)
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        options = RunOptions(out, bus="memory" if bus == "memory" else "zenoh", json=True)
        plan = swarm.plan(load_scenario(scenario, overrides), options)
        if bus == "memory":
            cpu = time.process_time()
            result = swarm.run_in_memory(plan, lambda progress: None)
            # one process: its start, which reads maps and compiles, is told apart by the wall clock
            used = (time.process_time() - cpu) * result.wall_s / (result.wall_s + result.startup_s)
        else:
            result = swarm.run_processes(plan, "forkserver", lambda progress: None)
            used = sum(_stepping_cpu(path) for path in out.glob("*/*.mcap"))
    steps = result.simulated_s * 10
    return StepFigures(result.real_time_factor, used / steps / count * 1e6, result.startup_s)


class _Weighed(Exception):  # noqa: N818  # ends a run that has served its purpose
    """The robots' processes have been weighed."""


def proportional_set_size(robots: int, after_s: float = 60.0) -> float:
    """Mean proportional set size of the robots' processes after so many simulated seconds, MB."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        overrides = Overrides(robots=robots, duration=36_000)
        plan = swarm.plan(load_scenario(None, overrides), RunOptions(out, json=True))
        sizes: list[float] = []

        def weigh(progress: Progress) -> None:
            if in_seconds(progress.instant) >= after_s:
                sizes.extend(_proportional_set_sizes(out))
                raise _Weighed

        with contextlib.suppress(_Weighed):
            swarm.run_processes(plan, "forkserver", weigh)
        return sum(sizes) / len(sizes)


def _stepping_cpu(recording: Path) -> float:
    final = msgspec.json.decode(read_notes(recording)["final"], type=FinalNote)
    return final.cpu_s - final.startup_cpu_s


def _proportional_set_sizes(out: Path) -> list[float]:
    """Of every living robot process of a run, MB; a robot is known by the log that it writes to."""
    sizes = []
    for entry in Path("/proc").iterdir():
        try:
            log = (entry / "fd" / "1").readlink()
            if log.parent.parent == out and log.name not in ("world.log", "radio.log"):
                lines = (entry / "smaps_rollup").read_text().splitlines()
                sizes.append(next(int(line.split()[1]) / 1024 for line in lines if line.startswith("Pss:")))
        except OSError:
            continue
    return sizes


def _print(rows: Sequence[StepRow], seconds: float) -> None:
    table = Table(title=f"CPU µs per robot and step (100 ms steps, {seconds:g} s simulated)")
    for name in (
        "robots",
        "ping-pong",
        "idle",
        "x ping-pong",
        "idle, memory",
        "full",
        "x ping-pong",
        "full, memory",
    ):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            str(row.robots),
            f"{row.ping_pong_us:.0f}",
            f"{row.idle.cpu_us:.0f}",
            f"{row.idle.cpu_us / row.ping_pong_us:.2f}",
            f"{row.idle_memory.cpu_us:.0f}",
            f"{row.full.cpu_us:.0f}",
            f"{row.full.cpu_us / row.ping_pong_us:.2f}",
            f"{row.memory.cpu_us:.0f}",
        )
    speed = Table(title="Simulated seconds per second, start-up and memory")
    for name in (
        "robots",
        "idle",
        "idle, memory",
        "ratio",
        "full",
        "full, memory",
        "ratio",
        "start-up s",
        "PSS MB",
    ):
        speed.add_column(name, justify="right")
    for row in rows:
        speed.add_row(
            str(row.robots),
            f"{row.idle.real_time_factor:.0f}",
            f"{row.idle_memory.real_time_factor:.0f}",
            f"{row.idle_memory.real_time_factor / row.idle.real_time_factor:.1f}",
            f"{row.full.real_time_factor:.0f}",
            f"{row.memory.real_time_factor:.0f}",
            f"{row.memory.real_time_factor / row.full.real_time_factor:.1f}",
            f"{row.full.startup_s:.2f}",
            f"{row.pss_mb:.1f}",
        )
    console = Console(width=100)
    console.print(table)
    console.print(speed)
    console.print(
        "Goals: at most 2 x the ping-pong; memory at least 5 x faster than Zenoh; 50 robots start in 6 s; "
        "25 MB per robot.",
        highlight=False,
    )
