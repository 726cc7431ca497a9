"""`acrc bench localisation`."""

from pathlib import Path
from typing import Annotated

import typer

from actors.installation.repository import REPOSITORY
from command_line.options import Json

_MAPS = REPOSITORY / "maps"


def localisation(
    cell: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Part of it: alone, realistic, tracking, causes, crowd, range, mask, global, kidnapped "
            "or cpu.",
        ),
    ] = None,
    runs: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="Runs per cell.")] = 20,
    long_runs: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=10_000, help="Runs per cell of the sections alone and realistic."
        ),
    ] = 100,
    duration: Annotated[float, typer.Option(metavar="S", min=1, max=3600, help="Of a course.")] = 240.0,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=256, help="Processes.  [default: one per processor]")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Only write the course of the first such cell, from --seed."),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the course for --log.")] = 1,
    source: Annotated[
        Path | None,
        typer.Option("--from", metavar="FILE", help="Only feed the filter with a log, or a folder of them."),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(metavar="JSON", help="With --from: compare with what another one made of these logs."),
    ] = None,
    json: Json = False,
) -> None:
    """Measure how well the robot keeps track of where it is, beside the truth."""
    from benchmarks.localisation import cells, command, logs

    extent = cells.Extent(runs, long_runs, duration)
    corridor, others = _MAPS / "corridor.yaml", [_MAPS / "apartment.yaml", _MAPS / "maze.yaml"]
    if log is not None and source is not None:
        raise typer.BadParameter("is another thing to do than --from", param_hint="--log")
    if against is not None and source is None:
        raise typer.BadParameter("needs --from, the logs to compare on", param_hint="--against")
    if log is not None:
        command.write_log(log, corridor, others, cell or (), seed, extent)
    elif source is not None:
        logs.run(source, runs, against, json)
    else:
        command.run(corridor, others, cell or (), extent, workers, json)
