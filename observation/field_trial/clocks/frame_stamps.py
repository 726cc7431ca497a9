"""What clocks say of radio frames."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class StampKind(IntEnum):
    """What a stamp says of its frame."""

    HEARD = 0
    SENT = 1
    """Confirmed by the sender's transceiver."""
    HANDED = 2
    """Given to the sender's transceiver, before it has left."""


class Stamp(NamedTuple):
    """One clock's word on one frame."""

    clock: int
    instant: int
    """µs, by that clock."""
    kind: StampKind


class StampedFrame(NamedTuple):
    """One frame and its stamps, by at least two clocks."""

    stamps: tuple[Stamp, ...]
    handed: Stamp | None
    """When it was handed over, whether or not that is among the stamps."""


class Pairs(NamedTuple):
    """Two stamps of one frame each, as arrays."""

    first: NDArray[np.int64]
    """(n, 4): clock, instant, kind, number of the frame."""
    second: NDArray[np.int64]
    weight: NDArray[np.float64]
    """2 / number of the frame's stamps: all pairs of n stamps know as much as n - 1 of them."""


def pairs_of(frames: Sequence[StampedFrame], most: int) -> Pairs:
    """All pairs of stamps of each frame; if there are more than `most`, those of every n-th frame only."""
    sizes = [len(frame.stamps) * (len(frame.stamps) - 1) // 2 for frame in frames]
    stride = -(-sum(sizes) // most) or 1
    first, second, weight = [], [], []
    for number, frame in enumerate(frames):
        if number % stride:
            continue
        for later, one in enumerate(frame.stamps):
            for other in frame.stamps[:later]:
                first.append((*one, number))
                second.append((*other, number))
                weight.append(2 / len(frame.stamps))
    return Pairs(
        np.array(first, dtype=np.int64).reshape(-1, 4),
        np.array(second, dtype=np.int64).reshape(-1, 4),
        np.array(weight, dtype=np.float64),
    )
