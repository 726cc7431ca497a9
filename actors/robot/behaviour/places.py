"""A robot's list of places to be cleaned, from its file."""

import math
from pathlib import Path
from typing import Final

from actors import toml_file
from actors.geometry import Point
from actors.runtime.errors import AcrcError

BYTES_LIMIT: Final = 1_000_000
"""Size of the file; 10 000 places have a third of that."""


class PlacesError(AcrcError):
    """A file of places that cannot be used."""


def load_places(path: Path) -> tuple[Point, ...]:
    """The places in a TOML file with one key, `places = [[x, y], ...]`, m in the map frame."""
    content = toml_file.tables(toml_file.read(path, "places", PlacesError, BYTES_LIMIT), path, PlacesError)
    places = content.get("places")
    if list(content) != ["places"] or not isinstance(places, list):
        raise PlacesError(f"{path} should have one key, places = [[x, y], ...], and has {list(content)}")
    return tuple(_place(path, index, place) for index, place in enumerate(places))


def _place(path: Path, index: int, place: object) -> Point:
    if not (isinstance(place, list) and len(place) == 2 and all(map(_is_coordinate, place))):
        raise PlacesError(f"{path}: place {index} is {place!r}; it should be [x, y] in m")
    return Point(float(place[0]), float(place[1]))


def _is_coordinate(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
