"""Whether what a robot senses should cross a network compressed: what that saves, and what it takes."""

import time
import zlib
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median
from typing import Final

from observation.recordings.topics import messages

_LEVEL: Final = 1
"""zlib's fastest."""
_KEY: Final = "r1/senses"
_REPEATS: Final = 5


@dataclass(frozen=True)
class CompressionFigures:
    """Of one robot's messages of a run."""

    bytes: float
    """Of a message, on average."""
    packed_bytes: float
    both_ways_ms: float
    """Packing one and unpacking it, ms."""

    @property
    def pays_below_mbit_s(self) -> float:
        """On a slower network the time saved is more than the time taken."""
        return max(self.bytes - self.packed_bytes, 0.0) * 8 / 1e3 / self.both_ways_ms

    @property
    def sentence(self) -> str:
        """For a person."""
        return (
            f"A robot senses {self.bytes:.0f} B in a step; zlib makes them "
            f"{1 - self.packed_bytes / self.bytes:.0%} smaller in {self.both_ways_ms:.3f} ms both ways, "
            f"which pays below {self.pays_below_mbit_s:.0f} Mbit/s"
        )


def compression(out: Path) -> CompressionFigures:
    """Of a run's folder. Raises RecordingError."""
    payloads = [one.payload for one in messages(out, _KEY) if one.payload is not None]
    packed = [zlib.compress(payload, _LEVEL) for payload in payloads]
    taken = []
    for _ in range(_REPEATS):
        began = time.perf_counter()
        for payload in payloads:
            zlib.decompress(zlib.compress(payload, _LEVEL))
        taken.append((time.perf_counter() - began) / len(payloads))
    return CompressionFigures(mean(map(len, payloads)), mean(map(len, packed)), 1000 * median(taken))
