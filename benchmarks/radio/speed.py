"""Frames on the air per CPU second: all in range, 60 octets, Poisson arrivals of G in all."""

import time
from dataclasses import asdict, dataclass
from statistics import median

import numpy as np

from actors.ieee802154 import airtime_ns
from actors.radio.medium.medium import Medium
from actors.radio.medium.traffic import Poisson
from actors.radio.presets import preset
from benchmarks.radio.trials import SECOND, LossTable
from benchmarks.statistics.measured import Measured, table_of


@dataclass(frozen=True)
class SpeedTask:
    """What is measured."""

    senders: tuple[int, ...] = (1, 10, 50, 200)
    loads: tuple[float, ...] = (0.2, 0.8)
    octets: int = 60
    frames: int = 50_000
    """About as many are offered in one measurement."""
    repeats: int = 5
    """The median counts."""


def measure(task: SpeedTask | None = None) -> Measured:
    """The speed with each number of senders and each load."""
    task = task or SpeedTask()
    speeds = [
        {"senders": senders, "load": load, "medium": round(_speed(senders, load, task))}
        for senders in task.senders
        for load in task.loads
    ]
    table = table_of(speeds, "the medium alone: frames on the air per CPU second")
    return Measured({"task": asdict(task), "speeds": speeds}, (table,))


def _speed(senders: int, load: float, task: SpeedTask) -> float:
    seeds = range(1, task.repeats + 1)
    return median(medium_speed(senders, load, task.octets, task.frames, seed) for seed in seeds)


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
