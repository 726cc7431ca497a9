"""The quantile of the normal distribution.

Wichura, "Algorithm AS 241: The percentage points of the normal distribution", Applied Statistics 37(3), 1988:
PPND16.
"""

import math

from actors.portable.logarithm import log


def normal_quantile(u: float) -> float:
    """The value below which a standard normal lies with probability u + 2^-54; `u`: k · 2^-53, 0 ≤ u < 1.

    Half a step is added so that neither end is infinite, and every `u` has its mirror image. Relative error
    below 1e-15.
    """
    q = (u - 0.5) + 5.551115123125783e-17
    if -0.425 <= q <= 0.425:
        return q * _middle(0.180625 - q * q)
    p = u + 5.551115123125783e-17 if q < 0.0 else (1.0 - u) - 5.551115123125783e-17
    r = math.sqrt(-log(p))
    value = _flank(r - 1.6) if r <= 5.0 else _tail(r - 5.0)
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


def _tail(r: float) -> float:
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
