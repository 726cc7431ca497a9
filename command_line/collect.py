"""`acrc fleet collect`."""

from pathlib import Path
from typing import Annotated

import typer

from command_line.options import Json


def collect(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER…", help="A robot's folder, such as runs/mine/r2, or one that holds such."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="New folder for run.json and places.csv.  [default: print only]"),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="What the laboratory of emulated devices says truly happened."),
    ] = None,
    json: Json = False,
) -> None:
    """Gather what robots have recorded on a field trial: align their clocks, and say what came of it."""
    from deploy.fleet import collect as recordings
    from observation.field_trial.trial_summary import print_field_trial

    print_field_trial(recordings.collect(folders, out, truth), json=json)
