"""The portable functions: how far off exact values, and how fast beside the C library's, in kernels."""

import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.portable import compiled
from actors.runtime.errors import AcrcError
from benchmarks.statistics.measured import Measured, table_of

Floats: TypeAlias = NDArray[np.float64]

_EXACT: Final = 160
"""Bits of the exact values; no float is nearer to a rounding boundary of these functions than 2^-120."""
_ROUNDS: Final = 200


@dataclass(frozen=True)
class Function:
    """One of them."""

    name: str
    bound: float
    """What its docstring states, in units of the last place (ulp)."""
    hard: Callable[[np.random.Generator, int], tuple[Floats, ...]]
    """Arguments for the error: all sizes, and those that are hard."""
    usual: Callable[[np.random.Generator, int], tuple[Floats, ...]]
    """Arguments for the speed: as robots have them."""


def _even(low: float, high: float) -> Callable[[np.random.Generator, int], tuple[Floats, ...]]:
    return lambda rng, count: (rng.uniform(low, high, count),)


def _sizes(rng: np.random.Generator, count: int, least: int, most: int) -> Floats:
    """Positive floats whose exponents are evenly spread."""
    return np.ldexp(rng.uniform(1.0, 2.0, count), rng.integers(least, most, count))


def _angles(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    near = np.rint(rng.uniform(-600_000, 600_000, count)) * (math.pi / 2)  # where sine or cosine is 0
    parts = [rng.uniform(-7, 7, count), rng.uniform(-1e6, 1e6, count), near, _sizes(rng, count, -60, 0)]
    return (np.concatenate(parts),)


def _exponents(low: float, high: float) -> Callable[[np.random.Generator, int], tuple[Floats, ...]]:
    def draws(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
        small = _sizes(rng, count, -60, 0)
        return (np.concatenate([rng.uniform(-1, 1, count), rng.uniform(low, high, count), small, -small]),)

    return draws


def _positive(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    near_one = 1.0 + _sizes(rng, count, -50, -1) * rng.choice([-1.0, 0.5], count)
    return (np.concatenate([rng.uniform(0.5, 2.0, count), _sizes(rng, count, -1070, 1020), near_one]),)


def _above_minus_one(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    parts = [rng.uniform(-1, 2, count), _sizes(rng, count, -300, 1020), -_sizes(rng, count, -300, -1)]
    return (np.concatenate(parts),)


def _shares(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    small = _sizes(rng, count, -100, -1)
    return (np.concatenate([rng.uniform(-1, 1, count), small, 1.0 - small, small - 1.0]),)


def _all_sizes(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    return (np.concatenate([rng.uniform(-4, 4, count), _sizes(rng, count, -100, 100)]),)


def _vectors(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    signs = rng.choice([-1.0, 1.0], (2, count))
    x = np.concatenate([rng.uniform(-5, 5, count), _sizes(rng, count, -1000, 1000) * signs[0]])
    y = np.concatenate([rng.uniform(-5, 5, count), _sizes(rng, count, -1000, 1000) * signs[1]])
    return x, y


def _usual_vectors(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    return rng.uniform(-5, 5, count), rng.uniform(-5, 5, count)


FUNCTIONS: Final = (
    Function("sin", 1.0, _angles, _even(-math.pi, math.pi)),
    Function("cos", 1.0, _angles, _even(-math.pi, math.pi)),
    Function("tan", 2.5, _angles, _even(-math.pi, math.pi)),
    Function("exp", 1.0, _exponents(-745.0, 709.7), _even(-5.0, 1.0)),
    Function("exp10", 1.0, _exponents(-323.0, 308.2), _even(-12.0, 1.0)),
    Function("expm1", 2.5, _exponents(-50.0, 709.7), _even(-5.0, 1.0)),
    Function("log", 1.0, _positive, _even(0.01, 30.0)),
    Function("log10", 1.0, _positive, _even(0.01, 30.0)),
    Function("log1p", 1.0, _above_minus_one, _even(-0.9, 3.0)),
    Function("atan", 1.0, _all_sizes, _even(-3.0, 3.0)),
    Function("atan2", 1.5, _vectors, _usual_vectors),
    Function("asin", 2.5, _shares, _even(-1.0, 1.0)),
    Function("acos", 2.5, _shares, _even(-1.0, 1.0)),
    Function("hypot", 1.25, _vectors, _usual_vectors),
)


def largest_error(function: Function, count: int, seed: int = 1) -> float:
    """The largest error found, ulp, over about `count` arguments of each kind; needs mpmath."""
    import mpmath  # noqa: PLC0415 - of the development tools

    arguments = function.hard(np.random.default_rng(seed), count)
    results = np.empty(arguments[0].shape)
    loop(getattr(compiled, function.name), len(arguments))(*arguments, results)
    worst = 0.0
    with mpmath.workprec(_EXACT):
        exact = _reference(mpmath, function.name)
        for *values, result in zip(*(x.tolist() for x in arguments), results.tolist(), strict=True):
            worst = max(worst, _distance(result, exact(*map(mpmath.mpf, values))))
    return worst


def _reference(mpmath: Any, name: str) -> Callable[..., Any]:
    if name == "exp10":
        return lambda x: mpmath.mpf(10) ** x
    if name == "log10":
        return lambda x: mpmath.log(x) / mpmath.log(10)
    exact: Callable[..., Any] = getattr(mpmath, name)
    return exact


def _distance(result: float, exact: Any) -> float:
    """In units of the last place of the float next to the exact value."""
    nearest = float(exact)
    if result == nearest:
        return float(abs(exact - nearest) / math.ulp(nearest)) if math.isfinite(nearest) else 0.0
    return float(abs(exact - result) / math.ulp(nearest)) if math.isfinite(result) else math.inf


@lru_cache
def loop(function: Callable[..., float], arguments: int) -> Any:
    """A kernel that calls a function of so many arguments for each entry; its last argument: the results."""
    if arguments == 1:

        @njit  # type: ignore[untyped-decorator]
        def one(x: Floats, results: Floats) -> None:
            for i in range(x.size):
                results[i] = function(x[i])

        return one

    @njit  # type: ignore[untyped-decorator]
    def two(x: Floats, y: Floats, results: Floats) -> None:
        for i in range(x.size):
            results[i] = function(x[i], y[i])

    return two


def _power_of_ten() -> Any:
    @njit  # type: ignore[untyped-decorator]
    def one(x: Floats, results: Floats) -> None:
        for i in range(x.size):
            results[i] = 10.0 ** x[i]

    return one


def times(function: Function, count: int = 10_000, rounds: int = _ROUNDS) -> tuple[float, float]:
    """ns per call in a kernel, ours and the C library's; alternating, the best of all rounds."""
    arguments = function.usual(np.random.default_rng(1), count)
    ours = loop(getattr(compiled, function.name), len(arguments))
    if function.name == "exp10":
        library = _power_of_ten()
    else:
        library = loop(getattr(math, function.name), len(arguments))
    results = np.empty(count)
    best = [math.inf, math.inf]
    for _ in range(rounds + 1):  # the first compiles
        for which, kernel in enumerate((ours, library)):
            begun = time.perf_counter()
            kernel(*arguments, results)
            best[which] = min(best[which], time.perf_counter() - begun)
    return best[0] / count * 1e9, best[1] / count * 1e9


def check(count: int) -> Measured:
    """The largest error over about so many arguments of each kind; it holds where each is within bounds."""
    if importlib.util.find_spec("mpmath") is None:
        raise AcrcError("exact values need the package mpmath, which the extra dev has")
    errors = [largest_error(one, count) for one in FUNCTIONS]
    rows = [
        {"name": one.name, "bound": one.bound, "error": round(error, 4)}
        for one, error in zip(FUNCTIONS, errors, strict=True)
    ]
    holds = all(error <= one.bound for one, error in zip(FUNCTIONS, errors, strict=True))
    return Measured(rows, (table_of(rows, "error, ulp"),), holds)


def measure(rounds: int = _ROUNDS) -> Measured:
    """The time of each beside the C library's; the best of so many rounds."""
    rows = []
    for one in FUNCTIONS:
        ours, library = times(one, rounds=rounds)
        ratio = round(ours / library, 2)
        rows.append(
            {"name": one.name, "ours_ns": round(ours, 1), "library_ns": round(library, 1), "ratio": ratio}
        )
    return Measured(rows, (table_of(rows, "a call, beside the C library's"),))
