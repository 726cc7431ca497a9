"""Elementary functions with the same bits on every processor: exponentials, logarithms, trigonometry."""

import math
from typing import Final

MAGIC: Final = 6755399441055744.0
"""1.5 · 2^52: adding and subtracting it rounds a float below 2^51 to the nearest integer."""
_ROOT_HALF: Final = 0.7071067811865476
_LEAST_NORMAL: Final = 2.2250738585072014e-308


def two_to(k: int) -> float:
    """Return 2^k; −1022 ≤ k ≤ 1023."""
    return math.ldexp(1.0, k)


def halved(x: float) -> tuple[float, int]:
    """Return m, ½ ≤ m < 1, and k with x = m · 2^k; `x` > 0, finite and normal."""
    return math.frexp(x)


def split(x: float) -> tuple[float, int]:
    """Return m, √½ ≤ m < √2, and k with x = m · 2^k; `x` > 0 and finite."""
    below = 0
    if x < _LEAST_NORMAL:
        x *= 18014398509481984.0  # 2^54
        below = 54
    m, k = halved(x)
    if m < _ROOT_HALF:
        return m + m, k - 1 - below
    return m, k - below


def scaled(x: float, k: int) -> float:
    """Return x · 2^k, ½ < x < 2, rounded once; −1100 ≤ k ≤ 1100."""
    if -1021 <= k <= 1022:
        return x * two_to(k)
    half = k >> 1
    return x * two_to(half) * two_to(k - half)


_LN2_HIGH: Final = 0.6931471803691238  # 32 bits, so that k times it is exact
_LN2_LOW: Final = 1.9082149292705877e-10
_LOG10_2_HIGH: Final = 0.30102999566224753  # 38 bits
_LOG10_2_LOW: Final = 1.7336659603752853e-12
_LOG10_E_HIGH: Final = 0.4342944771051407  # 26 bits
_LOG10_E_LOW: Final = 4.798111141615973e-09
_SPLITTER: Final = 134217729.0  # 2^27 + 1 (Dekker 1971)


def log(x: float) -> float:
    """Return the natural logarithm: −inf at 0, nan below. Error below 1 ulp."""
    if not 0.0 < x < math.inf:
        return _at_the_edge(x)
    m, k = split(x)
    f = m - 1.0
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (_tail(f, half) + k * _LN2_LOW)) - f)


def log1p(x: float) -> float:
    """Return ln(1 + x), accurate for small x: −inf at −1, nan below. Error below 1 ulp."""
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
    """Return the decimal logarithm: −inf at 0, nan below. Error below 1 ulp."""
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
    """Return the logarithm of 0, infinity, negative numbers and nan."""
    if x == 0.0:
        return -math.inf
    return math.nan if x < 0.0 else x


