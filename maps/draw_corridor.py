"""Generator of corridor.png and corridor.yaml: `python maps/draw_corridor.py [directory]`.

The floor of the original testbed: a corridor with window bays, cabinets and pillars, a kitchen at its west
end and two offices to its south, each behind a passage that two robots can barely share.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np
from PIL import Image

from actors.array_types import Flags, Octets
from actors.floor.offices import header

RESOLUTION = 0.03125
ROWS, COLUMNS = 474, 941
WALL = 3
"""Thickness of the walls, pixels."""
BLACK, GREY, WHITE = 0, 205, 254
"""Brightness of occupied, unknown and free cells, as written by ROS map_saver."""

Corners = list[tuple[float, float]]

SHAPES = tomllib.loads(Path(__file__).with_name("corridor.toml").read_text("utf-8"))
"""Coordinates, m."""
PILLAR_RADIUS = 0.14


def bay(x: float) -> Corners:
    """Return a window bay with its west end at x: a trapezoid with a sill."""
    return [
        (x, 13.84), (x + 0.25, 14.72), (x + 0.50, 14.72), (x + 0.50, 14.53),
        (x + 1.50, 14.53), (x + 1.50, 14.72), (x + 1.75, 14.72), (x + 2.00, 13.84),
    ]  # fmt: skip


def cabinet(x: float) -> Corners:
    """Return a cabinet with its west face at x."""
    return [(x, 13.84), (x, 11.91), (x + 0.94, 11.91), (x + 0.94, 13.84)]


def niche(x: float, y: float) -> Corners:
    """Return a niche in the south wall, with its west end at x, south to y."""
    return [(x + 0.88, 10.41), (x + 0.88, y), (x, y), (x, 10.41)]


def floor() -> Corners:
    """Return the border of the free floor, clockwise from the corridor's south-west corner."""
    north = sorted([bay(x) for x in SHAPES["bays"]] + [cabinet(x) for x in SHAPES["cabinets"]])
    offices = [[(x + shift, y) for x, y in SHAPES["office"]] for shift in SHAPES["offices"]]
    south = sorted([niche(x, y) for x, y in SHAPES["niches"]] + offices, reverse=True)
    parts = [SHAPES["kitchen"], *north, SHAPES["east_end"], *south]
    return [corner for part in parts for corner in part]


def inside(corners: Corners) -> Flags:
    """Return the pixels with their centre in the polygon (even-odd rule): (ROWS, COLUMNS), row 0 south.

    Corners are first rounded to pixel corners, where the walls of the original are.
    """
    x, y = np.round(np.array(corners) / RESOLUTION).T
    x_next, y_next = np.roll(x, -1), np.roll(y, -1)
    middle = np.arange(COLUMNS) + 0.5
    mask = np.zeros((ROWS, COLUMNS), dtype=np.bool_)
    for row in range(ROWS):
        height = row + 0.5
        crossing = (y < height) != (y_next < height)
        share = (height - y[crossing]) / (y_next[crossing] - y[crossing])
        cuts = x[crossing] + share * (x_next[crossing] - x[crossing])
        mask[row] = (cuts[:, None] < middle).sum(axis=0) % 2 == 1
    return mask


def pillars() -> Flags:
    """Return the pixels with their centre in a pillar: (ROWS, COLUMNS), row 0 south."""
    x = (np.arange(COLUMNS) + 0.5) * RESOLUTION
    y = (np.arange(ROWS)[:, None] + 0.5) * RESOLUTION
    mask = np.zeros((ROWS, COLUMNS), dtype=np.bool_)
    for px, py in SHAPES["pillars"]:
        mask |= (x - px) ** 2 + (y - py) ** 2 <= PILLAR_RADIUS**2
    return mask


def draw() -> Octets:
    """Return the map's image, (ROWS, COLUMNS), row 0 north: white floor in a closed black wall, else grey."""
    free = inside(floor())
    walled = np.pad(free, WALL)
    near = np.zeros_like(free)
    for down in range(2 * WALL + 1):
        for right in range(2 * WALL + 1):
            near |= walled[down : down + ROWS, right : right + COLUMNS]
    pixels = np.full((ROWS, COLUMNS), GREY, dtype=np.uint8)
    pixels[near | pillars()] = BLACK
    pixels[free & ~pillars()] = WHITE
    return np.flipud(pixels)


def main(directory: Path) -> None:
    """Write both files into `directory`."""
    Image.fromarray(draw()).save(directory / "corridor.png", optimize=True)
    (directory / "corridor.yaml").write_text(
        header("corridor.png", "draw_corridor.py", RESOLUTION), encoding="utf-8"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
