"""Reference data of another radio simulator, and the same experiments in our medium, in preset `ns3`.

The data are folders of CSV files, one file per family, one row per run.

A point of a family consists of the rows with equal settings. Figures of several runs are means with standard
errors; figures of one run of many frames are shares with binomial errors.

`a_per`: one sender and one receiver over a loss. `b`, `c`, `d`: n contenders and a silent sink, with Poisson
arrivals of G/n each or always backlogged, a warm-up of 1 s, then 30 s measured (60 with hidden senders, 20
import dataclasses
from 35 senders on). `e`: two hidden senders with overlapping frames.
"""

import csv
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from actors.array_types import Floats
from actors.ieee802154 import airtime_ns
from actors.radio.medium.medium import Medium, PoissonTraffic, Propagation, Request, SaturatedTraffic
from actors.radio.medium.state import BROADCAST, Cca, EventKind, Outcome, PhyParameters, Transceiver
from actors.radio.propagation import IndoorPropagation
from actors.radio.radio_model import preset
from actors.runtime.errors import AcrcError

LATENCIES: Final = ("lat_mean_ms", "lat_p95_ms")
CONTENTION: Final = (
    "b_single_saturated", "b_single_saturated_ack", "c_contention", "c_macparams", "c_contention_spatial60m",
    "d_hidden", "d_hidden_delta10dB",
)  # fmt: skip
CAPTURE: Final = ("e_capture", "e_capture_fine", "e_capture_short_interferer")
FAMILIES: Final = ("a_per", *CONTENTION, *CAPTURE)
_SETTINGS: Final = ("minbe", "maxbe", "maxnb", "n", "psdu", "load")
_FIGURES: Final = (
    "pdr_gen", "pdr_tx", "allpairs_pdr_tx", "csma_fail_ratio", "chan_busy", "overlap_tx_ratio", *LATENCIES,
    "goodput_kbps",
)  # fmt: skip
_ERROR_RATE_SETTINGS: Final = ("psdu", "rx_dbm", "noise_dbm")
_CAPTURE_SETTINGS: Final = ("psdu0", "psdu1", "delta_db", "offset_us")


@dataclass(frozen=True)
class ReferenceEstimate:
    """A figure with its standard error and the degrees of freedom of the error (inf: known)."""

    value: float
    error: float
    freedom: float = math.inf


@dataclass(frozen=True)
class OperatingPoint:
    """One setting of a family."""

    family: str
    settings: Mapping[str, str]
    runs: int
    frames: int
    """Frames sent in all runs."""
    figures: Mapping[str, ReferenceEstimate]

    def __str__(self) -> str:
        """Return family and settings."""
        return f"{self.family} " + " ".join(f"{name}={value}" for name, value in self.settings.items())


def share(hits: float, of: int) -> ReferenceEstimate:
    """Return the share of hits in independent trials."""
    p = hits / of
    return ReferenceEstimate(p, math.sqrt(p * (1 - p) / of))


def mean_estimate(values: Sequence[float]) -> ReferenceEstimate:
    """Return the mean of a figure over runs."""
    if len(values) < 2:
        return ReferenceEstimate(values[0], math.inf, 1)
    return ReferenceEstimate(mean(values), stdev(values) / math.sqrt(len(values)), len(values) - 1)


def read_points(folder: Path, family: str) -> list[OperatingPoint]:
    """Return the points of a family in the order of its file; empty if the file is missing.

    Raises AcrcError if a column is missing or not a number.
    """
    path = folder / f"{family}.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("fixed", "1") == "1"]
    try:
        if family in CONTENTION:
            return _contention(family, rows)
        return [_binomial(family, row) for row in rows]
    except (KeyError, ValueError) as error:
        raise AcrcError(f"{path}: a row has a missing or non-numeric column: {error}.") from None


def _binomial(family: str, row: Mapping[str, str]) -> OperatingPoint:
    """Return the point of one run of many frames."""
    names = _ERROR_RATE_SETTINGS if family == "a_per" else _CAPTURE_SETTINGS
    if family == "a_per":
        frames = int(row["frames_sent"])
        figures = {"per": share(frames - int(row["frames_ok"]), frames)}
    else:
        frames = int(row["frames"])
        figures = {name: share(float(row[name]) * frames, frames) for name in ("pdr_first", "pdr_second")}
    return OperatingPoint(family, {name: row[name] for name in names}, 1, frames, figures)


