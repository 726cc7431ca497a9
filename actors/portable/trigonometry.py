"""Sine, cosine and tangent.

x = n π/2 + y, |y| ≤ π/4, with π/2 in three or four parts of 33 bits so that their products with n are exact
(Cody and Waite, "Software Manual for the Elementary Functions", 1980); then polynomials (their evaluation as
in Sun's fdlibm, k_sin.c and k_cos.c; the coefficients are our own: Chebyshev interpolation with 60 digits).
"""

import math
from typing import Final

from actors.portable.logarithm import MAGIC

FARTHEST: Final = 1e6
"""Up to here, rad, the stated bounds hold. Beyond, the angle is first taken modulo the float next to 2π,
which moves it by up to 4e-17 of itself: a turn of millions of radians has no direction worth a digit."""
_QUARTER: Final = 0.7853981633974483
_TWO_OVER_PI: Final = 0.6366197723675814
_FIRST: Final = 1.5707963267341256  # π/2: 33 bits, …
_SECOND: Final = 6.077100506303966e-11  # 33 more, …
_REST: Final = 2.0222662487959506e-21  # and what remains; or instead of that …
_THIRD: Final = 2.0222662487111665e-21  # 33 more, …
_LAST: Final = 8.4784276603689e-32  # and what remains then


def sin(x: float) -> float:
    """Sine of an angle, rad; nan of what is not finite. Error below 1 ulp up to FARTHEST."""
    return cos_sin(x)[1]


def cos(x: float) -> float:
    """Cosine of an angle, rad; nan of what is not finite. Error below 1 ulp up to FARTHEST."""
    return cos_sin(x)[0]


def cos_sin(x: float) -> tuple[float, float]:
    """Cosine and sine together; a compiler leaves out the one that nobody asks for."""
    n, y, low = (0, x, 0.0) if -_QUARTER <= x <= _QUARTER else _reduced(x)
    z = y * y
    r = 0.008333333333330936 + z * (
        -0.00019841269836740532
        + z * (2.7557316093198404e-06 + z * (-2.5051129896450185e-08 + z * 1.5917988979397435e-10))
    )
    v = z * y
    s = y - ((z * (0.5 * low - v * r) - low) + v * 0.16666666666666666)
    r = z * (
        0.041666666666666664
        + z
        * (
            -0.0013888888888887389
            + z
            * (
                2.48015872987544e-05
                + z * (-2.755731726587808e-07 + z * (2.087614504941318e-09 + z * -1.138254464534925e-11))
            )
        )
    )
    half = 0.5 * z
    w = 1.0 - half
    c = w + (((1.0 - w) - half) + (z * r - y * low))
    if n & 1:
        s, c = c, -s
    return (-c, -s) if n & 2 else (c, s)


def tan(x: float) -> float:
    """Tangent of an angle, rad; nan of what is not finite. Error below 2.5 ulp up to FARTHEST."""
    c, s = cos_sin(x)
    return s / c


def _reduced(x: float) -> tuple[int, float, float]:
    """n modulo 4, and y + low = x − n π/2, |y| ≤ π/4 but for a rounding; y is nan if x is not finite."""
    if not -FARTHEST <= x <= FARTHEST:
        if not -math.inf < x < math.inf:
            return 0, math.nan, 0.0
        x %= math.tau
    n = x * _TWO_OVER_PI + MAGIC - MAGIC
    y = x - n * _FIRST
    part = n * _SECOND
    t = y - part
    back = y - t
    lost = (y - (t + back)) + (back - part)
    rest = n * _REST
    if -1e-6 < t < 1e-6:  # so near to a multiple of π/2 that its further digits count
        part = n * _THIRD
        y = t
        t = y - part
        back = y - t
        lost += (y - (t + back)) + (back - part)
        rest = n * _LAST
    low = lost - rest
    y = t + low
    return int(n) & 3, y, (t - y) + low
