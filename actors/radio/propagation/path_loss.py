"""How much weaker a signal arrives over a distance: log-distance path loss with one or two slopes.

`loss = excess + near_loss + 10 near_exponent log10 d` up to the breakpoint, and beyond it `excess + far_loss
+ 10 far_exponent log10(d / breakpoint)`. Two slopes are those of IEEE 802.15.4-2006, Annex E; with the
breakpoint at infinity it is the plain log-distance model (Rappaport, "Wireless Communications", 4.9.1).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import exp10, log10

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PathLossParameters:
    """Loss over distance in line of sight; the defaults are Annex E."""

    near_loss_db: float = 40.2
    """At 1 m, dB. Default: IEEE 802.15.4-2006, Annex E (free space at 2.45 GHz)."""
    near_exponent: float = 2.0
    """Up to the breakpoint. Default: Annex E (free space)."""
    breakpoint: float = 8.0
    """Where the second slope begins, m; `inf`: nowhere. Default: Annex E."""
    far_loss_db: float = 58.5
    """Just beyond the breakpoint, dB. Default: Annex E."""
    far_exponent: float = 3.3
    """Beyond the breakpoint. Default: Annex E."""
    excess_db: float = 0.0
    """What antennas, their housing and their height above the floor cost beyond that, dB, at any distance."""
    nearest: float = 0.1
    """Antennas are never taken to be closer than this, m. Default: about the wavelength, 0.12 m, where the
    far-field formula ends."""

    def coefficients(self) -> Floats:
        """What the kernels take: near loss and slope, breakpoint, far loss and slope per decade, nearest."""
        far = 10.0 * self.far_exponent
        far_at_one = self.far_loss_db - (0.0 if math.isinf(self.breakpoint) else far * log10(self.breakpoint))
        return np.array(
            [
                self.excess_db + self.near_loss_db,
                10.0 * self.near_exponent,
                self.breakpoint,
                self.excess_db + far_at_one,
                far,
                self.nearest,
            ]
        )


@njit(cache=True)  # type: ignore[untyped-decorator]
def over(distance: float, coefficients: Floats) -> float:
    """The loss, dB, over a distance, m."""
    d = max(distance, coefficients[5])
    if d <= coefficients[2]:
        near: float = coefficients[0] + coefficients[1] * log10(d)
        return near
    far: float = coefficients[3] + coefficients[4] * log10(d)
    return far


def line_of_sight(budget_db: float, parameters: PathLossParameters) -> float:
    """The greatest distance, m, over which the loss in line of sight is within the budget, dB; 0: none."""
    p = parameters
    budget_db -= p.excess_db
    if budget_db >= p.far_loss_db and not math.isinf(p.breakpoint):
        return float(p.breakpoint * exp10((budget_db - p.far_loss_db) / (10.0 * p.far_exponent)))
    if p.near_exponent == 0.0:
        return p.breakpoint if budget_db >= p.near_loss_db else 0.0
    distance = min(exp10((budget_db - p.near_loss_db) / (10.0 * p.near_exponent)), p.breakpoint)
    return float(distance) if distance >= p.nearest else 0.0
