"""The portable functions against exact values: each within the bound that it states."""

import re
import statistics
from collections.abc import Callable

import mpmath
import pytest

from actors import portable
from actors.portable.quantiles import normal_quantile
from tests.portable.functions import FUNCTIONS, Function, largest_error


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


def test_angles_that_almost_are_multiples_of_a_right_angle() -> None:
    # the first: by rounding; the others: numerators of the continued fraction of pi, or their halves
    for x in (573204.0 * 1.5707963267948966, 355.0, 52174.0 / 2, 710.0, 103993.0, 208341.0, 833719.0 / 2):
        with mpmath.workprec(200):
            exact = mpmath.sin(mpmath.mpf(x)), mpmath.cos(mpmath.mpf(x))
        for found, value in zip((portable.sin(x), portable.cos(x)), exact, strict=True):
            assert abs(mpmath.mpf(found) / value - 1) < 2.3e-16


def test_the_quantile_of_the_normal_distribution() -> None:
    uniform = [
        0.0,
        2.0**-53,
        1e-12,
        0.001,
        0.02,
        0.07,
        0.075,
        0.3,
        0.5 - 2.0**-53,
        0.5,
        0.7,
        0.93,
        1 - 2.0**-53,
    ]
    for share in uniform:
        u = round(share * 2**53) / 2**53
        with mpmath.workprec(200):
            p = mpmath.mpf(u) + mpmath.mpf(2) ** -54
            low = min(p, 1 - p)
            guess = statistics.NormalDist().inv_cdf(float(low))
            exact = mpmath.findroot(lambda z, low=low: mpmath.ncdf(z) - low, guess)
            exact = exact if p < 0.5 else -exact
        assert abs(mpmath.mpf(normal_quantile(u)) - exact) <= 1e-15 * abs(exact), u
        assert normal_quantile(1 - 2.0**-53 - u) == -normal_quantile(u)
