"""What the BEE-click firmware's clear channel assessment costs against a textbook's.

Ten robots at random in a square, exponent 3, all at -10 dBm, frames of 60 octets at random: the mean over
pairs of the share of sent frames that the one hears from the other. Textbook: energy from 10 dB above the
sensitivity, or while receiving. Firmware: energy from -69 dBm alone (d3scomp/beeclickarm, MRF24J40.cpp,
CCAEDTH and BBREG2). All else is as in preset `ns3`, so that only the assessment differs.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from actors.ieee802154 import airtime_ns
from actors.radio.medium.medium import Medium
from actors.radio.medium.state import Outcome
from actors.radio.medium.traffic import Poisson
from actors.radio.medium.transceiver import Transceiver
from actors.radio.presets import preset
from actors.radio.propagation.indoor import IndoorPropagation
from benchmarks.radio.trials import SECOND
from benchmarks.statistics.measured import Measured, table_of


@dataclass(frozen=True)
class HardwareTask:
    """What is measured."""

    robots: int = 10
    sides: tuple[float, ...] = (3.0, 10.0, 20.0, 30.0)
    """Of the square, m."""
    loads: tuple[float, ...] = (0.1, 0.4)
    """G, of all robots together."""
    octets: int = 60
    seconds: int = 60
    draws: int = 10
    """Of where the robots stand."""


@dataclass(frozen=True)
class Cost:
    """One square and load."""

    side: float
    load: float
    textbook: float
    """Mean pair delivery."""
    firmware: float
    times_the_loss: float


def measure(task: HardwareTask | None = None) -> Measured:
    """What pairs deliver to one another with either assessment."""
    task = task or HardwareTask()
    costs = [cost(side, load, task) for side in task.sides for load in task.loads]
    figures = {"task": asdict(task), "costs": [asdict(one) for one in costs]}
    rows = [{name: f"{value:.3g}" for name, value in asdict(one).items()} for one in costs]
    return Measured(figures, (table_of(rows, "mean pair delivery, robots in a square"),))


def cost(side: float, load: float, task: HardwareTask) -> Cost:
    """Both assessments over the same places and arrivals."""
    textbook = replace(preset("ns3").transceiver, tx_power_dbm=-10.0)
    hardware = preset("beeclick").transceiver
    firmware = replace(textbook, cca=hardware.cca, cca_threshold_dbm=hardware.cca_threshold_dbm)
    means = [
        float(np.mean([delivery(settings, side, load, task, draw) for draw in range(task.draws)]))
        for settings in (textbook, firmware)
    ]
    return Cost(side, load, means[0], means[1], (1 - means[1]) / (1 - means[0]))


def delivery(settings: Transceiver, side: float, load: float, task: HardwareTask, draw: int) -> float:
    """Mean over all pairs: frames heard of those sent."""
    ns3 = preset("ns3")
    transceivers = [settings.numbered(address) for address in range(task.robots)]
    medium = Medium(transceivers, IndoorPropagation(ns3.propagation), ns3.phy, seed=draw, watched=())
    medium.place(np.random.default_rng(draw).uniform(0.0, side, (task.robots, 2)))
    for robot in range(task.robots):
        rate = load * SECOND / airtime_ns(task.octets) / task.robots
        medium.offer(robot, Poisson(task.octets, rate))
    medium.run(task.seconds * SECOND)
    heard, sent = medium.outcomes()[:, Outcome.HEARD].sum(), medium.counters()["sent"].sum()
    return float(heard / (sent * (task.robots - 1)))
