"""Floors drawn by programs: boxes and discs on a rectangle, as the image and the YAML file of a map."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

RESOLUTION: Final = 0.05
BLACK: Final = 0
WHITE: Final = 254
"""Occupied and free, the brightnesses that ROS map_saver writes."""

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1: west, south, east and north edge, m, multiples of RESOLUTION."""
Disc = tuple[float, float, float]
"""x, y, radius, m."""


@dataclass(frozen=True)
class DrawnFloor:
    """What stands on a rectangle; its border is a wall."""

    width: float
    height: float
    walls: tuple[Box, ...]
    doors: tuple[Box, ...]
    """Openings in the walls."""
    furniture: tuple[Box, ...] = ()
    pillars: tuple[Disc, ...] = ()


def draw(floor: DrawnFloor) -> NDArray[np.uint8]:
    """The map's brightnesses, row 0 north."""
    rows, columns = round(floor.height / RESOLUTION), round(floor.width / RESOLUTION)
    pixels = np.full((rows, columns), WHITE, dtype=np.uint8)
    for wall in floor.walls:
        _fill(pixels, wall, BLACK)
    for door in floor.doors:
        _fill(pixels, door, WHITE)
    for box in floor.furniture:
        _fill(pixels, box, BLACK)
    x = (np.arange(columns) + 0.5) * RESOLUTION
    y = (np.arange(rows)[:, None] + 0.5) * RESOLUTION
    for px, py, radius in floor.pillars:
        dx, dy = x - px, y - py
        pixels[dx * dx + dy * dy <= radius * radius] = BLACK
    return np.flipud(pixels)


def header(image: str, drawn_by: str) -> str:
    """The map's YAML."""
    return (
        f"# drawn by {drawn_by}\nimage: {image}\nresolution: {RESOLUTION}\n"
        "origin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def _fill(pixels: NDArray[np.uint8], box: Box, brightness: int) -> None:
    """Paint a box; row 0 of `pixels` is south."""
    x0, y0, x1, y1 = (round(edge / RESOLUTION) for edge in box)
    pixels[y0:y1, x0:x1] = brightness
