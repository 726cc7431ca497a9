"""The medium's own answer to the points of a reference: the same experiments, in preset `ns3`.

`a_per`: one sender and one receiver over a loss. `b`, `c`, `d`: n contenders and a silent sink, with Poisson
arrivals of G/n each or always backlogged, a second to warm up, then 30 s measured (60 with hidden senders, 20
from 35 senders on). `e`: two hidden senders whose frames are made to overlap.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.ieee802154 import airtime_ns
from actors.radio.medium.medium import Medium, Poisson, Propagation, Request, Saturated
from actors.radio.medium.state import BROADCAST, Cca, Kind, Outcome, PhyParameters, Transceiver
from actors.radio.propagation.indoor import IndoorPropagation
from actors.radio.radio_model import preset
from benchmarks.radio.reference import CAPTURE, OperatingPoint, ReferenceEstimate, over_runs, share

SECOND: Final = 1_000_000_000
NS3: Final = preset("ns3")
NS3_MAC_OCTETS: Final = 11
"""Around the data of its frames: short addresses and PAN compression."""
_SENSITIVITY_LEAD_DB: Final = 0.4066
"""How far ns-3's noise lies below the sensitivity that it is given."""
_BATCH: Final = 20_000


class LossTable:
    """A propagation where transceiver i stands at (i, 0): the losses, dB, are given one by one."""

    def __init__(self, losses_db: NDArray[np.float64]) -> None:
        self._losses_db = losses_db

    def loss_db(
        self, senders: NDArray[np.float64], receivers: NDArray[np.float64], most_db: float = math.inf
    ) -> NDArray[np.float64]:
        """As `channel.Propagation` says."""
        rows, columns = senders[:, 0].astype(np.intp), receivers[:, 0].astype(np.intp)
        losses: NDArray[np.float64] = self._losses_db[np.ix_(rows, columns)]
        return losses

    @property
    def places(self) -> NDArray[np.float64]:
        """(n, 2): where the transceivers stand."""
        n = len(self._losses_db)
        return np.stack([np.arange(n, dtype=np.float64), np.zeros(n)], axis=1)


@dataclass(frozen=True)
class TrialScene:
    """Who contends, where, and how."""

    propagation: Propagation
    places: NDArray[np.float64]
    """(senders + 1, 2); the last is the sink."""
    phy: PhyParameters
    settings: Transceiver
    octets: int
    load: float
    """G, the share of the time that all frames together would take; inf: always backlogged."""
    acknowledged: bool
    seconds: int


def measure(point: OperatingPoint, times: int) -> Mapping[str, ReferenceEstimate]:
    """The same figures as the point's, from `times` as many frames."""
    if point.family == "a_per":
        return _error_rate(point.settings, times * point.frames)
    if point.family in CAPTURE:
        return _capture(point.settings, times * point.frames)
    stage = scene(point.family, point.settings)
    runs = [contend(stage, seed) for seed in range(1, times * point.runs + 1)]
    return {name: over_runs([run[name] for run in runs]) for name in runs[0]}


def scene(family: str, settings: Mapping[str, str]) -> TrialScene:
    """The experiment that a row of a family of contention is about."""
    senders = int(settings["n"])
    transceiver = replace(
        NS3.transceiver,
        min_be=int(settings.get("minbe", 3)),
        max_be=int(settings.get("maxbe", 5)),
        max_backoffs=int(settings.get("maxnb", 4)),
    )
    load = math.inf if settings["load"] == "sat" else float(settings["load"])
    hidden = family.startswith("d_hidden")
    table = _hidden(10.0 if family.endswith("delta10dB") else 0.0) if hidden else _equal(senders)
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
    return replace(
        stage,
        propagation=IndoorPropagation(NS3.propagation),
        places=_scattered(senders, 60.0),
        phy=replace(NS3.phy, noise_dbm=-85.0 - _SENSITIVITY_LEAD_DB),
        settings=replace(transceiver, cca_threshold_dbm=-75.0),
    )


def contend(stage: TrialScene, seed: int) -> dict[str, float]:
    """The figures of one run."""
    sink = len(stage.places) - 1
    medium = Medium(
        [replace(stage.settings, address=i) for i in range(sink + 1)],
        stage.propagation, stage.phy, seed=seed, watched=[sink],
    )  # fmt: skip
    medium.place(stage.places)
    _load(medium, stage, seed)
    medium.run(SECOND)
    before, heard_before, busy_before = medium.counters(), medium.outcomes()[:, Outcome.HEARD], medium.busy_ns
    events = medium.run((1 + stage.seconds) * SECOND)
    after, heard = medium.counters(), medium.outcomes()[:, Outcome.HEARD] - heard_before
    counted = {
        name: int(after[name].sum() - before[name].sum())
        for name in ("generated", "sent", "access_failures", "overlapping")
    }
    waited = events["instant_ns"] - events["asked_ns"]
    latency_ms = waited[(events["kind"] == Kind.HEARD) & (events["transceiver"] == sink)] / 1e6
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


