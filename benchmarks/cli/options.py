"""Options that several benchmarks have."""

from pathlib import Path
from typing import Annotated, Final

import typer

from deploy.repository import REPOSITORY

CORRIDOR: Final = REPOSITORY / "maps" / "corridor.yaml"
MapFile = Annotated[
    Path | None, typer.Option("--map", metavar="YAML", help="Floor plan.  [default: maps/corridor.yaml]")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
Localisation = Annotated[
    str | None, typer.Option(metavar="PRESET", help="As in [localisation] of a scenario.")
]
Navigation = Annotated[
    str | None, typer.Option("--navigation", metavar="PRESET", help="As in [navigation] of a scenario.")
]
