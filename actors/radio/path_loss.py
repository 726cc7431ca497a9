"""How strong a frame arrives: the two-slope path loss of IEEE 802.15.4-2006, Annex E.

`loss = near_loss + 10 near_exponent log10 d` up to the breakpoint, `far_loss + 10 far_exponent
log10(d / breakpoint)` beyond. Walls do not count: in the original simulation they cost about 1 dB each, and
it was the transmit power that kept the robots apart.
"""

import numpy as np
from numpy.typing import NDArray

from actors.radio.parameters import RadioParameters


def received_dbm(distances: NDArray[np.float64], parameters: RadioParameters) -> NDArray[np.float64]:
    """Received power, dBm, of a frame over each of the distances, m; same shape."""
    p = parameters
    d = np.maximum(distances, p.nearest)
    near = p.near_loss_db + 10.0 * p.near_exponent * np.log10(d)
    far = p.far_loss_db + 10.0 * p.far_exponent * np.log10(np.maximum(d / p.breakpoint, 1.0))
    received: NDArray[np.float64] = p.tx_power_dbm - np.where(d <= p.breakpoint, near, far)
    return received


def reach(parameters: RadioParameters) -> float:
    """The greatest distance, m, at which a frame is received in line of sight; 0 if there is none."""
    p = parameters
    budget_db = p.tx_power_dbm - p.sensitivity_dbm
    if budget_db >= p.far_loss_db and not np.isinf(p.breakpoint):
        return float(p.breakpoint * 10.0 ** ((budget_db - p.far_loss_db) / (10.0 * p.far_exponent)))
    distance = min(10.0 ** ((budget_db - p.near_loss_db) / (10.0 * p.near_exponent)), p.breakpoint)
    return float(distance) if distance >= p.nearest else 0.0
