"""Plain Python, a compiled kernel and the array form: one source, the same bits, whatever the argument."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors import portable
from actors.portable import arrays, compiled, exponents
from tests.portable.functions import FUNCTIONS, Function, loop

EDGES = [0.0, 5e-324, 2.2250738585072014e-308, 0.25, 0.7853981633974483, 1.0, 1.5, 1e6, 2.0**31, 1e22, 1e308]
EDGES += [math.inf, 709.782712893384, 745.1332191019411, 308.2547155599167, 323.3]
BOTH = [sign * edge for edge in EDGES for sign in (1.0, -1.0)] + [math.nan]


def bits(values: Any) -> list[int]:
    return [int(word) for word in np.asarray(values, np.float64).reshape(-1).view(np.int64)]


def each(function: Callable[..., float], arguments: tuple[Any, ...]) -> Any:
    """The function in a kernel, over all arguments."""
    results = np.empty(arguments[0].size)
    loop(function, len(arguments))(*arguments, results)
    return results


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda one: str(one.name))
def test_python_kernels_and_arrays_agree(function: Function) -> None:
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


@settings(max_examples=300, deadline=None)
@given(st.floats())
def test_cosine_and_sine_together_are_those_alone(x: float) -> None:
    assert bits(portable.cos_sin(x)) == bits([portable.cos(x), portable.sin(x)])


@settings(max_examples=200, deadline=None)
@given(st.floats(min_value=5e-324, allow_infinity=False))
def test_a_float_taken_apart_is_put_together_again(x: float) -> None:
    m, k = exponents.split(x)
    assert math.sqrt(0.5) <= m < math.sqrt(2) and math.ldexp(m, k) == x


def test_what_ieee_754_says_of_special_arguments() -> None:
    inf, nan = math.inf, math.nan
    assert [portable.exp(x) for x in (inf, -inf, 710.0, -746.0, 0.0)] == [inf, 0.0, inf, 0.0, 1.0]
    assert [portable.exp10(x) for x in (inf, -inf, 2.0, -1.0, 0.0)] == [inf, 0.0, 100.0, 0.1, 1.0]
    assert [portable.expm1(x) for x in (inf, -inf, -60.0, 0.0)] == [inf, -1.0, -1.0, 0.0]
    assert [portable.log(x) for x in (0.0, 1.0, inf)] == [-inf, 0.0, inf]
    assert [portable.log10(x) for x in (0.0, 1.0, 1000.0, 1e22, inf)] == [-inf, 0.0, 3.0, 22.0, inf]
    assert [portable.log1p(x) for x in (-1.0, 0.0, inf)] == [-inf, 0.0, inf]
    assert [portable.atan(x) for x in (inf, -inf)] == [math.pi / 2, -math.pi / 2]
    assert [portable.hypot(*v) for v in ((nan, inf), (3.0, 4.0), (0.0, 0.0))] == [inf, 5.0, 0.0]
    bad = [
        portable.log(-1.0),
        portable.log1p(-2.0),
        portable.asin(1.1),
        portable.acos(-1.1),
        portable.exp(nan),
    ]
    bad += [
        portable.sin(inf),
        portable.cos(nan),
        portable.tan(-inf),
        portable.hypot(nan, 1.0),
        portable.atan2(nan, 0),
    ]
    assert all(math.isnan(value) for value in bad)
    zeros = [
        (0.0, 0.0),
        (-0.0, 0.0),
        (0.0, -0.0),
        (-0.0, -0.0),
        (0.0, 1.0),
        (-0.0, -1.0),
        (1.0, 0.0),
        (-1.0, -0.0),
    ]
    assert bits([portable.atan2(*v) for v in zeros]) == bits([math.atan2(*v) for v in zeros])


def test_a_turn_of_many_millions_of_radians_still_is_a_direction() -> None:
    for x in (1e7, -1e15, 1e300):
        c, s = portable.cos_sin(x)
        assert abs(c * c + s * s - 1.0) < 1e-15
    assert abs(portable.sin(1e9) - math.sin(1e9)) < 1e-7


def test_sums_go_from_the_first_entry_to_the_last() -> None:
    terms = np.random.default_rng(5).uniform(-1, 1, (3, 1000)) * 10.0 ** np.arange(1000)[None, ::-1].clip(
        0, 20
    )
    expected = []
    for row in terms.tolist():
        total = 0.0
        for term in row:
            total += term
        expected.append(total)
    assert arrays.total(terms).tolist() == expected
    assert arrays.total(np.empty((2, 0))).tolist() == [0.0, 0.0]
    assert arrays.total([1.0, 2.0]).shape == ()
