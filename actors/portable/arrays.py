"""The functions of this package over whole arrays, entry by entry: the same bits as one by one."""

from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actors.kernels import njit
from actors.portable import compiled

Floats: TypeAlias = NDArray[np.float64]


def _loop(function: Callable[[float], float]) -> Any:
    @njit(cache=True)  # type: ignore[untyped-decorator]
    def over(values: Floats, results: Floats) -> None:
        for i in range(values.size):
            results[i] = function(values[i])

    return over


_SIN: Final = _loop(compiled.sin)
_COS: Final = _loop(compiled.cos)
_EXP: Final = _loop(compiled.exp)
_EXP10: Final = _loop(compiled.exp10)
_EXPM1: Final = _loop(compiled.expm1)
_LOG: Final = _loop(compiled.log)
_LOG10: Final = _loop(compiled.log10)
_LOG1P: Final = _loop(compiled.log1p)
_ATAN: Final = _loop(compiled.atan)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _hypot(x: Floats, y: Floats, results: Floats) -> None:
    for i in range(x.size):
        results[i] = compiled.hypot(x[i], y[i])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _total(rows: Floats, results: Floats) -> None:
    for i in range(rows.shape[0]):
        total = 0.0
        for k in range(rows.shape[1]):
            total += rows[i, k]
        results[i] = total


def sin(x: ArrayLike) -> Floats:
    """Sines; same shape."""
    return _entries(_SIN, x)


def cos(x: ArrayLike) -> Floats:
    """Cosines; same shape."""
    return _entries(_COS, x)


def exp(x: ArrayLike) -> Floats:
    """e^x; same shape."""
    return _entries(_EXP, x)


def exp10(x: ArrayLike) -> Floats:
    """10^x; same shape."""
    return _entries(_EXP10, x)


def expm1(x: ArrayLike) -> Floats:
    """e^x − 1; same shape."""
    return _entries(_EXPM1, x)


def log(x: ArrayLike) -> Floats:
    """Natural logarithms; same shape."""
    return _entries(_LOG, x)


def log10(x: ArrayLike) -> Floats:
    """Decimal logarithms; same shape."""
    return _entries(_LOG10, x)


def log1p(x: ArrayLike) -> Floats:
    """ln(1 + x); same shape."""
    return _entries(_LOG1P, x)


def atan(x: ArrayLike) -> Floats:
    """Arctangents; same shape."""
    return _entries(_ATAN, x)


def hypot(x: ArrayLike, y: ArrayLike) -> Floats:
    """Lengths of the vectors (x, y), shapes as numpy broadcasts them."""
    wide = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    one, other = (np.ascontiguousarray(part) for part in wide)
    results = np.empty(wide[0].shape)
    _hypot(one.reshape(-1), other.reshape(-1), results.reshape(-1))
    return results


def total(x: ArrayLike) -> Floats:
    """Sums along the last axis, added from its first entry to its last; (…, n) gives (…)."""
    terms = np.ascontiguousarray(x, np.float64)
    results = np.empty(terms.shape[:-1])
    _total(terms.reshape(results.size, terms.shape[-1]), results.reshape(-1))
    return results


def _entries(kernel: Any, x: ArrayLike) -> Floats:
    values = np.array(x, np.float64, order="C")  # a copy, so that read-only ones need no kernel of their own
    results = np.empty(values.shape)
    kernel(values.reshape(-1), results.reshape(-1))
    return results


def fingerprint() -> dict[str, bytes]:
    """What the functions give for fixed inputs: differs where a processor or compiler does otherwise."""
    x = np.arange(-40.0, 40.0) * 0.37 + 0.11
    positive = x * x
    results = {function.__name__: function(x) for function in (sin, cos, exp, exp10, expm1, atan)}
    results |= {function.__name__: function(positive) for function in (log, log10, log1p)}
    results |= {"hypot": hypot(x, positive), "total": total([x * positive])}
    return {name: result.tobytes() for name, result in results.items()}
