"""Exponential functions.

x = k ln 2 + r, |r| ≤ ½ ln 2; e^r from r (e^r + 1) / (e^r − 1), an even function that falls off quickly (the
way of Sun's fdlibm, e_exp.c); the coefficients are our own (Chebyshev interpolation with 60 digits).
"""

import math
from typing import Final

from actors.portable.exponents import MAGIC, scaled

_LOG2_E: Final = 1.4426950408889634
_LN2_HIGH: Final = 0.6931471803691238  # 32 bits, so that k times it is exact
_LN2_LOW: Final = 1.9082149292705877e-10
_LOG2_10: Final = 3.321928094887362
_LOG10_2_HIGH: Final = 0.30102999566224753  # 38 bits
_LOG10_2_LOW: Final = 1.7336659603752853e-12
_LN10: Final = 2.302585092994046
_LN10_HIGH: Final = 2.3025850653648376  # 26 bits
_LN10_LOW: Final = 2.7629208037533617e-08
_SPLITTER: Final = 134217729.0  # 2^27 + 1 (Dekker 1971)


def exp(x: float) -> float:
    """e^x: inf above 709.78, 0 below −745.13. Error below 1 ulp."""
    if not -746.0 < x < 710.0:
        return x if math.isnan(x) else (math.inf if x > 0.0 else 0.0)
    k = x * _LOG2_E + MAGIC - MAGIC
    return scaled(1.0 + _beyond_one(x - k * _LN2_HIGH, k * _LN2_LOW), int(k))


def exp10(x: float) -> float:
    """10^x: inf above 308.25, 0 below −323.3. Error below 1 ulp."""
    if not -324.0 < x < 309.0:
        return x if math.isnan(x) else (math.inf if x > 0.0 else 0.0)
    k = x * _LOG2_10 + MAGIC - MAGIC
    near = x - k * _LOG10_2_HIGH
    r = near - k * _LOG10_2_LOW
    rest = (near - r) - k * _LOG10_2_LOW
    far = r * _SPLITTER
    high = far - (far - r)  # 26 bits of r, so that the first product is exact
    tail = (r - high) * _LN10_HIGH + r * _LN10_LOW + rest * _LN10
    return scaled(1.0 + _beyond_one(high * _LN10_HIGH, -tail), int(k))


def expm1(x: float) -> float:
    """e^x − 1, also where that is small. Error below 2.5 ulp."""
    if not -50.0 < x < 710.0:
        return x if math.isnan(x) else (math.inf if x > 0.0 else -1.0)
    if -0.34 < x < 0.34:
        return _beyond_one(x, 0.0)
    k = x * _LOG2_E + MAGIC - MAGIC
    beyond = _beyond_one(x - k * _LN2_HIGH, k * _LN2_LOW)
    if k > 60.0:
        return scaled(1.0 + beyond, int(k))
    one = scaled(1.0, int(k))
    return (one - 1.0) + one * beyond


def _beyond_one(high: float, low: float) -> float:
    """e^(high − low) − 1; |high| < 0.35, low far smaller."""
    r = high - low
    z = r * r
    c = r - z * (
        0.1666666666666666
        + z
        * (
            -0.0027777777777562864
            + z * (6.613756470855508e-05 + z * (-1.6534058842837582e-06 + z * 4.1437096880780196e-08))
        )
    )
    return high - (low - r * c / (2.0 - c))