def _load(medium: Medium, stage: TrialScene, seed: int) -> None:
    """Give all but the sink their traffic; backlogged ones begin at phases of their own."""
    sink = len(stage.places) - 1
    to = sink if stage.acknowledged else BROADCAST
    phases = np.random.default_rng(seed).integers(0, SECOND // 10, sink).tolist()
    for sender in range(sink):
        if math.isinf(stage.load):
            medium.offer(sender, Saturated(stage.octets, phases[sender], to, stage.acknowledged))
        else:
            rate = stage.load / (sink * airtime_ns(stage.octets) / SECOND)
            medium.offer(sender, Poisson(stage.octets, rate, to, stage.acknowledged))


def _equal(senders: int) -> LossTable:
    return LossTable(np.full((senders + 1, senders + 1), 60.0))


def _hidden(weaker_db: float) -> LossTable:
    """Senders 0 and 1 hear 2 only; 1 arrives there so much weaker than 0."""
    losses = np.full((3, 3), 200.0)
    losses[0, 2] = losses[2, 0] = 70.0
    losses[1, 2] = losses[2, 1] = 70.0 + weaker_db
    return LossTable(losses)


def _scattered(senders: int, side: float) -> NDArray[np.float64]:
    """Places by a linear congruential generator, x before y; the last one in the middle."""
    state, draws = 1, []
    for _ in range(2 * (senders + 1)):
        state = (1103515245 * state + 12345) % 2**31
        draws.append(state / 2**31 * side)
    places = np.array(draws).reshape(-1, 2)
    places[senders] = side / 2
    return places


def _error_rate(settings: Mapping[str, str], frames: int) -> Mapping[str, ReferenceEstimate]:
    octets = int(settings["psdu"])
    stage = replace(
        scene("b_single_saturated", {"n": "1", "psdu": settings["psdu"], "load": "sat"}),
        propagation=LossTable(np.full((2, 2), -float(settings["rx_dbm"]))),
        phy=replace(NS3.phy, noise_dbm=float(settings["noise_dbm"])),
    )
    requests = _forced(lambda k: [Request(k, 0, octets)], frames, airtime_ns(octets))
    heard = _heard(stage, requests, 1, frames)
    return {"per": share(frames - heard[0], frames)}


def _capture(settings: Mapping[str, str], frames: int) -> Mapping[str, ReferenceEstimate]:
    first, second = int(settings["psdu0"]), int(settings["psdu1"])
    late = round(float(settings["offset_us"]) * 1000)
    table = _hidden(float(settings["delta_db"]))
    transceiver = replace(NS3.transceiver, min_be=0)
    stage = TrialScene(
        propagation=table,
        places=table.places,
        phy=NS3.phy,
        settings=transceiver,
        octets=first,
        load=math.inf,
        acknowledged=False,
        seconds=0,
    )
    requests = _forced(
        lambda k: [Request(k, 0, first), Request(k + late, 1, second)],
        frames,
        airtime_ns(first) + late + airtime_ns(second),
    )
    heard = _heard(stage, requests, 2, frames)
    return {"pdr_first": share(heard[0], frames), "pdr_second": share(heard[1], frames)}


def _forced(one: Callable[[int], list[Request]], frames: int, lasts_ns: int) -> list[list[Request]]:
    """Rounds that do not touch one another, in batches of frames."""
    round_ns = lasts_ns + SECOND // 50
    starts = range(0, frames, _BATCH)
    return [
        [request for k in range(start, min(start + _BATCH, frames)) for request in one(k * round_ns)]
        for start in starts
    ]


def _heard(stage: TrialScene, batches: list[list[Request]], senders: int, frames: int) -> list[int]:
    """How many frames of each sender the last transceiver hears."""
    count = len(stage.places)
    transceivers = [replace(stage.settings, address=i, cca=Cca.NEVER, min_be=0) for i in range(count)]
    medium = Medium(transceivers, stage.propagation, stage.phy, seed=frames, watched=[count - 1])
    medium.place(stage.places)
    heard = np.zeros(count, np.int64)
    for batch in batches:
        medium.submit(batch)
        events = medium.run(batch[-1].instant_ns + SECOND // 50)
        said = events[events["kind"] == Kind.HEARD]
        heard += np.bincount(said["other"], minlength=count)
    return [int(count) for count in heard[:senders]]
