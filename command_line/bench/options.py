"""Options that several benchmarks have."""

from pathlib import Path
from typing import Annotated, Final

import typer

from actors.installation.repository import REPOSITORY

CORRIDOR: Final = REPOSITORY / "maps" / "corridor.yaml"
MapFile = Annotated[
    Path | None, typer.Option("--map", metavar="YAML", help="Floor plan.  [default: maps/corridor.yaml]")
]
Localisation = Annotated[
    str | None, typer.Option(metavar="PRESET", help="As in [localisation] of a scenario.")
]
Navigation = Annotated[
    str | None, typer.Option("--navigation", metavar="PRESET", help="As in [navigation] of a scenario.")
]
