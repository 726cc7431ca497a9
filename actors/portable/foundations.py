"""Check of the numpy, Python and compiler operations that cores assume to be exact."""

import math

import numpy as np

from actors.array_types import Floats
from actors.kernels import kernel
from actors.randomness import generator


@kernel
def _products(x: Floats, y: Floats, results: Floats) -> None:
    for i in range(x.size):
        results[i] = x[i] * y[i] + y[i]


@kernel
def _sum(x: Floats) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i] * x[i]
    return total


def fingerprint() -> dict[str, bytes]:
    """Return the operations' results for fixed inputs, which differ if a processor or library differs."""
    x = np.arange(-301.0, 300.0, dtype=np.float64) / 7.0 + 0.01
    y = 1.0 + np.square(x) / 3.0
    fused, draws = np.empty(x.size), generator(7, "fingerprint", "none")
    _products(x, y, fused)
    arrays = {
        "numpy.square": y,
        "numpy.divide": x / y,
        "numpy.sqrt": np.sqrt(y),
        "numpy.remainder": np.remainder(x * 17.0, 2 * np.pi),
        "numpy.rint": np.rint(x * 3.3),
        "numpy.cumsum": np.cumsum(y),
        "numpy.linspace": np.linspace(-0.1, 7.3, 57),
        "numpy.random": np.concatenate([draws.random(64), draws.integers(1000, size=64)]),
        "a product and a sum in a kernel": fused,
        "a sum in a kernel": np.array([_sum(x)]),
        "math.remainder": np.array([math.remainder(value * 17.0, math.tau) for value in x.tolist()]),
        "math.fsum": np.array([math.fsum(y.tolist())]),
    }
    return {name: np.asarray(values, np.float64).tobytes() for name, values in arrays.items()}
