"""The kernels' state before anything has happened."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.portable import arrays
from actors.radio.medium.state import (
    AGENDA,
    AIR,
    EVENT,
    FRAME,
    NEVER,
    NOBODY,
    NODE,
    RECEIVER,
    MediumState,
)
from actors.radio.medium.transceiver import PhyParameters, Transceiver

_DUE_PER_NODE = 8
"""One thing of the MAC, an acknowledgement, an arrival, and what has been called off but not yet come up."""
_EVENTS = 4096


def milliwatts(dbm: Any) -> Any:
    """Power in mW; any shape."""
    return arrays.exp10(np.asarray(dbm, dtype=np.float64) / 10.0)


def initial_state(transceivers: Sequence[Transceiver], phy: PhyParameters, seed: int) -> MediumState:
    """All nodes on, silent and listening."""
    n = len(transceivers)
    return MediumState(
        air=_air(phy, seed)[0],
        nodes=_nodes(transceivers),
        receivers=_receivers(transceivers, phy),
        queue=np.zeros((n, max((t.queue for t in transceivers), default=1)), FRAME),
        agenda=np.zeros(_DUE_PER_NODE * n + 1, AGENDA),
        gains_mw=np.zeros((n, n)),
        fate=np.zeros((n, n), np.uint8),
        events=np.zeros(max(_EVENTS, 4 * n), EVENT),
    )


def _air(phy: PhyParameters, seed: int) -> NDArray[np.void]:
    air = np.zeros(1, AIR)
    air["seed"] = seed
    air["noise_mw"] = milliwatts(phy.noise_dbm)
    air["lock_sinr"] = milliwatts(phy.lock_sinr_db)
    air["capture"] = milliwatts(phy.capture_db)
    air["capture_ns"] = phy.capture_us * 1000
    air["penalty"] = milliwatts(phy.cochannel_penalty_db)
    air["peak_cca"] = phy.peak_cca
    air["dead_ns"], air["dead_octet_ns"] = phy.dead_us * 1000, phy.dead_octet_us * 1000
    air["dead_octets"] = phy.dead_octets
    return air


def _nodes(transceivers: Sequence[Transceiver]) -> NDArray[np.void]:
    nodes = np.zeros(len(transceivers), NODE)
    nodes["key"] = [t.address for t in transceivers]
    for name in ("min_be", "max_be", "max_backoffs", "max_retries", "cca"):
        nodes[name] = [getattr(t, name) for t in transceivers]
    nodes["cca_mw"] = milliwatts([t.cca_threshold_dbm for t in transceivers])
    nodes["capacity"] = [t.queue for t in transceivers]
    nodes["watched"] = nodes["powered"] = True
    return nodes


def _receivers(transceivers: Sequence[Transceiver], phy: PhyParameters) -> NDArray[np.void]:
    receivers = np.zeros(len(transceivers), RECEIVER)
    faintest = milliwatts(phy.lock_sinr_db + phy.noise_dbm)
    receivers["floor_mw"] = np.maximum(milliwatts([t.sensitivity_dbm for t in transceivers]), faintest)
    receivers["lock"] = NOBODY
    receivers["unlock_ns"] = -NEVER
    return receivers
