"""Generator of the maps maze, apartment and warehouse: `python maps/draw_floors.py [directory [name …]]`.

The maze has nested rectangular corridors, 10 m by 10 m at 0.05 m per pixel, like the second map of the
original testbed (d3scomp/ROSRemote, simulation/maze.yaml), but another layout. The apartment has rooms of
different sizes behind doors 0.9 m to 1.0 m wide, pillars, and tables whose legs a range sensor detects.
The warehouse has rows of racks, 0.8 m deep, with aisles 1.6 m wide, and wider ones around and across them.
No floor has a rotation or reflection symmetry, so scans determine a pose. With names such as `offices:7` it
writes these office floors instead (`actors/floor/offices.py`), for editing by hand.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from actors.floor import offices
from actors.floor.offices import Box, DrawnFloor, draw, header


def ring(west: float, south: float, east: float, north: float) -> tuple[Box, ...]:
    """Return four walls, 0.10 m thick, with these outer faces, m."""
    return (
        (west, south, east, south + 0.10),
        (west, north - 0.10, east, north),
        (west, south, west + 0.10, north),
        (east - 0.10, south, east, north),
    )


def table(x: float, y: float, length: float, depth: float) -> tuple[Box, ...]:
    """Return the four legs, 0.05 m thick, of a table with its south-west corner at (x, y)."""
    east, north = x + length - 0.05, y + depth - 0.05
    return tuple((px, py, px + 0.05, py + 0.05) for px in (x, east) for py in (y, north))


RACKS = ((1.90, 0.00), (4.30, 0.40), (6.70, 0.80), (9.10, 1.20), (11.50, 1.60))
"""South edge of the rows of racks in the warehouse, and by how much they are shorter at both ends, m."""

MAZE = DrawnFloor(
    width=10.0,
    height=10.0,
    walls=(
        *ring(0.00, 0.00, 10.00, 10.00),
        *ring(1.40, 1.20, 8.45, 8.75),  # off centre: corridors differ in width
        *ring(2.65, 2.75, 7.00, 7.45),
        *ring(4.10, 3.85, 5.95, 6.35),
        (4.00, 8.75, 4.10, 9.90),  # each closes a corridor, which forces a detour
        (0.10, 6.40, 1.40, 6.50),
        (7.00, 3.60, 8.35, 3.70),
        (5.60, 2.85, 5.70, 3.85),
    ),
    doors=(
        (8.35, 1.80, 8.45, 2.75),
        (2.00, 8.65, 3.00, 8.75),
        (2.65, 5.40, 2.75, 6.30),
        (5.80, 2.75, 6.75, 2.85),
        (4.50, 6.25, 5.45, 6.35),
    ),
    furniture=((9.50, 9.30, 9.90, 9.90), (0.10, 0.10, 0.60, 0.40), (5.35, 3.95, 5.85, 4.40)),
    pillars=((2.05, 2.05, 0.15), (7.70, 5.40, 0.10)),
)

APARTMENT = DrawnFloor(
    width=16.0,
    height=11.0,
    walls=(
        (0.00, 0.00, 16.00, 0.10),
        (0.00, 10.90, 16.00, 11.00),
        (0.00, 0.00, 0.10, 11.00),
        (15.90, 0.00, 16.00, 11.00),
        (0.10, 6.20, 9.00, 6.30),  # north side of the hallway
        (0.10, 4.80, 5.60, 4.90),  # south side of the hallway
        (3.80, 6.30, 3.90, 10.90),
        (6.60, 6.30, 6.70, 10.90),
        (3.20, 0.10, 3.30, 4.80),
        (5.60, 0.10, 5.70, 4.90),
        (9.00, 7.30, 9.10, 10.90),
        (9.00, 6.20, 9.10, 7.30),
        (12.90, 0.10, 13.00, 3.40),
        (12.90, 3.40, 15.90, 3.50),
    ),
    doors=(
        (2.40, 6.20, 3.30, 6.30),  # bedroom
        (4.60, 6.20, 5.55, 6.30),  # study
        (7.70, 6.20, 8.65, 6.30),  # kitchen, from the hallway
        (9.00, 9.20, 9.10, 10.15),  # kitchen, from the hall
        (1.20, 4.80, 2.15, 4.90),  # store
        (4.00, 4.80, 4.90, 4.90),  # bathroom
        (12.90, 1.20, 13.00, 2.20),  # pantry
    ),
    furniture=(
        (0.10, 8.60, 1.70, 10.90),  # bed
        (3.20, 9.60, 3.80, 10.90),
        (3.90, 10.30, 5.40, 10.90),  # desk
        (6.70, 10.30, 9.00, 10.90),  # worktop
        (6.70, 8.20, 7.30, 10.30),
        (0.10, 0.10, 0.60, 3.20),  # shelves
        (2.60, 0.10, 3.20, 1.20),
        (3.30, 0.10, 4.10, 1.70),  # bath
        (5.20, 3.30, 5.60, 3.80),
        (5.70, 0.10, 6.20, 2.30),  # cupboard
        (9.60, 0.10, 11.90, 0.90),  # sofa
        (15.10, 9.80, 15.90, 10.90),
        (14.60, 0.10, 15.90, 0.60),
        *table(10.80, 7.60, 1.80, 1.00),
        *table(7.30, 2.60, 1.40, 0.90),
        *table(4.50, 7.30, 1.10, 1.20),
    ),
    pillars=((9.05, 4.60, 0.20), (12.30, 5.20, 0.20), (14.30, 8.30, 0.30), (11.20, 2.70, 0.45)),
)
WAREHOUSE = DrawnFloor(
    width=24.0,
    height=16.0,
    walls=ring(0.00, 0.00, 24.00, 16.00),
    doors=(),
    furniture=(
        *((3.00 + shift, y, 10.00, y + 0.80) for y, shift in RACKS[1:]),
        *((12.20, y, 20.60 - shift, y + 0.80) for y, shift in RACKS[:3]),
        (14.00, 12.20, 15.20, 15.90),  # office
        (21.00, 0.10, 23.90, 0.80),  # packing tables
    ),
    pillars=((11.10, 3.50, 0.15), (11.10, 11.90, 0.15), (22.20, 8.00, 0.20)),
)
FLOORS = {"maze": MAZE, "apartment": APARTMENT, "warehouse": WAREHOUSE}


def main(directory: Path, names: Sequence[str] = ()) -> None:
    """Write the files of all fixed floors, or of the office floors `names`, into `directory`."""
    for name in names:
        offices.write(name, directory / name.replace(":", "-"))
    if names:
        return
    for name, floor in FLOORS.items():
        Image.fromarray(draw(floor)).save(directory / f"{name}.png", optimize=True)
        (directory / f"{name}.yaml").write_text(header(f"{name}.png", "draw_floors.py"), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent, sys.argv[2:])
