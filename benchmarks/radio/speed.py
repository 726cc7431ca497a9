"""Frames on the air per CPU second, beside ns-3: all in range, 60 octets, Poisson arrivals of G in all."""

import json
import subprocess
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from actors.ieee802154 import airtime_ns
from actors.radio.medium.medium import Medium
from actors.radio.medium.traffic import Poisson
from actors.radio.presets import preset
from benchmarks.radio.trials import SECOND, LossTable

NS3_PROGRAM: Final = Path(__file__).with_name("radio_speed_ns3.py")
_PATIENCE_S: Final = 1800


@dataclass(frozen=True)
class SpeedTask:
    """What is measured."""

    senders: tuple[int, ...] = (1, 10, 50, 200)
    loads: tuple[float, ...] = (0.2, 0.8)
    octets: int = 60
    frames: int = 50_000
    """About as many are offered in one measurement of the medium."""
    ns3_frames: int = 5_000
    """… and of ns-3, which is slower."""
    repeats: int = 5
    """The median counts; both sides in turn."""


GOALS: Final = {10: 3.0, 50: 15.0, 200: 60.0}
"""Times ns-3, by senders."""


@dataclass(frozen=True)
class Speed:
    """One number of senders and load; frames on the air per CPU second."""

    senders: int
    load: float
    medium: float
    ns3: float | None
    ratio: float | None
    goal: float | None


def run(ns3_python: Path | None, json_output: bool = False, task: SpeedTask | None = None) -> dict[str, Any]:
    """Print, and give, the speeds; `ns3_python`: interpreter of an environment with the package ns3."""
    task = task or SpeedTask()
    console = Console(stderr=json_output)
    missing = _why_not(ns3_python)
    if missing:
        console.print(f"ns-3 is LEFT OUT: {missing}", style="bold red", highlight=False)
    speeds = [
        _measure(senders, load, task, None if missing else ns3_python)
        for senders in task.senders
        for load in task.loads
    ]
    figures = {
        "task": asdict(task),
        "ns3": missing or "its wheel, which is built with assertions",
        "speeds": [asdict(speed) for speed in speeds],
        "met": None if missing else all(s.ratio is not None and s.ratio >= (s.goal or 0.0) for s in speeds),
    }
    if json_output:
        Console().print_json(json.dumps(figures))
    else:
        _print(console, speeds)
    return figures


def medium_speed(senders: int, load: float, octets: int, frames: int, seed: int = 1) -> float:
    """Frames on the air per CPU second of the medium."""
    parameters = preset("ns3")
    losses = LossTable(np.full((senders + 1, senders + 1), 60.0))
    transceivers = [parameters.transceiver.numbered(address) for address in range(senders + 1)]
    medium = Medium(transceivers, losses, parameters.phy, seed=seed, watched=[senders])
    medium.place(losses.places)
    per_second = load * SECOND / airtime_ns(octets)
    for sender in range(senders):
        medium.offer(sender, Poisson(octets, per_second / senders))
    medium.run(SECOND)  # kernels are loaded and rows of losses known
    before = int(medium.counters()["sent"].sum())
    begun = time.process_time()
    medium.run(SECOND + round(frames / per_second * SECOND))
    spent = time.process_time() - begun
    return (int(medium.counters()["sent"].sum()) - before) / spent


def _measure(senders: int, load: float, task: SpeedTask, ns3_python: Path | None) -> Speed:
    ours, theirs = [], []
    for repeat in range(task.repeats):
        ours.append(medium_speed(senders, load, task.octets, task.frames, repeat + 1))
        if ns3_python is not None:
            theirs.append(_ns3_speed(ns3_python, senders, load, task, repeat + 1))
    ns3 = median(theirs) if theirs else None
    ratio = median(ours) / ns3 if ns3 else None
    return Speed(senders, load, median(ours), ns3, ratio, GOALS.get(senders))


def _why_not(ns3_python: Path | None) -> str:
    """Why ns-3 cannot be measured; empty if it can."""
    if ns3_python is None:
        return "no interpreter was named; make an environment, `pip install ns3` there, name its python."
    try:
        answer = subprocess.run(
            [ns3_python, "-c", "import ns"], capture_output=True, timeout=_PATIENCE_S, check=False
        )
    except OSError as error:
        return f"{ns3_python} does not start: {error}."
    return "" if answer.returncode == 0 else f"{ns3_python} has no package ns3."


def _ns3_speed(python: Path, senders: int, load: float, task: SpeedTask, seed: int) -> float:
    """Frames on the air per CPU second of ns-3's lr-wpan; only its event loop counts."""
    arguments = [str(senders), str(load), str(task.octets), str(task.ns3_frames), str(seed)]
    answer = subprocess.run(
        [python, NS3_PROGRAM, *arguments], capture_output=True, timeout=_PATIENCE_S, check=True, text=True
    )
    return float(answer.stdout.split()[-1])


def _print(console: Console, speeds: list[Speed]) -> None:
    table = Table(title="Frames on the air per CPU second (ns-3: its wheel, built with assertions)")
    for name in ("senders", "G", "medium", "ns-3", "ratio", "goal"):
        table.add_column(name, justify="right")
    for s in speeds:
        table.add_row(
            str(s.senders), f"{s.load:g}", f"{s.medium:,.0f}", f"{s.ns3:,.0f}" if s.ns3 else "-",
            f"{s.ratio:.1f}" if s.ratio else "-", f"{s.goal:g}" if s.goal else "-",
        )  # fmt: skip
    console.print(table)
