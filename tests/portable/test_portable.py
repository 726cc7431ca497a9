"""Portable functions with the arguments that test them, and their errors against mpmath."""

import math
import re
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TypeAlias

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray
from scipy import stats

from actors import kernel_dispatchers, portable
from actors.portable import arrays, compiled, elementary
from actors.portable.draws import exponentials, normals, normals_of_each, uniforms
from actors.portable.elementary import normal_quantile
from actors.randomness import generator

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
    """Draws arguments of all magnitudes, and difficult ones."""


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


assert kernel_dispatchers, "registers the functions with numba"


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


EDGES = [0.0, 5e-324, 2.2250738585072014e-308, 0.25, 0.7853981633974483, 1.0, 1.5, 1e6, 2.0**31, 1e22, 1e308]
EDGES += [math.inf, 709.782712893384, 745.1332191019411, 308.2547155599167, 323.3]
BOTH = [sign * edge for edge in EDGES for sign in (1.0, -1.0)] + [math.nan]


def bits(values: Any) -> list[int]:
    return [int(word) for word in np.asarray(values, np.float64).reshape(-1).view(np.int64)]


def each(function: Callable[..., float], arguments: tuple[Any, ...]) -> Any:
    """Apply the function to all arguments in a kernel."""
    results = np.empty(arguments[0].size)
    loop(function, len(arguments))(*arguments, results)
    return results


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda one: str(one.name))
def test_python_kernels_and_arrays_agree(function: Function, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = function.arguments(np.random.default_rng(3), 100)
    if len(usual) == 1:
        arguments: tuple[Any, ...] = (np.concatenate([usual[0], BOTH]),)
    else:
        one, other = (table.ravel() for table in np.meshgrid(BOTH, BOTH))
        arguments = (np.concatenate([usual[0], one]), np.concatenate([usual[1], other]))
    plain = [
        getattr(portable, function.name)(*row) for row in zip(*(x.tolist() for x in arguments), strict=True)
    ]
    assert all(type(value) is float for value in plain)
    kernel = each(getattr(compiled, function.name), arguments)
    assert np.array_equal(np.isnan(plain), np.isnan(kernel))
    numbers = ~np.isnan(kernel)
    assert bits(np.array(plain)[numbers]) == bits(kernel[numbers])
    if array := getattr(arrays, function.name, None):
        assert bits(array(*arguments)[numbers]) == bits(kernel[numbers])
        monkeypatch.delitem(sys.modules, "numba")
        few = [values[None, :1000] for values in arguments]
        assert bits(array(*few).reshape(-1)[numbers[:1000]]) == bits(kernel[:1000][numbers[:1000]])


@settings(max_examples=300, deadline=None)
@given(st.floats())
def test_cos_sin_equals_cos_and_sin(x: float) -> None:
    assert bits(portable.cos_sin(x)) == bits([portable.cos(x), portable.sin(x)])


@settings(max_examples=200, deadline=None)
@given(st.floats(min_value=5e-324, allow_infinity=False))
def test_split_and_ldexp_are_inverse(x: float) -> None:
    m, k = elementary.split(x)
    assert math.sqrt(0.5) <= m < math.sqrt(2) and math.ldexp(m, k) == x


def test_special_arguments_of_ieee_754() -> None:
    inf, nan = math.inf, math.nan
    assert [portable.exp(x) for x in (inf, -inf, 710.0, -746.0, 0.0)] == [inf, 0.0, inf, 0.0, 1.0]
    assert [portable.exp10(x) for x in (inf, -inf, 2.0, -1.0, 0.0)] == [inf, 0.0, 100.0, 0.1, 1.0]
    assert [portable.expm1(x) for x in (inf, -inf, -60.0, 0.0)] == [inf, -1.0, -1.0, 0.0]
    assert [portable.log(x) for x in (0.0, 1.0, inf)] == [-inf, 0.0, inf]
    assert [portable.log10(x) for x in (0.0, 1.0, 1000.0, 1e22, inf)] == [-inf, 0.0, 3.0, 22.0, inf]
    assert [portable.log1p(x) for x in (-1.0, 0.0, inf)] == [-inf, 0.0, inf]
    assert [portable.atan(x) for x in (inf, -inf)] == [math.pi / 2, -math.pi / 2]
    assert [portable.hypot(*v) for v in ((nan, inf), (3.0, 4.0), (0.0, 0.0))] == [inf, 5.0, 0.0]
    bad = [getattr(portable, name)(nan) for name in ("exp", "cos", "sin", "tan", "log", "asin", "atan")]
    bad += [portable.log(-1.0), portable.log1p(-2.0), portable.asin(1.1), portable.acos(-1.1)]
    bad += [portable.sin(inf), portable.tan(-inf)]
    bad += [portable.hypot(nan, 1.0), portable.atan2(nan, 0)]
    assert all(math.isnan(value) for value in bad)
    zeros = [(y, x) for y in (0.0, -0.0) for x in (0.0, -0.0, 1.0, -1.0)] + [(1.0, 0.0), (-1.0, -0.0)]
    assert bits([portable.atan2(*v) for v in zeros]) == bits([math.atan2(*v) for v in zeros])


def test_huge_angles_keep_their_direction() -> None:
    for x in (1e7, -1e15, 1e300):
        c, s = portable.cos_sin(x)
        assert abs(c * c + s * s - 1.0) < 1e-15
    assert abs(portable.sin(1e9) - math.sin(1e9)) < 1e-7


def test_sums_are_left_to_right() -> None:
    scales = 10.0 ** np.arange(1000)[None, ::-1].clip(0, 20)
    terms = np.random.default_rng(5).uniform(-1, 1, (3, 1000)) * scales
    assert arrays.total(terms).tolist() == np.cumsum(terms, axis=1)[:, -1].tolist()
    assert arrays.total(np.empty((2, 0))).tolist() == [0.0, 0.0]
    assert arrays.total([1.0, 2.0]).shape == ()


@pytest.mark.claim("functions")
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda one: str(one.name))
def test_errors_stay_within_the_stated_bound(
    function: Function, full: bool, record_property: Callable[[str, object], None]
) -> None:
    stated = re.search(r"Error below ([\d.]+) ulp", getattr(portable, function.name).__doc__)
    assert stated and float(stated[1]) == function.bound
    error = largest_error(function, 5000 if full else 600, seed=7)
    record_property(f"{function.name} (ulp)", round(error, 3))
    assert 0.4 < error < function.bound  # rounding alone costs half an ulp


