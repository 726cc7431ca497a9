"""The functions of this package on arrays, entry by entry, with the same bits.

Few entries are computed by Python until some kernel loads numba, which takes longer.
"""

import sys
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from actors.array_types import Floats
from actors.kernels import kernel, njit
from actors.portable import compiled

_FEW: Final = 4096
"""Maximum number of different entries that Python computes."""


def _by_entry(function: Callable[[float], float]) -> Callable[[ArrayLike], Floats]:
    """Return the function applied to each entry of an array; same shape."""

    @njit()  # type: ignore[untyped-decorator]
    def over(values: Floats, results: Floats) -> None:
        for i in range(values.size):
            results[i] = function(values[i])

    def by_entry(x: ArrayLike) -> Floats:
        values = np.array(x, np.float64, order="C")  # a copy, as read-only arrays would need separate kernels
        if "numba" not in sys.modules:
            bits, place = np.unique(values.view(np.int64), return_inverse=True)  # -0.0 is not 0.0
            if bits.size <= _FEW:
                different = [function(one) for one in bits.view(np.float64).tolist()]
                return np.array(different, np.float64)[place].reshape(values.shape)
        results = np.empty(values.shape)
        over.call(values.reshape(-1), results.reshape(-1))
        return results

    return by_entry


sin: Final = _by_entry(compiled.sin)
cos: Final = _by_entry(compiled.cos)
exp: Final = _by_entry(compiled.exp)
exp10: Final = _by_entry(compiled.exp10)
expm1: Final = _by_entry(compiled.expm1)
log: Final = _by_entry(compiled.log)
log10: Final = _by_entry(compiled.log10)
log1p: Final = _by_entry(compiled.log1p)
atan: Final = _by_entry(compiled.atan)


@kernel
def _hypot(x: Floats, y: Floats, results: Floats) -> None:
    for i in range(x.size):
        results[i] = compiled.hypot(x[i], y[i])


def hypot(x: ArrayLike, y: ArrayLike) -> Floats:
    """Return the lengths of the vectors (x, y), broadcast as in numpy."""
    wide = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    one, other = (np.ascontiguousarray(part, np.float64) for part in wide)
    results = np.empty(wide[0].shape)
    if "numba" not in sys.modules and results.size <= _FEW:
        pairs = zip(one.flat, other.flat, strict=True)
        results.reshape(-1)[:] = [compiled.hypot(float(x), float(y)) for x, y in pairs]
        return results
    _hypot(one.reshape(-1), other.reshape(-1), results.reshape(-1))
    return results


def total(x: ArrayLike) -> Floats:
    """Return the sums along the last axis, added in order; (…, n) to (…)."""
    terms = np.asarray(x, np.float64)
    results = np.zeros(terms.shape[:-1])
    for term in np.moveaxis(terms, -1, 0):
        results += term
    return results


def fingerprint() -> dict[str, bytes]:
    """Return the functions' results for fixed inputs, which differ if a processor computes differently."""
    x = np.arange(-40.0, 40.0) * 0.37 + 0.11
    positive = x * x
    _hypot(np.zeros(1), np.zeros(1), np.zeros(1))  # loads numba
    results = {"sin": sin(x), "cos": cos(x), "exp": exp(x), "exp10": exp10(x), "expm1": expm1(x)}
    results |= {"atan": atan(x), "log": log(positive), "log10": log10(positive), "log1p": log1p(positive)}
    results |= {"hypot": hypot(x, positive), "total": total([x * positive])}
    return {name: result.tobytes() for name, result in results.items()}
