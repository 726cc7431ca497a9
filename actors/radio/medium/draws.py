"""Random numbers that are a function of what they are for: no stream, no order, no state.

The output function of SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number generators",
OOPSLA 2014; variant 13 of D. Stafford's mixers) is applied along the key. So one more transceiver, or
another step, changes no draw of anybody else.
"""

from typing import Final

import numpy as np

from actors.kernels import njit

BACKOFF: Final = 1
"""Key: transceiver, frame, try."""
RECEPTION: Final = 2
"""Key: sender, frame, receiver."""
ACK_RECEPTION: Final = 3
"""Key: sender of the frame that is acknowledged, that frame, receiver."""
ARRIVAL: Final = 4
"""Key: transceiver, number of the arrival."""

_GAMMA: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _mixed(state: np.uint64, word: int) -> np.uint64:
    z = (state ^ np.uint64(word)) + _GAMMA
    z = (z ^ (z >> _S30)) * _FIRST
    z = (z ^ (z >> _S27)) * _SECOND
    mixed: np.uint64 = z ^ (z >> _S31)
    return mixed


@njit(cache=True)  # type: ignore[untyped-decorator]
def drawn(seed: int, purpose: int, transceiver: int, frame: int, other: int) -> float:
    """The number in [0, 1) that belongs to this key; all whole numbers of up to 63 bits."""
    state = _mixed(np.uint64(purpose), seed)
    state = _mixed(_mixed(_mixed(state, transceiver), frame), other)
    return np.float64(state >> _S11) * 1.1102230246251565e-16