def test_every_function_is_measured() -> None:
    assert {one.name for one in FUNCTIONS} | {"cos_sin"} == set(portable.__all__)


def test_angles_near_multiples_of_a_right_angle() -> None:
    # the first: by rounding; the others: numerators of the continued fraction of pi, or their halves
    for x in (573204.0 * 1.5707963267948966, 355.0, 52174.0 / 2, 710.0, 103993.0, 208341.0, 833719.0 / 2):
        with mpmath.workprec(200):
            exact = mpmath.sin(mpmath.mpf(x)), mpmath.cos(mpmath.mpf(x))
        for found, value in zip((portable.sin(x), portable.cos(x)), exact, strict=True):
            assert abs(mpmath.mpf(found) / value - 1) < 2.3e-16


def test_the_quantile_of_the_normal_distribution() -> None:
    tail = [0.0, 2.0**-53, 1e-12, 0.001, 0.02, 0.07, 0.075, 0.3, 0.5 - 2.0**-53]
    for share in (*tail, 0.5, 0.7, 0.93, 1 - 2.0**-53):
        u = round(share * 2**53) / 2**53
        with mpmath.workprec(200):
            p = mpmath.mpf(u) + mpmath.mpf(2) ** -54
            low = min(p, 1 - p)
            guess = statistics.NormalDist().inv_cdf(float(low))
            exact = mpmath.findroot(lambda z, low=low: mpmath.ncdf(z) - low, guess)
            exact = exact if p < 0.5 else -exact
        assert abs(mpmath.mpf(normal_quantile(u)) - exact) <= 1e-15 * abs(exact), u
        assert normal_quantile(1 - 2.0**-53 - u) == -normal_quantile(u)


def test_normal_draws_are_normal() -> None:
    draws = normals(generator(1, "test", "r1"), 100_000)
    assert stats.kstest(draws, "norm").pvalue > 0.01
    assert stats.kstest(draws[np.abs(draws) > 2.5], stats.norm.cdf).pvalue < 1e-6  # the test can fail
    for beyond in (2.0, 3.0, 3.7):  # also where numpy's own would ask the C library
        share, exact = np.mean(np.abs(draws) > beyond), 2 * stats.norm.sf(beyond)
        assert abs(share - exact) < 4 * math.sqrt(exact / draws.size)


def test_normal_draws_use_uniform_draws_in_order() -> None:
    uniform = generator(1, "test", "r1").random((3, 4))
    draws = normals(generator(1, "test", "r1"), (3, 4))
    assert draws.tolist() == [[normal_quantile(u) for u in row] for row in uniform.tolist()]


def test_normal_draws_of_several_generators() -> None:
    names, counts = ("r1", "r2", "r3"), (5, 0, 3)
    draws = normals_of_each([generator(1, "test", name) for name in names], counts)
    alone = [normals(generator(1, "test", name), count) for name, count in zip(names, counts, strict=True)]
    assert draws.tolist() == np.concatenate(alone).tolist()


def test_exponential_and_even_draws_have_their_distributions() -> None:
    draws = exponentials(generator(1, "test", "r1"), 3.0, 100_000)
    assert stats.kstest(draws, "expon", args=(0, 3.0)).pvalue > 0.01
    assert draws.min() >= 0 and math.isfinite(draws.max())
    draws = uniforms(generator(1, "test", "r1"), -2.0, 5.0, 100_000)
    assert stats.kstest(draws, "uniform", args=(-2.0, 7.0)).pvalue > 0.01
