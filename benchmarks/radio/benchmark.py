"""The medium: how fast it is, what the firmware's clear channel assessment costs; or its figures, drawn."""

import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from actors.floor.map_file import load_map
from actors.ieee802154 import airtime_ns
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.radio.medium.medium import Medium, Poisson
from actors.radio.medium.state import Outcome, Transceiver
from actors.radio.propagation.indoor import IndoorPropagation
from actors.radio.radio_model import preset
from benchmarks.radio import plots
from benchmarks.radio.crowd import PER_FLOOR, frame_cost
from benchmarks.radio.trials import SECOND, LossTable
from benchmarks.statistics.measured import Measured, table_of

_CORRIDOR: Final = SHIPPED / "maps" / "corridor.yaml"
_SENDERS: Final = (1, 10, 50, 200)
_CROWDS: Final = (20, 50, 100, 200, 500)
_FRAMES_EACH: Final = 2000
"""About as many does a crowd send in one measurement."""
_LOADS: Final = (0.2, 0.8)
"""G, of all senders together; arrivals are Poisson."""
_OCTETS: Final = 60
_FRAMES: Final = 50_000
"""About as many are offered in one measurement of speed."""
_REPEATS: Final = 5
"""The median counts."""
_ROBOTS: Final = 10
"""Where assessments are compared: at random in a square, exponent 3, all at -10 dBm."""
_SIDES: Final = (3.0, 10.0, 20.0, 30.0)
"""Of the square, m."""
_PAIR_LOADS: Final = (0.1, 0.4)
_SECONDS: Final = 60
_DRAWS: Final = 10
"""Of where the robots stand."""


def measure(out: Path | None = None, data: Path | None = None, map_file: Path = _CORRIDOR) -> Measured:
    """Measure; or, with `out`, only draw the figures of docs/radio.md into that folder.

    `data`: a folder with figures of ns-3, for its dots. `map_file`: whose floor crowds and the last figure
    have.
    """
    if out is not None:
        return plots.draw(out, map_file, data)
    if data is not None:
        raise OptionError("--data: needs --out; without it nothing is drawn")
    speeds = [
        {"senders": senders, "load": load, "medium": round(_speed(senders, load))}
        for senders in _SENDERS
        for load in _LOADS
    ]
    crowds = [{"robots": robots, "us": _crowd(robots, map_file)} for robots in _CROWDS]
    costs = [_cost(side, load) for side in _SIDES for load in _PAIR_LOADS]
    rows = [{name: f"{value:.3g}" for name, value in one.items()} for one in costs]
    shown = (
        table_of(speeds, "the medium alone: frames on the air per CPU second"),
        table_of(
            [{"robots": one["robots"], "µs": f"{one['us']:.0f}"} for one in crowds],
            f"the medium alone, {PER_FLOOR} driving robots to each copy of the floor: CPU time of a frame",
        ),
        table_of(rows, "mean pair delivery, robots in a square"),
    )
    return Measured({"speeds": speeds, "crowds": crowds, "assessment": costs}, shown)


def _crowd(robots: int, map_file: Path) -> float:
    """CPU time of a frame, µs."""
    plan, seconds = load_map(map_file), -(-_FRAMES_EACH // robots)
    return median(frame_cost(plan, robots, seconds, seed) for seed in range(1, _REPEATS + 1))


def _speed(senders: int, load: float) -> float:
    return median(medium_speed(senders, load, _OCTETS, _FRAMES, seed) for seed in range(1, _REPEATS + 1))


def medium_speed(senders: int, load: float, octets: int, frames: int, seed: int = 1) -> float:
    """Frames on the air per CPU second of the medium, all transceivers in range of one another."""
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


def _cost(side: float, load: float) -> dict[str, float]:
    """What pairs deliver with a textbook's clear channel assessment and with the BEE-click firmware's.

    Textbook: energy from 10 dB above the sensitivity, or while receiving. Firmware: energy from -69 dBm alone
    (d3scomp/beeclickarm, MRF24J40.cpp, CCAEDTH and BBREG2). All else is as in preset `ns3`, also places and
    arrivals, so that only the assessment differs.
    """
    textbook = replace(preset("ns3").transceiver, tx_power_dbm=-10.0)
    hardware = preset("beeclick").transceiver
    firmware = replace(textbook, cca=hardware.cca, cca_threshold_dbm=hardware.cca_threshold_dbm)
    means = [
        float(np.mean([_delivery(settings, side, load, draw) for draw in range(_DRAWS)]))
        for settings in (textbook, firmware)
    ]
    loss = (1 - means[1]) / (1 - means[0])
    return {"side": side, "load": load, "textbook": means[0], "firmware": means[1], "times_the_loss": loss}


def _delivery(settings: Transceiver, side: float, load: float, draw: int) -> float:
    """Mean over all pairs: frames heard of those sent."""
    ns3 = preset("ns3")
    transceivers = [settings.numbered(address) for address in range(_ROBOTS)]
    medium = Medium(transceivers, IndoorPropagation(ns3.propagation), ns3.phy, seed=draw, watched=())
    medium.place(np.random.default_rng(draw).uniform(0.0, side, (_ROBOTS, 2)))
    for robot in range(_ROBOTS):
        medium.offer(robot, Poisson(_OCTETS, load * SECOND / airtime_ns(_OCTETS) / _ROBOTS))
    medium.run(_SECONDS * SECOND)
    heard, sent = medium.outcomes()[:, Outcome.HEARD].sum(), medium.counters()["sent"].sum()
    return float(heard / (sent * (_ROBOTS - 1)))
