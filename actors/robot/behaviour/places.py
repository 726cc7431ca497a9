"""A robot's list of places to be cleaned, from its file."""

from pathlib import Path
from typing import Annotated, Final

from pydantic import BeforeValidator, FailFast

from actors import geometry, table_wording
from actors.runtime.errors import AcrcError
from actors.table import A_POINT, Point, Right, Table, as_tuples

BYTES_LIMIT: Final = 1_000_000
"""Size of the file; 10 000 places have a third of that."""


class PlacesError(AcrcError):
    """A file of places that cannot be used."""


class _PlacesFile(Table):
    places: Annotated[
        tuple[Point, ...],
        FailFast(),
        BeforeValidator(as_tuples),
        Right("a list of points [x, y] in m", item=A_POINT),
    ]


def load_places(path: Path) -> tuple[geometry.Point, ...]:
    """The places in a TOML file with one key, `places = [[x, y], ...]`, m in the map frame."""
    file = table_wording.load(path, _PlacesFile, "places", PlacesError, BYTES_LIMIT)
    return tuple(geometry.Point(x, y) for x, y in file.places)