def _tail(f: float, half: float) -> float:
    """Return ln(1 + f) − f + ½ f²; `half`: ½ f²."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (0.3999999999989827 + w * (0.22222211043776857 + w * 0.1533150161114533))
    even = z * (
        0.666666666666667 + w * (0.2857142862653362 + w * (0.18182895750119193 + w * 0.1461916613488797))
    )
    return s * (half + (odd + even))


_LOG2_E: Final = 1.4426950408889634
_LOG2_10: Final = 3.321928094887362
_LN10: Final = 2.302585092994046
_LN10_HIGH: Final = 2.3025850653648376  # 26 bits
_LN10_LOW: Final = 2.7629208037533617e-08


def exp(x: float) -> float:
    """Return e^x: inf above 709.78, 0 below −745.13. Error below 1 ulp."""
    if not -746.0 < x < 710.0:
        return x if math.isnan(x) else (math.inf if x > 0.0 else 0.0)
    k = x * _LOG2_E + MAGIC - MAGIC
    return scaled(1.0 + _beyond_one(x - k * _LN2_HIGH, k * _LN2_LOW), int(k))


def exp10(x: float) -> float:
    """Return 10^x: inf above 308.25, 0 below −323.3. Error below 1 ulp."""
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
    """Return e^x − 1, accurate for small x. Error below 2.5 ulp."""
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
    """Return e^(high − low) − 1; |high| < 0.35, low far smaller."""
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


def normal_quantile(u: float) -> float:
    """Return the standard normal quantile of u + 2^-54; `u`: k · 2^-53, 0 ≤ u < 1.

    The added half step keeps both ends finite and the quantiles symmetric. Relative error below 1e-15.
    """
    q = (u - 0.5) + 5.551115123125783e-17
    if -0.425 <= q <= 0.425:
        return q * _middle(0.180625 - q * q)
    p = u + 5.551115123125783e-17 if q < 0.0 else (1.0 - u) - 5.551115123125783e-17
    r = math.sqrt(-log(p))
    value = _flank(r - 1.6) if r <= 5.0 else _quantiles_tail(r - 5.0)
    return -value if q < 0.0 else value


def _middle(r: float) -> float:
    above = (
        ((((2.5090809287301226727e3 * r + 3.3430575583588128105e4) * r + 6.7265770927008700853e4) * r
          + 4.5921953931549871457e4) * r + 1.3731693765509461125e4) * r + 1.9715909503065514427e3
    )  # fmt: skip
    below = (
        ((((5.2264952788528545610e3 * r + 2.8729085735721942674e4) * r + 3.9307895800092710610e4) * r
          + 2.1213794301586595867e4) * r + 5.3941960214247511077e3) * r + 6.8718700749205790830e2
    )  # fmt: skip
    above = (above * r + 1.3314166789178437745e2) * r + 3.3871328727963666080e0
    return above / ((below * r + 4.2313330701600911252e1) * r + 1.0)


def _flank(r: float) -> float:
    above = (
        ((((7.74545014278341407640e-4 * r + 2.27238449892691845833e-2) * r + 2.41780725177450611770e-1) * r
          + 1.27045825245236838258e0) * r + 3.64784832476320460504e0) * r + 5.76949722146069140550e0
    )  # fmt: skip
    below = (
        ((((1.05075007164441684324e-9 * r + 5.47593808499534494600e-4) * r + 1.51986665636164571966e-2) * r
          + 1.48103976427480074590e-1) * r + 6.89767334985100004550e-1) * r + 1.67638483018380384940e0
    )  # fmt: skip
    above = (above * r + 4.63033784615654529590e0) * r + 1.42343711074968357734e0
    return above / ((below * r + 2.05319162663775882187e0) * r + 1.0)


def _quantiles_tail(r: float) -> float:
    above = (
        ((((2.01033439929228813265e-7 * r + 2.71155556874348757815e-5) * r + 1.24266094738807843860e-3) * r
          + 2.65321895265761230930e-2) * r + 2.96560571828504891230e-1) * r + 1.78482653991729133580e0
    )  # fmt: skip
    below = (
        ((((2.04426310338993978564e-15 * r + 1.42151175831644588870e-7) * r + 1.84631831751005468180e-5) * r
          + 7.86869131145613259100e-4) * r + 1.48753612908506148525e-2) * r + 1.36929880922735805310e-1
    )  # fmt: skip
    above = (above * r + 5.46378491116411436990e0) * r + 6.65790464350110377720e0
    return above / ((below * r + 5.99832206555887937690e-1) * r + 1.0)


FARTHEST: Final = 1e6
"""Angle up to which the stated error bounds hold, rad. Larger angles are first reduced modulo the float next
to 2π, with a relative error of up to 4e-17."""
_QUARTER: Final = 0.7853981633974483
_TWO_OVER_PI: Final = 0.6366197723675814
_FIRST: Final = 1.5707963267341256  # π/2: 33 bits, …
_SECOND: Final = 6.077100506303966e-11  # the next 33 bits, …
_REST: Final = 2.0222662487959506e-21  # and the remainder; or instead …
_THIRD: Final = 2.0222662487111665e-21  # the next 33 bits, …
_LAST: Final = 8.4784276603689e-32  # and the remainder


def sin(x: float) -> float:
    """Return the sine of an angle, rad; nan if not finite. Error below 1 ulp up to FARTHEST."""
    return cos_sin(x)[1]


def cos(x: float) -> float:
    """Return the cosine of an angle, rad; nan if not finite. Error below 1 ulp up to FARTHEST."""
    return cos_sin(x)[0]


def cos_sin(x: float) -> tuple[float, float]:
    """Return cosine and sine; compilers remove an unused one."""
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
    """Return the tangent of an angle, rad; nan if not finite. Error below 2.5 ulp up to FARTHEST."""
    c, s = cos_sin(x)
    return s / c


def _reduced(x: float) -> tuple[int, float, float]:
    """Return n modulo 4, and y + low = x − n π/2, |y| ≤ π/4 up to rounding; y is nan if x is not finite."""
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
    if -1e-6 < t < 1e-6:  # so near to a multiple of π/2 that further digits matter
        part = n * _THIRD
        y = t
        t = y - part
        back = y - t
        lost += (y - (t + back)) + (back - part)
        rest = n * _LAST
    low = lost - rest
    y = t + low
    return int(n) & 3, y, (t - y) + low


_PI_LOW: Final = 1.2246467991473532e-16  # π minus its float
_SMALLER: Final = math.ldexp(1.0, -553)
_LARGER: Final = math.ldexp(1.0, 553)


def atan(x: float) -> float:
    """Return the arctangent, rad, within ±π/2. Error below 1 ulp."""
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
    """Return the angle of the vector (x, y), rad in [−π, π]; signs of zeros count. Error below 1.5 ulp."""
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
    """Return the arcsine, rad, within ±π/2; nan outside [−1, 1]. Error below 2.5 ulp."""
    if not -1.0 <= x <= 1.0:
        return math.nan
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


def acos(x: float) -> float:
    """Return the arccosine, rad, from 0 to π; nan outside [−1, 1]. Error below 2.5 ulp."""
    if not -1.0 <= x <= 1.0:
        return math.nan
    return 2.0 * atan2(math.sqrt(1.0 - x), math.sqrt(1.0 + x))


def hypot(x: float, y: float) -> float:
    """Return the length of the vector (x, y) without overflow or underflow. Error below 1.25 ulp."""
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
    """Return t − atan t, |t| ≤ 7/16."""
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
