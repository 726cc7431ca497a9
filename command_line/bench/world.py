"""Floor plans, scans and physics on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from command_line.bench.options import CORRIDOR, MapFile
from command_line.options import Json


def compare_map(
    against: Annotated[Path, typer.Option(metavar="DIR", help="Folder with the other map, one *.yaml.")],
    map_file: MapFile = None,
    json: Json = False,
) -> None:
    """Say how like a map is to another one."""
    from benchmarks.world import map as likeness

    likeness.run(against, map_file or CORRIDOR, json)


def scan(map_file: MapFile = None, json: Json = False) -> None:
    """Measure range scans, beside those of pymunk."""
    from benchmarks.world import scan as scans

    scans.run(map_file or CORRIDOR, json)


def world(map_file: MapFile = None, json: Json = False) -> None:
    """Measure physics with scans, beside Stage and navground."""
    from benchmarks.world import world as worlds

    worlds.run(map_file or CORRIDOR, json)
