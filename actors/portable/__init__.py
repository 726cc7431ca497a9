"""Elementary functions that give the same bits on every processor: the only ones that cores use.

They stand on what IEEE 754 defines to the last bit: + − × ÷ √, remainders, and exponents moved about.
Whatever a C library or numpy brings may choose other instructions, and with them other last bits, on another
processor or in another release. Results are IEEE's for every argument, never an exception.

For plain Python from here, for kernels from `portable.compiled`, for arrays from `portable.arrays`: the same
source, the same bits. `portable.draws` makes normal and exponential draws of a generator's uniform ones.
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
