"""Scenarios and studies by name: those that come with the testbed need no path."""

from os import PathLike
from pathlib import Path

from actors.installation.repository import SHIPPED


def file_of(kind: str, named: str | PathLike[str]) -> Path:
    """The file of a shipped scenario or study, by its name; of whatever else the path. `kind`: its folder."""
    shipped = SHIPPED / kind / f"{named}.toml"
    return shipped if str(named).isidentifier() and shipped.is_file() else Path(named)
