"""The kernels' state before anything has happened."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.portable import arrays
from actors.radio.medium.state import (
    AGENDA,
    EVENT,
    FRAME,
    MEDIUM,
    NEVER,
    NOBODY,
    ROSTER,
    SETTINGS,
    TRANSCEIVER,
    MediumState,
)
from actors.radio.medium.transceiver import PhyParameters, Transceiver

_DUE_EACH = 8
"""One thing of the MAC, an acknowledgement, an arrival, and what has been called off but not yet come up."""
_EVENTS = 4096
_LEFT_OUT_DB: Final = -26.38
"""So far below noise a power is that raises it by 0.01 dB: 10 log10(10^0.001 - 1)."""


def milliwatts(dbm: Any) -> Any:
    """Power in mW; any shape."""
    return arrays.exp10(np.asarray(dbm, dtype=np.float64) / 10.0)


def initial_state(transceivers: Sequence[Transceiver], phy: PhyParameters, seed: int) -> MediumState:
    """All transceivers on, silent and listening."""
    n = len(transceivers)
    return MediumState(
        medium=_medium(transceivers, phy, seed)[0],
        transceivers=_transceivers(transceivers, phy),
        queue=np.zeros((n, max((t.queue for t in transceivers), default=1)), FRAME),
        agenda=np.zeros(_DUE_EACH * n + 1, AGENDA),
        rosters=np.zeros(n, ROSTER),
        gains_mw=np.zeros((n, n)),
        reached=np.zeros((n, n), np.int64),
        outcomes=np.zeros((n, n), np.uint8),
        withheld=np.zeros((n, n), np.int64),
        events=np.zeros(max(_EVENTS, 4 * n), EVENT),
    )


def _medium(transceivers: Sequence[Transceiver], phy: PhyParameters, seed: int) -> NDArray[np.void]:
    medium = np.zeros(1, MEDIUM)
    medium["seed"] = seed
    medium["noise_mw"] = milliwatts(phy.noise_dbm)
    medium["lock_sinr"] = milliwatts(phy.lock_sinr_db)
    medium["capture"] = milliwatts(phy.capture_db)
    medium["capture_ns"] = phy.capture_us * 1000
    medium["penalty"] = milliwatts(phy.cochannel_penalty_db)
    medium["peak_cca"] = phy.peak_cca
    medium["dead_ns"], medium["dead_octet_ns"] = phy.dead_us * 1000, phy.dead_octet_us * 1000
    medium["dead_octets"] = phy.dead_octets
    medium["faintest_dbm"] = _faintest_dbm(transceivers, phy)
    return medium


def _faintest_dbm(transceivers: Sequence[Transceiver], phy: PhyParameters) -> float:
    """All that is not followed of the frames in the air may be as strong as this at a receiver, together.

    It adds 0.01 dB to the noise, or to the least energy that makes the channel busy, and nobody could
    lock onto it.
    """
    least_dbm = min([phy.noise_dbm, *(one.cca_threshold_dbm for one in transceivers)])
    together_dbm = least_dbm + _LEFT_OUT_DB - max(phy.cochannel_penalty_db, 0.0)
    return min(together_dbm, phy.noise_dbm + phy.lock_sinr_db)


def _transceivers(transceivers: Sequence[Transceiver], phy: PhyParameters) -> NDArray[np.void]:
    records = np.zeros(len(transceivers), TRANSCEIVER)
    records["settings"] = _settings(transceivers, phy)
    records["mac"]["powered"] = True
    records["receiver"]["lock"] = NOBODY
    records["receiver"]["unlock_ns"] = -NEVER
    return records


def _settings(transceivers: Sequence[Transceiver], phy: PhyParameters) -> NDArray[np.void]:
    settings = np.zeros(len(transceivers), SETTINGS)
    settings["key"] = [t.address for t in transceivers]
    for name in ("min_be", "max_be", "max_backoffs", "max_retries", "cca"):
        settings[name] = [getattr(t, name) for t in transceivers]
    settings["cca_mw"] = milliwatts([t.cca_threshold_dbm for t in transceivers])
    settings["tx_dbm"] = [t.tx_power_dbm for t in transceivers]
    settings["capacity"] = [t.queue for t in transceivers]
    faintest = milliwatts(phy.lock_sinr_db + phy.noise_dbm)
    settings["floor_mw"] = np.maximum(milliwatts([t.sensitivity_dbm for t in transceivers]), faintest)
    settings["watched"] = True
    return settings
