"""Binary exponents of floats: their bits taken apart and put together, which rounds nothing."""

import math
from typing import Final

MAGIC: Final = 6755399441055744.0
"""1.5 · 2^52: what is added to a float below 2^51 and taken away again leaves the nearest whole number."""
_ROOT_HALF: Final = 0.7071067811865476
_LEAST_NORMAL: Final = 2.2250738585072014e-308


def two_to(k: int) -> float:
    """2^k; −1022 ≤ k ≤ 1023."""
    return math.ldexp(1.0, k)


def halved(x: float) -> tuple[float, int]:
    """m, ½ ≤ m < 1, and k, x = m · 2^k; `x` > 0, finite and normal."""
    return math.frexp(x)


def split(x: float) -> tuple[float, int]:
    """m, √½ ≤ m < √2, and k, x = m · 2^k; `x` > 0 and finite."""
    below = 0
    if x < _LEAST_NORMAL:
        x *= 18014398509481984.0  # 2^54
        below = 54
    m, k = halved(x)
    if m < _ROOT_HALF:
        return m + m, k - 1 - below
    return m, k - below


def scaled(x: float, k: int) -> float:
    """x · 2^k, ½ < x < 2, rounded once; −1100 ≤ k ≤ 1100."""
    if -1021 <= k <= 1022:
        return x * two_to(k)
    half = k >> 1
    return x * two_to(half) * two_to(k - half)
