"""What it costs a robot's centre to be near what is lethal, as in costmap_2d's inflation layer.

Costs as in ros-planning/navigation, costmap_2d/include/costmap_2d/inflation_layer.h and cost_values.h.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actors.portable import arrays

LETHAL: Final = 254
"""Cost of a cell that holds something."""
INSCRIBED: Final = 253
"""Cost of a cell in which the robot's centre cannot be without its body touching something."""


@dataclass(frozen=True)
class Inflation:
    """How the cost falls with the distance to the nearest lethal cell."""

    inscribed: float
    """Up to this distance the body touches what is lethal, m."""
    radius: float
    """From this distance on nothing costs anything, m."""
    scaling: float
    """How fast the cost falls between the two, 1/m (cost_scaling_factor)."""

    def costs(self, distance: ArrayLike) -> NDArray[np.uint8]:
        """Cost at each distance, m: LETHAL at 0, INSCRIBED near it, then from 252 to 0; same shape."""
        away = np.asarray(distance, dtype=np.float64)
        beyond = np.maximum(away - self.inscribed, 0.0)
        falling = np.floor((INSCRIBED - 1) * arrays.exp(-self.scaling * beyond))
        costs = np.where(away > self.radius, 0.0, falling)
        costs = np.where(away <= self.inscribed, INSCRIBED, costs)
        return np.where(away <= 0.0, LETHAL, costs).astype(np.uint8)

    def reach(self, cell: float) -> int:
        """How many cells of side `cell`, m, away something still costs, or touches, at most."""
        return math.ceil(max(self.radius, self.inscribed) / cell - 1e-9)

    def table(self, cell: float) -> NDArray[np.uint8]:
        """Cost by squared distance in cells of side `cell`, m: ((reach + 1)² + 1,), read-only, 0 at its end.

        The distance is that between the centres of two cells.
        """
        reach = self.reach(cell) + 1
        table = self.costs(cell * np.sqrt(np.arange(reach * reach + 1)))
        table[-1] = 0
        table.setflags(write=False)
        return table


def fingerprint() -> bytes:
    """What the costs are for fixed inputs: differs where a processor or library computes differently."""
    return (
        Inflation(0.227, 0.75, 15.0).table(0.05).tobytes() + Inflation(0.2, 0.5, 10.0).table(0.05).tobytes()
    )
