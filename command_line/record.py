"""What can be done with the recordings of a run, on the command line."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Out = Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder.")]


_Target = Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder, or one recording.")]


@app.command()
def info(out: _Target) -> None:
    """Say what recordings hold: how long, what, how often, how large, and whether they are whole."""
    from observation.recordings import info as figures

    found = figures.info(out)
    for one in found:
        for text in figures.sentences(one, topics=out.is_file()):
            print(text)
    if len(found) > 1:
        print(figures.total(found))


@app.command()
def merge(
    out: _Out,
    file: Annotated[Path, typer.Option("--out", "-o", metavar="FILE.mcap", help="New file.")],
) -> None:
    """Write the recordings of a run into one file, in canonical order, for any reader of MCAP files."""
    from deploy.run import out_folder
    from observation.recordings import merged_file

    with out_folder.writing(file.absolute().parent):
        report = merged_file.merge(out, file)
    print(f"{file}: {report.about.messages} messages of digest {report.about.digest}; {report.size} B")


@app.command()
def check(out: _Target) -> None:
    """Compare recordings with their checksums, one another and the result, and all files with the seal.

    Of one file alone, also a merged one, say whether it is as it was written, and what it is.
    """
    from observation.recordings import merged_file
    from observation.replay import record_check
    from observation.results import seal

    console = Console(soft_wrap=True, highlight=False)
    if out.is_file():
        console.print(merged_file.sentence(out), markup=False)
        return
    if not any(out.glob("*/*.mcap")) and (sealed := seal.check_seal(out)) is not None:
        console.print(seal.sentence(out, sealed), markup=False)
        return
    report = record_check.check(out)
    digest = f"digest {report.digest}" if report.digest else "no digest without a recording of the world,"
    console.print(f"{digest} over {report.messages} messages")
    if report.unreceived:
        console.print(f"{report.unreceived} messages were taken by nobody: who they were for had ended")
    if not report.complete:
        until = "not even to the first step" if report.good_until is None else f"to step {report.good_until}"
        console.print(
            "the run did not end as planned: this is the digest of what was recorded until then; every "
            f"recording is good up {until}"
        )
    console.print(seal.sentence(out, report.sealed), markup=False)
