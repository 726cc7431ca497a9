"""Normal and exponential draws, each from one uniform draw by the inverse distribution.

numpy's own use the C library's logarithm and exponential function in the tails.
"""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.kernels import kernel
from actors.portable import elementary
from actors.portable.compiled import log


def normals(generator: Generator, shape: int | tuple[int, ...]) -> Floats:
    """Return standard normal draws of this shape, within ±8.3."""
    draws = generator.random(shape)
    _to_normals(draws.reshape(-1))
    return draws


def normals_of_each(generators: Sequence[Generator], counts: Sequence[int]) -> Floats:
    """Return `counts` standard normal draws of each generator, concatenated: (sum of the counts,)."""
    draws = np.empty(sum(int(count) for count in counts))
    end = 0
    for generator, count in zip(generators, counts, strict=True):
        begin, end = end, end + count
        if count:
            generator.random(out=draws[begin:end])
    _to_normals(draws)
    return draws


def exponentials(generator: Generator, mean: float, count: int) -> Floats:
    """Return exponentially distributed draws with this mean, (count,), below 37 times the mean."""
    draws = generator.random(count)
    _to_exponentials(draws, mean)
    return draws


def uniforms(generator: Generator, low: float, high: float, count: int) -> Floats:
    """Return uniform draws from `low` to `high`, (count,)."""
    return low + (high - low) * generator.random(count)


@kernel
def _to_normals(draws: Floats) -> None:
    for i in range(draws.size):
        draws[i] = elementary.normal_quantile(draws[i])


@kernel
def _to_exponentials(draws: Floats, mean: float) -> None:
    for i in range(draws.size):
        draws[i] = -mean * log(1.0 - draws[i])


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    uniform = np.arange(200.0, dtype=np.float64) / 200.0
    normal, exponential = uniform.copy(), uniform.copy()
    _to_normals(normal)
    _to_exponentials(exponential, 3.0)
    return normal.tobytes() + exponential.tobytes()
