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
    try:
        with path.open("rb") as file:
            text = file.read(BYTES_LIMIT + 1)
        if len(text) > BYTES_LIMIT:
            raise PlacesError(
                f"{path}: a file of places may have at most {BYTES_LIMIT} bytes, and this has more"
            )
        content = toml_file.loads(text.decode("utf-8"))
    except OSError as error:
        raise PlacesError(f"cannot read the places {path}: {error.strerror}") from None
    except ValueError as error:  # no TOML, or no UTF-8
        raise PlacesError(f"{path} is no TOML file: {error}") from None
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
