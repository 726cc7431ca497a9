"""Logarithms.

x = 2^k (1 + f), √½ ≤ 1 + f < √2; ln(1 + f) = 2 artanh s with s = f / (2 + f) (the way of Sun's fdlibm,
e_log.c, and of FreeBSD's k_log.h); the coefficients are our own (Chebyshev interpolation with 60 digits).
"""

import math
from typing import Final

from actors.portable.exponents import split

_LN2_HIGH: Final = 0.6931471803691238  # 32 bits, so that k times it is exact
_LN2_LOW: Final = 1.9082149292705877e-10
_LOG10_2_HIGH: Final = 0.30102999566224753  # 38 bits
_LOG10_2_LOW: Final = 1.7336659603752853e-12
_LOG10_E_HIGH: Final = 0.4342944771051407  # 26 bits
_LOG10_E_LOW: Final = 4.798111141615973e-09
_SPLITTER: Final = 134217729.0  # 2^27 + 1 (Dekker 1971)


def log(x: float) -> float:
    """Natural logarithm: −inf at 0, nan below. Error below 1 ulp."""
    if not 0.0 < x < math.inf:
        return _at_the_edge(x)
    m, k = split(x)
    f = m - 1.0
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (_tail(f, half) + k * _LN2_LOW)) - f)


def log1p(x: float) -> float:
    """ln(1 + x), also where x is small: −inf at −1, nan below. Error below 1 ulp."""
    if not -1.0 < x < math.inf:
        return _at_the_edge(1.0 + x)
    if -0.29 < x < 0.41:
        half = 0.5 * x * x
        return x - (half - _tail(x, half))
    u = 1.0 + x
    lost = (x - (u - 1.0) if x < 1.0 else 1.0 - (u - x)) / u
    m, k = split(u)
    f = m - 1.0
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (_tail(f, half) + (k * _LN2_LOW + lost))) - f)


def log10(x: float) -> float:
    """Decimal logarithm: −inf at 0, nan below. Error below 1 ulp."""
    if not 0.0 < x < math.inf:
        return _at_the_edge(x)
    m, k = split(x)
    f = m - 1.0
    half = 0.5 * f * f
    near = f - half
    far = near * _SPLITTER
    high = far - (far - near)  # 26 bits, so that the product below is exact
    low = ((f - high) - half) + _tail(f, half)
    first = k * _LOG10_2_HIGH
    second = high * _LOG10_E_HIGH
    rest = k * _LOG10_2_LOW + (low + high) * _LOG10_E_LOW + low * _LOG10_E_HIGH
    total = first + second
    return total + (rest + ((first - total) + second))


def _at_the_edge(x: float) -> float:
    """The logarithm of 0, of infinity and of what has none."""
    if x == 0.0:
        return -math.inf
    return math.nan if x < 0.0 else x


def _tail(f: float, half: float) -> float:
    """ln(1 + f) − f + ½ f²; `half`: ½ f²."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (0.3999999999989827 + w * (0.22222211043776857 + w * 0.1533150161114533))
    even = z * (
        0.666666666666667 + w * (0.2857142862653362 + w * (0.18182895750119193 + w * 0.1461916613488797))
    )
    return s * (half + (odd + even))
