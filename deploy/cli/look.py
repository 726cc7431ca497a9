"""`acrc demo` and `acrc view`: what happened, as pictures."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from deploy.usage import OptionError


def demo(
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="New folder for both runs and the picture.  [default: in runs/]"),
    ] = None,
) -> None:
    """Show the problem and its cure: two robots meet in a doorway, without adaptation and with it."""
    from deploy.evidence.run_evidence import read_run
    from deploy.picture import side_by_side
    from deploy.processes.signals import Interrupted
    from deploy.run import demonstration, out_folder
    from deploy.run.kernels import compile_kernels
    from deploy.run.options import folder_name, run_options

    name = folder_name(Path("demo"))
    options = run_options(out or Path("runs", name))
    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    try:
        with out_folder.dropped_if_empty(options.out), out_folder.writing(options.out):
            compile_kernels(quiet=False)
            shown = list(demonstration.demonstrate(options))
    except Interrupted as interrupt:
        raise typer.Exit(interrupt.exit_code) from None
    runs = [read_run(options.out / one.strategy) for one in shown]
    pictures = [options.out / "demo.png", options.out / "demo.svg"]
    with out_folder.writing(options.out):
        for picture in pictures:
            side_by_side.write(runs, picture)
    console = Console(soft_wrap=True, highlight=False)
    for sentence in demonstration.sentences(shown, len(runs[-1].taken_over), pictures):
        console.print(sentence, markup=False)


def view(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder.")],
    png: Annotated[bool, typer.Option("--png", help="Draw the run on one page: OUT/run.png.")] = False,
    svg: Annotated[bool, typer.Option("--svg", help="The same as OUT/run.svg.")] = False,
) -> None:
    """Draw what a run's recordings show: floor, trails, places, meetings, radio, progress."""
    if not (png or svg):
        raise OptionError(f"view {out}: should stand with --png or --svg")
    from deploy.evidence.run_evidence import read_run
    from deploy.picture import run_page
    from deploy.run import out_folder

    run = read_run(out)
    console = Console(soft_wrap=True, highlight=False)
    for wished, name in ((png, "run.png"), (svg, "run.svg")):
        if wished:
            with out_folder.writing(out):
                run_page.write(run, out / name)
            console.print(str(out / name), markup=False)
