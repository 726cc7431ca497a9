"""Shipped scenarios and studies by name."""

from os import PathLike
from pathlib import Path

from actors.installation.repository import SHIPPED


def file_of(kind: str, named: str | PathLike[str]) -> Path:
    """Return the file of a shipped scenario or study by its name; other values are paths."""
    shipped = SHIPPED / kind / f"{named}.toml"
    return shipped if str(named).isidentifier() and shipped.is_file() else Path(named)
