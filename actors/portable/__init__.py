"""Elementary functions with equal bits on every processor; cores use no others.

They use only operations that IEEE 754 defines to the last bit: + − × ÷ √, remainders, and changes of
exponents. Functions of C libraries and numpy may use other instructions on another processor or in another
release, with other last bits. Results are IEEE's for every argument; no exceptions are raised.

Use them from here in plain Python, from `portable.compiled` in kernels and from `portable.arrays` for arrays:
the same source, the same bits. `portable.draws` has normal and exponential draws from uniform ones.
"""

from actors.portable.elementary import (
    acos,
    asin,
    atan,
    atan2,
    cos,
    cos_sin,
    exp,
    exp10,
    expm1,
    hypot,
    log,
    log1p,
    log10,
    sin,
    tan,
)

__all__ = [
    "acos",
    "asin",
    "atan",
    "atan2",
    "cos",
    "cos_sin",
    "exp",
    "exp10",
    "expm1",
    "hypot",
    "log",
    "log1p",
    "log10",
    "sin",
    "tan",
]
