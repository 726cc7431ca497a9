"""How near robots come to walls and to one another, and how often they touch: from where they truly were."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point

_FAR: Final = 0.05
"""Gaps beyond this are given to a cell only, m."""


def wall_gaps(grid: OccupancyGrid, true: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(samples, robots): between a disc of `radius`, m, at each position and the nearest wall, m.

    `true`: (samples, robots, 2 or more), x and y first. Exact up to 0.05 m.
    """
    cells = np.floor((true[..., :2] - grid.origin) / grid.resolution).astype(np.int64)
    gaps = grid.clearance[cells[..., 1], cells[..., 0]] - radius
    for sample, robot in np.argwhere(gaps < _FAR + grid.resolution).tolist():
        point = Point(*true[sample, robot, :2].tolist())
        gaps[sample, robot] = grid.clearance_at(point, radius + 1.0) - radius
    return gaps


def robot_gaps(true: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(samples, pairs): between each two robots, discs of `radius`, m, in the order of their indices."""
    one, other = np.triu_indices(true.shape[1], k=1)
    offsets = true[:, one, :2] - true[:, other, :2]
    gaps: NDArray[np.float64] = np.hypot(offsets[..., 0], offsets[..., 1]) - 2 * radius
    return gaps


def touches(gaps: NDArray[np.float64]) -> int:
    """How often one of the columns of gaps becomes 0 or less, the first row included."""
    near = gaps <= 0.0
    return int(near[:1].sum() + (near[1:] & ~near[:-1]).sum())


def closest(gaps: NDArray[np.float64]) -> float:
    """The smallest gap, m; inf where there is none."""
    return float(gaps.min(initial=np.inf))
