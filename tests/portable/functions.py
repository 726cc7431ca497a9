"""Portable functions with the arguments that test them, and their errors against mpmath."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TypeAlias

import mpmath
import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.portable import compiled

Floats: TypeAlias = NDArray[np.float64]

_EXACT: Final = 160
"""Bits of the exact values; no float is nearer to a rounding boundary of these functions than 2^-120."""


@dataclass(frozen=True)
class Function:
    """One function."""

    name: str
    bound: float
    """Error that its docstring states, in units of the last place (ulp)."""
    arguments: Callable[[np.random.Generator, int], tuple[Floats, ...]]
    """Draws arguments of all sizes, and difficult ones."""


def _sizes(rng: np.random.Generator, count: int, least: int, most: int) -> Floats:
    """Return positive floats with evenly spread exponents."""
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


FUNCTIONS: Final = (
    Function("sin", 1.0, _angles),
    Function("cos", 1.0, _angles),
    Function("tan", 2.5, _angles),
    Function("exp", 1.0, _exponents(-745.0, 709.7)),
    Function("exp10", 1.0, _exponents(-323.0, 308.2)),
    Function("expm1", 2.5, _exponents(-50.0, 709.7)),
    Function("log", 1.0, _positive),
    Function("log10", 1.0, _positive),
    Function("log1p", 1.0, _above_minus_one),
    Function("atan", 1.0, _all_sizes),
    Function("atan2", 1.5, _vectors),
    Function("asin", 2.5, _shares),
    Function("acos", 2.5, _shares),
    Function("hypot", 1.25, _vectors),
)


def largest_error(function: Function, count: int, seed: int = 1) -> float:
    """Return the largest error, ulp, over about `count` arguments of each kind."""
    arguments = function.arguments(np.random.default_rng(seed), count)
    results = np.empty(arguments[0].shape)
    loop(getattr(compiled, function.name), len(arguments))(*arguments, results)
    worst = 0.0
    with mpmath.workprec(_EXACT):
        exact = _reference(function.name)
        for *values, result in zip(*(x.tolist() for x in arguments), results.tolist(), strict=True):
            worst = max(worst, _distance(result, exact(*map(mpmath.mpf, values))))
    return worst


def _reference(name: str) -> Callable[..., Any]:
    if name == "exp10":
        return lambda x: mpmath.mpf(10) ** x
    if name == "log10":
        return lambda x: mpmath.log(x) / mpmath.log(10)
    exact: Callable[..., Any] = getattr(mpmath, name)
    return exact


def _distance(result: float, exact: Any) -> float:
    """Return the distance in units of the last place of the float next to the exact value."""
    nearest = float(exact)
    if result == nearest:
        return float(abs(exact - nearest) / math.ulp(nearest)) if math.isfinite(nearest) else 0.0
    return float(abs(exact - result) / math.ulp(nearest)) if math.isfinite(result) else math.inf


@lru_cache
def loop(function: Callable[..., float], arguments: int) -> Any:
    """Return a kernel that writes the function of each entry to its last argument."""
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
