"""Bit and frame errors of the 2.4 GHz O-QPSK PHY in white noise.

`BER = 8/15 · 1/16 · Σ_{k=2}^{16} (−1)^k C(16, k) exp(20 SINR (1/k − 1))` (IEEE 802.15.4-2006, E.4.1.8), as
ns-3 and INET have it. Both charge the 6 octets of preamble, delimiter and length like data; so does this.
"""

from math import comb
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.ieee802154 import PHY_HEADER_OCTETS
from actors.kernels import njit
from actors.portable import arrays

CLEAN: Final = 4.5
"""A SINR, linear, from which on no bit of any frame is lost: below 1e-19 per bit."""
_STEPS: Final = 4096
"""Of the table per unit of SINR: linear interpolation is then true to 1e-6 of the value."""


def bit_error_rate(sinr: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of a wrong bit at each signal to interference and noise ratio, linear; same shape."""
    k = np.arange(2, 17, dtype=np.float64)
    weights = np.array([(-comb(16, i) if i % 2 else comb(16, i)) for i in range(2, 17)], dtype=np.float64)
    terms = weights * arrays.exp(20.0 * np.asarray(sinr)[..., None] * (1.0 / k - 1.0))
    rate: NDArray[np.float64] = np.clip(8.0 / 15.0 / 16.0 * arrays.total(terms), 0.0, 0.5)
    return rate


def frame_error_rate(snr_db: NDArray[np.float64], octets: int) -> NDArray[np.float64]:
    """Probability that a frame of so many PSDU octets is lost at a constant ratio, dB; same shape."""
    bits = 8 * (octets + PHY_HEADER_OCTETS)
    log_right = arrays.log1p(-bit_error_rate(arrays.exp10(np.asarray(snr_db) / 10.0)))
    rate: NDArray[np.float64] = -arrays.expm1(bits * log_right)
    return rate


def _table() -> NDArray[np.float64]:
    log = arrays.log1p(-bit_error_rate(np.arange(int(CLEAN * _STEPS) + 2) / _STEPS))
    log.setflags(write=False)
    return log


_LOG_RIGHT: Final = _table()


@njit(cache=True)  # type: ignore[untyped-decorator]
def log_right(sinr: float) -> float:
    """Logarithm of the probability that a bit is right; for kernels. `sinr` ≥ 0, linear."""
    if sinr >= CLEAN:
        return 0.0
    place = sinr * _STEPS
    left = int(place)
    low = _LOG_RIGHT[left]
    between: float = low + (place - left) * (_LOG_RIGHT[left + 1] - low)
    return between
