"""`acrc fleet collect`."""

from pathlib import Path
from typing import Annotated

import typer

from command_line.options import Json


def collect(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER…", help="A robot's folder, such as runs/mine/r2, or a folder of these."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="New folder for run.json and places.csv.  [default: print only]"),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Ground truth, by the laboratory of emulated devices."),
    ] = None,
    json: Json = False,
) -> None:
    """Collect recordings of a field trial and align their clocks."""
    from deploy.fleet import collect as recordings
    from observation.field_trial.trial_summary import print_field_trial

    print_field_trial(recordings.collect(folders, out, truth), json=json)
