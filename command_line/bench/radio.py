"""The radio's medium on the command line: truth, speed, figures."""

from pathlib import Path
from typing import Annotated

import typer

from command_line.bench.options import CORRIDOR, MapFile
from command_line.options import Json


def radio_truth(
    data: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder with the rows of ns-3, one CSV per family.")
    ],
    times: Annotated[int, typer.Option(metavar="N", min=1, help="Own frames per frame of the rows.")] = 10,
    json: Json = False,
) -> None:
    """Compare the radio's medium with figures of ns-3, point by point."""
    from benchmarks.radio import truth

    truth.run(data, json, truth.TruthTask(times=times))


def radio_speed(
    ns3: Annotated[
        Path | None,
        typer.Option(metavar="PYTHON", help="Interpreter of an environment with the package ns3."),
    ] = None,
    json: Json = False,
) -> None:
    """Measure frames on the air per CPU second, beside ns-3."""
    from benchmarks.radio import speed

    if ns3 is not None and ns3.exists():  # else it is looked for where programs are
        ns3 = ns3.absolute()
    speed.run(ns3, json)


def radio_hardware(json: Json = False) -> None:
    """Measure what the BEE-click firmware's clear channel assessment costs."""
    from benchmarks.radio import hardware

    hardware.run(json)


def radio_plots(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the figures are written.")],
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder with the figures of ns-3, for its dots.")
    ] = None,
    map_file: MapFile = None,
    json: Json = False,
) -> None:
    """Draw the figures of docs/radio.md."""
    from benchmarks.radio import plots

    plots.run(out, map_file or CORRIDOR, data, json)
