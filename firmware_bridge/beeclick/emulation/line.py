"""A serial line that damages what it carries."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Disturbance:
    """Per byte, the probability that something happens to it."""

    change: float = 0.0
    """Another byte comes in its place."""
    drop: float = 0.0
    """It is missing."""
    insert: float = 0.0
    """A byte comes in front of it."""

    def apply(self, data: bytes, rng: np.random.Generator) -> bytes:
        """What comes of `data`."""
        if not data or not (self.change or self.drop or self.insert):
            return data
        chances = rng.random(len(data))
        noise = rng.integers(0, 256, len(data))
        out = bytearray()
        for byte, chance, other in zip(data, chances.tolist(), noise.tolist(), strict=True):
            if chance < self.change:
                out.append(other)
            elif chance < self.change + self.drop:
                continue
            elif chance < self.change + self.drop + self.insert:
                out += bytes((other, byte))
            else:
                out.append(byte)
        return bytes(out)


CLEAN = Disturbance()
"""A line as it should be."""
