"""Kernels: which rays of a scan may meet a thing, by its bearing and by how wide it looks."""

import math

from actors.kernels import njit
from actors.portable.compiled import asin, atan2


@njit(cache=True)  # type: ignore[untyped-decorator]
def bearing_to(x: float, y: float, heading: float, first_angle: float) -> float:
    """The bearing of (x, y) counted from the first ray, in [0, 2π) rad; that lies at `first_angle` from
    `heading`, the sensor's."""
    bearing: float = atan2(y, x) - heading - first_angle
    return bearing - 2 * math.pi * math.floor(bearing / (2 * math.pi))


@njit(cache=True)  # type: ignore[untyped-decorator]
def half_width(apart: float, radius: float) -> float:
    """Half the angle under which a disc appears so far away, rad; from within it is all around."""
    half: float = asin(radius / apart) if apart > radius else math.pi
    return half


@njit(cache=True)  # type: ignore[untyped-decorator]
def window(bearing: float, half: float, turn: int, increment: float, rays: int) -> tuple[int, int]:
    """The rays that may meet it, from the first to before the last; see `bearing_to` and `half_width`.

    It may appear at both ends of the scan, so there are three windows, of the turns −1, 0 and 1. One ray more
    on both sides makes up for rounding.
    """
    low = (bearing + 2 * math.pi * turn - half) / increment
    high = (bearing + 2 * math.pi * turn + half) / increment
    return max(math.ceil(low) - 1, 0), min(math.floor(high) + 2, rays)
