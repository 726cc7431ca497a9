"""The benchmarks on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from deploy.repository import REPOSITORY

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command("map")
def compare_map(
    against: Annotated[Path, typer.Option(metavar="DIR", help="Folder with the other map, one *.yaml.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="YAML", help="[default: maps/corridor.yaml]")
    ] = None,
    json: _Json = False,
) -> None:
    """Say how like a map is to another one."""
    from benchmarks import map as likeness

    likeness.run(against, map_file or REPOSITORY / "maps" / "corridor.yaml", json)
