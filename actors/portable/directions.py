"""From coordinates to angles and lengths: inverse trigonometric functions and the hypotenuse.

atan: the argument is moved near to 0 by the arctangents of ½, 1, 3/2 and infinity, then a polynomial (the way
of Sun's fdlibm, s_atan.c); the coefficients are our own (Chebyshev interpolation with 60 digits).
"""

import math
from typing import Final

_PI_LOW: Final = 1.2246467991473532e-16  # π minus its float
_SMALLER: Final = math.ldexp(1.0, -553)
_LARGER: Final = math.ldexp(1.0, 553)


def atan(x: float) -> float:
    """Arctangent, rad, within ±π/2. Error below 1 ulp."""
    a = abs(x)
    if a < 0.4375:
        return x - _shortfall(x)
    if a < 1.1875:
        if a < 0.6875:
            t, high, low = (2.0 * a - 1.0) / (2.0 + a), 0.4636476090008061, 2.2698777452961687e-17
        else:
            t, high, low = (a - 1.0) / (a + 1.0), 0.7853981633974483, 3.061616997868383e-17
    elif a < 2.4375:
        t, high, low = (a - 1.5) / (1.0 + 1.5 * a), 0.982793723247329, 1.3903311031230998e-17
    else:
        t, high, low = -1.0 / a, 1.5707963267948966, 6.123233995736766e-17
    angle = high - ((_shortfall(t) - low) - t)
    return -angle if x < 0.0 else angle


def atan2(y: float, x: float) -> float:
    """Angle of the vector (x, y), rad in [−π, π]; signs of zeros count. Error below 1.5 ulp."""
    if x == 0.0:
        if y != 0.0:
            return y if math.isnan(y) else math.copysign(1.5707963267948966, y)
        angle = 0.0
    elif math.isinf(x) and math.isinf(y):
        angle = 0.7853981633974483
    else:
        angle = atan(abs(y / x))
    if math.copysign(1.0, x) < 0.0:
        angle = math.pi - (angle - _PI_LOW)
    return math.copysign(angle, y)


def asin(x: float) -> float:
    """Arcsine, rad, within ±π/2; nan outside [−1, 1]. Error below 2.5 ulp."""
    if not -1.0 <= x <= 1.0:
        return math.nan
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


def acos(x: float) -> float:
    """Arccosine, rad, from 0 to π; nan outside [−1, 1]. Error below 2.5 ulp."""
    if not -1.0 <= x <= 1.0:
        return math.nan
    return 2.0 * atan2(math.sqrt(1.0 - x), math.sqrt(1.0 + x))


def hypot(x: float, y: float) -> float:
    """Length of the vector (x, y), also where squares would be too large or small. Error below 1.25 ulp."""
    square = x * x + y * y
    if 1e-280 < square < 1e300:
        return math.sqrt(square)
    a, b = abs(x), abs(y)
    if math.isinf(a) or math.isinf(b):
        return math.inf
    if max(a, b) > 1.0:
        a, b = a * _SMALLER, b * _SMALLER
        return math.sqrt(a * a + b * b) * _LARGER
    a, b = a * _LARGER, b * _LARGER
    return math.sqrt(a * a + b * b) * _SMALLER


def _shortfall(t: float) -> float:
    """t − atan t, |t| ≤ 7/16."""
    z = t * t
    w = z * z
    odd = z * (
        0.33333333333333326
        + w
        * (
            0.1428571428314864
            + w
            * (
                0.09090900195560148
                + w * (0.06663239299107136 + w * (0.05033942776485848 + w * 0.017547235157290005))
            )
        )
    )
    even = w * (
        0.1999999999998777
        + w
        * (
            0.11111110900560475
            + w * (0.07692087348767168 + w * (0.05847724720645106 + w * 0.03782521866106712))
        )
    )
    return t * (odd - even)