def _contention(family: str, rows: Sequence[Mapping[str, str]]) -> list[OperatingPoint]:
    groups: dict[tuple[tuple[str, str], ...], list[Mapping[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple((name, row[name]) for name in _SETTINGS if name in row), []).append(row)
    return [
        OperatingPoint(
            family,
            dict(settings),
            len(runs),
            sum(int(run["generated"]) for run in runs),
            {name: mean_estimate([float(run[name]) for run in runs]) for name in _FIGURES},
        )
        for settings, runs in groups.items()
    ]


SECOND: Final = 1_000_000_000
NS3: Final = preset("ns3")
NS3_MAC_OCTETS: Final = 11
"""MAC octets of a frame in ns-3: short addresses and PAN compression."""
_SENSITIVITY_LEAD_DB: Final = 0.4066
"""Sensitivity minus noise in ns-3, dB."""
_BATCH: Final = 20_000


@dataclass(frozen=True)
class LossTable:
    """Propagation given by a table of losses, dB; transceiver i is at (i, 0)."""

    losses_db: Floats

    def loss_db(self, senders: Floats, receivers: Floats, most_db: float = math.inf) -> Floats:
        """Return the losses as `Propagation.loss_db`."""
        rows, columns = senders[:, 0].astype(np.intp), receivers[:, 0].astype(np.intp)
        return self.losses_db[np.ix_(rows, columns)]

    @property
    def places(self) -> Floats:
        """(n, 2): positions of the transceivers, m."""
        n = len(self.losses_db)
        return np.stack([np.arange(n, dtype=np.float64), np.zeros(n)], axis=1)


@dataclass(frozen=True)
class TrialScene:
    """Positions, settings and traffic of contending transceivers."""

    propagation: Propagation
    places: Floats
    """(senders + 1, 2), m; the last is the sink."""
    phy: PhyParameters
    settings: Transceiver
    octets: int
    load: float
    """Offered load G of all senders; inf: always backlogged."""
    acknowledged: bool
    seconds: int


def measure(point: OperatingPoint, times: int) -> Mapping[str, ReferenceEstimate]:
    """Measure the figures of a point with `times` as many frames."""
    if point.family == "a_per":
        return _measured_error_rate(point.settings, times * point.frames)
    if point.family in CAPTURE:
        return _measured_capture(point.settings, times * point.frames)
    stage = scene(point.family, point.settings)
    runs = [run_contention(stage, seed) for seed in range(1, times * point.runs + 1)]
    return {name: mean_estimate([run[name] for run in runs]) for name in runs[0]}


def scene(family: str, settings: Mapping[str, str]) -> TrialScene:
    """Return the experiment of a row of a contention family."""
    senders = int(settings["n"])
    fields = {"min_be": "minbe", "max_be": "maxbe", "max_backoffs": "maxnb"}
    overrides: dict[str, Any] = {
        field: int(settings[name]) for field, name in fields.items() if name in settings
    }
    transceiver = replace(NS3.transceiver, **overrides)
    load = math.inf if settings["load"] == "sat" else float(settings["load"])
    hidden = family.startswith("d_hidden")
    equal = np.full((senders + 1, senders + 1), 60.0)
    table = _hidden_losses(10.0 if family.endswith("delta10dB") else 0.0) if hidden else LossTable(equal)
    stage = TrialScene(
        propagation=table,
        places=table.places,
        phy=NS3.phy,
        settings=transceiver,
        octets=int(settings["psdu"]),
        load=load,
        acknowledged=family.endswith("_ack"),
        seconds=60 if hidden else 20 if senders >= 35 else 30,
    )
    if family != "c_contention_spatial60m":
        return stage
    return dataclasses.replace(
        stage,
        propagation=IndoorPropagation(NS3.propagation),
        places=_scattered_places(senders, 60.0),
        phy=replace(NS3.phy, noise_dbm=-85.0 - _SENSITIVITY_LEAD_DB),
        settings=replace(transceiver, cca_threshold_dbm=-75.0),
    )


def run_contention(stage: TrialScene, seed: int) -> dict[str, float]:
    """Run an experiment and return its figures."""
    sink = len(stage.places) - 1
    medium = Medium(
        [replace(stage.settings, address=i) for i in range(sink + 1)],
        stage.propagation, stage.phy, seed=seed, watched=[sink],
    )  # fmt: skip
    medium.place(stage.places)
    _offer_traffic(medium, stage, seed)
    medium.run(SECOND)
    before, heard_before, busy_before = medium.counters(), medium.outcomes()[:, Outcome.HEARD], medium.busy_ns
    events = medium.run((1 + stage.seconds) * SECOND)
    after, heard = medium.counters(), medium.outcomes()[:, Outcome.HEARD] - heard_before
    counted = {
        name: int(after[name].sum() - before[name].sum())
        for name in ("generated", "sent", "access_failures", "overlapping")
    }
    waited = events["instant_ns"] - events["asked_ns"]
    latency_ms = waited[(events["kind"] == EventKind.HEARD) & (events["transceiver"] == sink)] / 1e6
    sent = max(counted["sent"], 1)
    frames_s = len(latency_ms) / stage.seconds
    return {
        "pdr_gen": len(latency_ms) / max(counted["generated"], 1),
        "pdr_tx": len(latency_ms) / sent,
        "allpairs_pdr_tx": float(heard.sum()) / (sent * sink),
        "csma_fail_ratio": counted["access_failures"] / max(sent + counted["access_failures"], 1),
        "chan_busy": (medium.busy_ns - busy_before) / (stage.seconds * SECOND),
        "overlap_tx_ratio": counted["overlapping"] / sent,
        "lat_mean_ms": float(latency_ms.mean()) if latency_ms.size else 0.0,
        "lat_p95_ms": float(np.percentile(latency_ms, 95)) if latency_ms.size else 0.0,
        "goodput_kbps": frames_s * 8 * (stage.octets - NS3_MAC_OCTETS) / 1000,
    }


def _offer_traffic(medium: Medium, stage: TrialScene, seed: int) -> None:
    """Offer the traffic of all transceivers except the sink; backlogged senders begin at random phases."""
    sink = len(stage.places) - 1
    destination = sink if stage.acknowledged else BROADCAST
    phases = np.random.default_rng(seed).integers(0, SECOND // 10, sink).tolist()
    for sender in range(sink):
        if math.isinf(stage.load):
            medium.offer(
                sender, SaturatedTraffic(stage.octets, phases[sender], destination, stage.acknowledged)
            )
        else:
            rate = stage.load / (sink * airtime_ns(stage.octets) / SECOND)
            medium.offer(sender, PoissonTraffic(stage.octets, rate, destination, stage.acknowledged))


def _hidden_losses(weaker_db: float) -> LossTable:
    """Return losses with which 0 and 1 reach only 2; 1 is `weaker_db` weaker there than 0."""
    losses = np.full((3, 3), 200.0)
    losses[0, 2] = losses[2, 0] = 70.0
    losses[1, 2] = losses[2, 1] = 70.0 + weaker_db
    return LossTable(losses)


def _scattered_places(senders: int, side: float) -> Floats:
    """Return positions by a linear congruential generator, x before y; the last one is the centre."""
    state, draws = 1, []
    for _ in range(2 * (senders + 1)):
        state = (1103515245 * state + 12345) % 2**31
        draws.append(state / 2**31 * side)
    places = np.array(draws).reshape(-1, 2)
    places[senders] = side / 2
    return places


def _measured_error_rate(settings: Mapping[str, str], frames: int) -> Mapping[str, ReferenceEstimate]:
    octets = int(settings["psdu"])
    losses = LossTable(np.full((2, 2), -float(settings["rx_dbm"])))
    phy = replace(NS3.phy, noise_dbm=float(settings["noise_dbm"]))
    heard = _count_received(losses, phy, lambda k: [Request(k, 0, octets)], airtime_ns(octets), frames)
    return {"per": share(frames - heard[0], frames)}


def _measured_capture(settings: Mapping[str, str], frames: int) -> Mapping[str, ReferenceEstimate]:
    first, second = int(settings["psdu0"]), int(settings["psdu1"])
    offset_ns = round(float(settings["offset_us"]) * 1000)

    def overlapping(start_ns: int) -> list[Request]:
        return [Request(start_ns, 0, first), Request(start_ns + offset_ns, 1, second)]

    lasts_ns = airtime_ns(first) + offset_ns + airtime_ns(second)
    heard = _count_received(
        _hidden_losses(float(settings["delta_db"])), NS3.phy, overlapping, lasts_ns, frames
    )
    return {"pdr_first": share(heard[0], frames), "pdr_second": share(heard[1], frames)}


def _count_received(
    losses: LossTable,
    phy: PhyParameters,
    requests_of: Callable[[int], list[Request]],
    lasts_ns: int,
    frames: int,
) -> list[int]:
    """Count the frames of each sender that the last transceiver receives in separate rounds."""
    last, round_ns = len(losses.places) - 1, lasts_ns + SECOND // 50
    sender = replace(NS3.transceiver, cca=Cca.NEVER, min_be=0)
    transceivers = [replace(sender, address=address) for address in range(last + 1)]
    medium = Medium(transceivers, losses, phy, seed=frames, watched=[last])
    medium.place(losses.places)
    heard = np.zeros(last + 1, np.int64)
    for begin in range(0, frames, _BATCH):
        rounds = range(begin, min(begin + _BATCH, frames))
        requests = [request for k in rounds for request in requests_of(k * round_ns)]
        medium.submit(requests)
        events = medium.run(requests[-1].instant_ns + SECOND // 50)
        heard += np.bincount(events["other"][events["kind"] == EventKind.HEARD], minlength=last + 1)
    return [int(count) for count in heard[:last]]
