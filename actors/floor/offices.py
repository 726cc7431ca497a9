"""Floors drawn from boxes and discs, and generated office floors."""

from functools import lru_cache
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Flags, Octets
from actors.floor.placement import Area
from actors.geometry import Point
from actors.randomness import generator
from actors.runtime.errors import AcrcError

RESOLUTION: Final = 0.05
BLACK: Final = 0
WHITE: Final = 254
"""Brightness of occupied and free pixels as written by ROS map_saver."""

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1: west, south, east and north edge, m, multiples of RESOLUTION."""
Disc = tuple[float, float, float]
"""x, y, radius, m."""


class DrawnFloor(msgspec.Struct, frozen=True):
    """Obstacles on a rectangle with walls on its border."""

    width: float
    height: float
    walls: tuple[Box, ...]
    doors: tuple[Box, ...]
    """Openings in the walls."""
    furniture: tuple[Box, ...] = ()
    pillars: tuple[Disc, ...] = ()


def draw(floor: DrawnFloor) -> Octets:
    """Return the brightness of the map's pixels, row 0 north."""
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


def header(image: str, drawn_by: str, resolution: float = RESOLUTION) -> str:
    """Return the map's YAML."""
    return (
        f"# drawn by {drawn_by}\nimage: {image}\nresolution: {resolution}\n"
        "origin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def _fill(pixels: Octets, box: Box, brightness: int) -> None:
    """Paint a box; row 0 of `pixels` is south."""
    x0, y0, x1, y1 = (round(edge / RESOLUTION) for edge in box)
    pixels[y0:y1, x0:x1] = brightness


PREFIX: Final = "offices:"
_MAX_SEED: Final = 2**63 - 1
_MAX_NAME: Final = 200
"""Maximum length of a name, characters."""


class OfficesError(AcrcError):
    """An invalid name of an office floor."""


class _Range(msgspec.Struct, frozen=True):
    """Bounds of a parameter, and of its random value if the name does not set it; cells or whole numbers."""

    low: int
    high: int
    random_range: tuple[int, int]
    is_length: bool = True

    @property
    def unit(self) -> float:
        return RESOLUTION if self.is_length else 1.0

    @property
    def description(self) -> str:
        kind = f"multiple of {RESOLUTION:g} m" if self.is_length else "whole number"
        end = " m" if self.is_length else ""
        return f"a {kind} from {self.low * self.unit:g} to {self.high * self.unit:g}{end}"


PARAMETERS: Final = {
    "count": _Range(1, 20, (4, 10), is_length=False),
    "door_width": _Range(18, 26, (18, 26)),
    "corridor_width": _Range(36, 60, (36, 52)),
    "furniture": _Range(0, 2, (0, 2), is_length=False),
}
"""count: number of offices. door_width: width of all doors; if absent, each has its own. corridor_width.
furniture: pieces in every office; if absent, each has its own number. Doors below 0.9 m are impassable for
the original's navigation; above 1.3 m two robots can pass each other; a corridor of 1.8 m is wide."""

_BORDER: Final = 2
_WALL: Final = 8
"""Thickness of the inner walls, cells. Own choice: with 6 cells, the two sides of a door of 1.3 m would be
one region (`actors.floor.doors`)."""
_DEPTH: Final = (70, 110)
_WIDTH: Final = (54, 110)
"""Range of office widths, cells; offices are widened if their side is shorter than the corridor."""
_CORNER: Final = 6
"""Minimum distance from a door to the next corner, cells."""
_APART: Final = 20
"""Minimum distance from the corridor to a door between two offices, cells: each is a separate narrow
place."""
_TWO_DOORS: Final = 90
"""Width from which an office may have two doors, cells."""
_PIECE: Final = ((16, 32), (12, 16))
"""Length along the wall and depth of a piece of furniture, cells."""


class OfficeParameters(msgspec.Struct, frozen=True):
    """Parameters of a generated floor: seed, and values set by the name (lengths in cells)."""

    seed: int
    fixed: tuple[tuple[str, int], ...] = ()

    @property
    def name(self) -> str:
        """Canonical name of this floor."""
        parts = [f"{PREFIX}{self.seed}"]
        for key, value in self.fixed:
            is_length = PARAMETERS[key].is_length
            parts.append(f"{key}={value * RESOLUTION:.2f}" if is_length else f"{key}={value}")
        return ",".join(parts)

    def value(self, key: str, rng: Generator) -> int:
        """Return the value set by the name, otherwise a random one; always draw one number."""
        low, high = PARAMETERS[key].random_range
        number = int(rng.integers(low, high, endpoint=True))
        return dict(self.fixed).get(key, number)

    def stream(self, purpose: str) -> Generator:
        """Return the random generator for a part of the floor."""
        return generator(self.seed, "offices", purpose)


class OfficeFloor(msgspec.Struct, frozen=True):
    """A generated floor with its rooms and doors."""

    floor: DrawnFloor
    rooms: tuple[Area, ...]
    """The corridor, then the offices, from south-west to north-east."""
    doors: tuple[Point, ...]
    """Centre of every door."""


class _Office(msgspec.Struct, frozen=True):
    """An office, in cells: x0 to x1, y0 to y1; the corridor is to its north or south."""

    x0: int
    x1: int
    y0: int
    y1: int
    northward: bool


def is_name(text: str | Path) -> bool:
    """Return whether `text` names a generated floor rather than a file."""
    return str(text).startswith(PREFIX)


def parse(name: str) -> OfficeParameters:
    """Return the floor of this name. Raises OfficesError."""
    if len(name) > _MAX_NAME:
        raise OfficesError(f"the floor name has {len(name)} characters; at most {_MAX_NAME} are allowed")
    seed, *others = name.removeprefix(PREFIX).split(",")
    if not (seed.isascii() and seed.isdigit() and int(seed) <= _MAX_SEED):
        raise OfficesError(
            f"{name!r}: the seed is {seed!r}, but must be a whole number from 0 to {_MAX_SEED}, as in"
            " 'offices:7'"
        )
    fixed: dict[str, int] = {}
    for item in others:
        key, _, text = item.partition("=")
        if key not in PARAMETERS or key in fixed:
            fault = "is given twice" if key in fixed else "is not a parameter"
            raise OfficesError(f"{name!r}: {key!r} {fault}; the parameters are {', '.join(PARAMETERS)}")
        fixed[key] = _value(name, key, text)
    return OfficeParameters(int(seed), tuple((key, fixed[key]) for key in PARAMETERS if key in fixed))


def _value(name: str, key: str, text: str) -> int:
    allowed = PARAMETERS[key]
    try:
        number = float(text) / allowed.unit
    except ValueError:
        number = float("nan")
    if not (allowed.low - 0.5 < number < allowed.high + 0.5 and abs(number - round(number)) < 1e-6):
        raise OfficesError(f"{name!r}: {key} is {text!r}, but must be {allowed.description}")
    return round(number)


@lru_cache(maxsize=16)
def office_floor(name: str) -> OfficeFloor:
    """Return the floor of this name. Raises OfficesError."""
    parameters = parse(name)
    shape = parameters.stream("shape")
    count, corridor = parameters.value("count", shape), parameters.value("corridor_width", shape)
    south = _south_count(count, shape)
    depths = shape.integers(*_DEPTH, size=2, endpoint=True).tolist()
    # offices of the shorter side are widened to the length of the longer one
    sides = [shape.integers(*_WIDTH, size=n, endpoint=True).tolist() for n in (south, count - south)]
    length = max(_length(widths) for widths in sides)
    sides = [_widened(widths, length, shape) for widths in sides]
    y0 = _BORDER + depths[0] + _WALL
    y1 = y0 + corridor
    top = y1 + (_WALL + depths[1] if sides[1] else 0)
    rooms = [
        [_Office(x0, x1, _BORDER, y0 - _WALL, northward=True) for x0, x1 in _spans(sides[0])],
        [_Office(x0, x1, y1 + _WALL, top, northward=False) for x0, x1 in _spans(sides[1])],
    ]
    doors = _doors(parameters, rooms)
    hall = (_BORDER, y0, _BORDER + length, y1)
    free = [hall, *((room.x0, room.y0, room.x1, room.y1) for side in rooms for room in side)]
    width, height = length + 2 * _BORDER, top + _BORDER
    wall = _box((0, 0, width, height))
    openings = tuple(_box(box) for box in (*free, *doors))
    furniture = tuple(_box(box) for box in _furniture(parameters, rooms))
    names = ["corridor", *(f"office {number}" for number in range(1, len(free)))]
    return OfficeFloor(
        DrawnFloor(*wall[2:], (wall,), openings, furniture),
        tuple(Area(name, *_box(box)) for name, box in zip(names, free, strict=True)),
        tuple(Point((x0 + x1) * RESOLUTION / 2, (y0 + y1) * RESOLUTION / 2) for x0, y0, x1, y1 in doors),
    )


def cells_of(name: str) -> Flags:
    """Return which cells are occupied, (rows, columns), row 0 south. Raises OfficesError."""
    return np.flipud(draw(office_floor(name).floor) == BLACK)


def write(name: str, stem: Path) -> None:
    """Write the map files `stem`.yaml and `stem`.pbm (netpbm, P4), with equal bytes on all machines."""
    occupied = np.flipud(cells_of(name))
    rows, columns = occupied.shape
    image = stem.with_name(f"{stem.name}.pbm")
    image.write_bytes(f"P4\n{columns} {rows}\n".encode() + np.packbits(occupied, axis=1).tobytes())
    stem.with_name(f"{stem.name}.yaml").write_text(header(image.name, parse(name).name), encoding="utf-8")


def _south_count(count: int, rng: Generator) -> int:
    """Return the number of offices in the south: possibly all if few, else at most two more than in the
    north."""
    one_sided, more = int(rng.integers(4)) == 0, int(rng.integers(-1, 1, endpoint=True))
    if count == 1 or (one_sided and count <= 5):
        return count
    return min(max((count + 1) // 2 + more, 1), count - 1)


def _length(widths: list[int]) -> int:
    """Return the length of a side, from its first office to its last, cells."""
    return sum(int(width) for width in widths) + (len(widths) - 1) * _WALL


def _widened(widths: list[int], length: int, rng: Generator) -> list[int]:
    """Return the widths with the remaining length added in random shares."""
    if not widths:
        return []
    left = length - _length(widths)
    cuts = sorted(rng.integers(0, left, size=len(widths) - 1, endpoint=True).tolist())
    shares = [after - before for before, after in pairwise([0, *cuts, left])]
    return [width + share for width, share in zip(widths, shares, strict=True)]


def _spans(widths: list[int]) -> list[tuple[int, int]]:
    """Return west and east edge of each office of a side."""
    begins = accumulate((width + _WALL for width in widths), initial=_BORDER)
    return [(x, x + width) for x, width in zip(begins, widths, strict=False)]


_Cells = tuple[int, int, int, int]


def _doors(parameters: OfficeParameters, sides: list[list[_Office]]) -> list[_Cells]:
    rng = parameters.stream("doors")
    found: list[_Cells] = []
    for room in (room for side in sides for room in side):
        middle = (room.x0 + room.x1) // 2
        two, wide = int(rng.integers(2)) == 0, room.x1 - room.x0 >= _TWO_DOORS
        for x0, x1 in [(room.x0, middle), (middle, room.x1)] if two and wide else [(room.x0, room.x1)]:
            width, share = parameters.value("door_width", rng), int(rng.integers(1 << 30))
            x = x0 + _CORNER + share % (x1 - x0 - 2 * _CORNER - width + 1)
            y = room.y1 if room.northward else room.y0 - _WALL
            found.append((x, y, x + width, y + _WALL))
    for west, east in (pair for side in sides for pair in pairwise(side)):
        joined, width = int(rng.integers(4)) == 0, parameters.value("door_width", rng)
        from_corridor = _APART + int(rng.integers(1 << 30)) % (
            west.y1 - west.y0 - _APART - _PIECE[1][1] - _CORNER - width + 1
        )
        y = west.y1 - from_corridor - width if west.northward else west.y0 + from_corridor
        if joined:
            found.append((west.x1, y, east.x0, y + width))
    return found


def _furniture(parameters: OfficeParameters, sides: list[list[_Office]]) -> list[_Cells]:
    """Return pieces of furniture in corners away from the corridor and the doors."""
    rng = parameters.stream("furniture")
    found: list[_Cells] = []
    for room in (room for side in sides for room in side):
        count, first = parameters.value("furniture", rng), int(rng.integers(2))
        for number in range(2):
            length = min(int(rng.integers(*_PIECE[0], endpoint=True)), (room.x1 - room.x0) // 2 - 2)
            depth = int(rng.integers(*_PIECE[1], endpoint=True))
            x = room.x0 if (first + number) % 2 else room.x1 - length
            y = room.y0 if room.northward else room.y1 - depth
            if number < count:
                found.append((x, y, x + length, y + depth))
    return found


def _box(cells: _Cells) -> Box:
    x0, y0, x1, y1 = (round(cell * RESOLUTION, 2) for cell in cells)
    return x0, y0, x1, y1
