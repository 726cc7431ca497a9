"""Generator of the maps maze, apartment and warehouse: `python maps/draw_floors.py [directory [name …]]`.

The maze has nested rectangular corridors, 10 m by 10 m at 0.05 m per pixel, like the second map of the
original testbed (d3scomp/ROSRemote, simulation/maze.yaml), but another layout. The apartment has rooms of
different sizes behind doors 0.9 m to 1.0 m wide, pillars, and tables whose legs a range sensor detects.
The warehouse has rows of racks, 0.8 m deep, with aisles 1.6 m wide, and wider ones around and across them.
No floor has a rotation or reflection symmetry, so scans determine a pose. With names such as `offices:7` it
writes these office floors instead (`actors/floor/offices.py`), for editing by hand.
"""

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from actors.floor import offices
from actors.floor.offices import Box, Disc, DrawnFloor, draw, header


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


FLOORS = tomllib.loads(Path(__file__).with_name("floors.toml").read_text("utf-8"))


def drawn_floor(
    width: float,
    height: float,
    doors: Sequence[Box],
    rings: Sequence[Box] = (),
    walls: Sequence[Box] = (),
    furniture: Sequence[Box] = (),
    tables: Sequence[Box] = (),
    pillars: Sequence[Disc] = (),
) -> DrawnFloor:
    """Return the floor of a table of floors.toml."""
    borders = (wall for outer in rings for wall in ring(*outer))
    legs = (leg for one in tables for leg in table(*one))
    return DrawnFloor(width, height, (*borders, *walls), tuple(doors), (*furniture, *legs), tuple(pillars))


def main(directory: Path, names: Sequence[str] = ()) -> None:
    """Write the files of all fixed floors, or of the office floors `names`, into `directory`."""
    for name in names:
        offices.write(name, directory / name.replace(":", "-"))
    if names:
        return
    for name, floor in FLOORS.items():
        Image.fromarray(draw(drawn_floor(**floor))).save(directory / f"{name}.png", optimize=True)
        (directory / f"{name}.yaml").write_text(header(f"{name}.png", "draw_floors.py"), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent, sys.argv[2:])
