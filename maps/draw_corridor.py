"""Generator of corridor.png and corridor.yaml: `python maps/draw_corridor.py [directory]`.

The floor of the original testbed: a corridor with window bays, cabinets and pillars, a kitchen at its west
end and two offices to its south, each behind a passage that two robots can barely share. Coordinates were
measured, in m, on the original map (d3scomp/ROSRemote, simulation/corridor.png, Apache-2.0).
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from actors.array_types import Flags, Octets

RESOLUTION = 0.03125
ROWS, COLUMNS = 474, 941
WALL = 3
"""Thickness of the walls, pixels."""
BLACK, GREY, WHITE = 0, 205, 254
"""Brightness of occupied, unknown and free cells, as written by ROS map_saver."""

Corners = list[tuple[float, float]]

BAYS = (1.84, 6.62, 11.38, 16.38, 20.91, 25.56)
CABINETS = (4.84, 14.34, 23.81)
NICHES = ((26.25, 10.09), (21.53, 10.12), (7.19, 10.12), (2.28, 10.12))
OFFICES = (0.0, 4.81)
PILLARS = ((7.64, 13.89), (12.45, 13.92), (17.36, 13.83), (21.95, 13.95), (26.45, 13.89))
PILLAR_RADIUS = 0.14

KITCHEN: Corners = [
    (1.84, 10.41), (1.84, 11.75), (0.81, 11.75), (0.81, 11.59), (0.09, 11.59),
    (0.09, 13.31), (1.50, 13.31), (1.50, 12.50), (1.84, 12.50),
]  # fmt: skip
EAST_END: Corners = [
    (28.12, 13.84), (28.12, 13.56), (28.53, 13.56), (28.53, 13.84), (29.06, 13.84), (29.06, 13.38),
    (28.75, 13.38), (28.75, 12.97), (29.06, 12.97), (29.06, 12.47), (29.31, 12.47), (29.31, 11.62),
    (28.97, 11.62), (28.97, 10.41),
]  # fmt: skip
OFFICE: Corners = [
    # the passage's east side and the alcoves east of the aisle, going south
    (12.88, 10.41), (12.88, 9.84), (13.03, 9.84), (13.03, 9.22), (12.94, 9.22), (12.94, 8.06),
    (13.88, 8.06), (13.88, 7.31), (13.75, 7.31), (13.75, 6.75), (14.62, 6.75), (14.62, 5.88),
    (13.75, 5.88), (13.75, 5.31), (14.62, 5.31), (14.62, 4.44), (13.75, 4.44), (13.75, 3.25),
    (14.62, 3.25), (14.62, 2.38), (13.75, 2.38), (13.75, 1.81), (14.62, 1.81), (14.62, 0.88),
    # the south wall, going west: the radiator between its two slots, and a bump
    (13.25, 0.88), (13.25, 0.09), (13.16, 0.09), (13.16, 0.94), (11.97, 0.94), (11.97, 0.09),
    (11.88, 0.09), (11.88, 0.88), (11.22, 0.88), (11.22, 1.06), (11.12, 1.16), (11.00, 1.16),
    (10.88, 1.06), (10.88, 0.88),
    # the alcoves west of the aisle, going north, and the passage's west side
    (10.50, 0.88), (10.50, 1.81), (11.38, 1.81), (11.38, 2.38), (10.50, 2.38), (10.50, 3.25),
    (11.38, 3.25), (11.38, 4.44), (10.50, 4.44), (10.50, 5.31), (11.38, 5.31), (11.38, 5.88),
    (10.50, 5.88), (10.50, 6.75), (11.38, 6.75), (11.38, 7.31), (10.50, 7.31), (10.50, 8.31),
    (12.00, 8.31), (12.00, 10.41),
]  # fmt: skip


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
    north = sorted([bay(x) for x in BAYS] + [cabinet(x) for x in CABINETS])
    offices = [[(x + shift, y) for x, y in OFFICE] for shift in OFFICES]
    south = sorted([niche(x, y) for x, y in NICHES] + offices, reverse=True)
    parts = [KITCHEN, *north, EAST_END, *south]
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
    for px, py in PILLARS:
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


def header() -> str:
    """Return the map's YAML."""
    return (
        f"# drawn by draw_corridor.py\nimage: corridor.png\nresolution: {RESOLUTION}\n"
        "origin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def main(directory: Path) -> None:
    """Write both files into `directory`."""
    Image.fromarray(draw()).save(directory / "corridor.png", optimize=True)
    (directory / "corridor.yaml").write_text(header(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
