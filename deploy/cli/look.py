"""`acrc demo`, `acrc view` and `acrc scenario`: what happened, and what a scenario means, as pictures."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from deploy.cli import completion
from deploy.cli.options import Robots, Seed, Setting
from deploy.usage import OptionError, wrong_value


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
    html: Annotated[
        bool, typer.Option("--html", help="The same with sentences and tables: OUT/run.html.")
    ] = False,
    movie: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Robots on the floor as they moved: a .gif, or an .mp4 by ffmpeg."),
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="X", help="Simulated seconds per second of --movie.", min=1.0, max=1000.0)
    ] = 20.0,
) -> None:
    """Draw what a run's recordings show: floor, trails, places, meetings, radio, progress."""
    if not (png or svg or html or movie):
        raise OptionError(f"view {out}: should stand with --png, --svg, --html or --movie")
    from deploy.evidence.run_evidence import read_run
    from deploy.picture import moving, run_html, run_page
    from deploy.run import out_folder

    if movie is not None:
        moving.check(movie)
    run = read_run(out)
    console = Console(soft_wrap=True, highlight=False)
    for wished, name in ((png, "run.png"), (svg, "run.svg")):
        if wished:
            with out_folder.writing(out):
                run_page.write(run, out / name)
            console.print(str(out / name), markup=False)
    if html:
        with out_folder.writing(out):
            run_html.write(run, out / "run.html")
        console.print(str(out / "run.html"), markup=False)
    if movie is not None:
        with out_folder.writing(movie.parent):
            moving.write(run, movie, speed)
        console.print(str(movie), markup=False)


def scenario(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A scenario, a map or a robot model.", autocompletion=completion.scenarios
        ),
    ],
    robots: Robots = None,
    seed: Seed = None,
    setting: Setting = None,
    png: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw it: floor, doors, starts, places, reach of radio."),
    ] = None,
) -> None:
    """Check a scenario, and say what it means on its floor; options replace what it says.

    The file may be a map (.yaml) or a robot model, too: then it is about that alone.
    """
    from deploy.run import out_folder
    from deploy.scenario import part_survey, survey
    from deploy.scenario.resolve import resolve
    from deploy.scenario.scenario_file import Overrides, load_scenario, settings

    if png is not None and (png.suffix not in {".png", ".svg"} or not png.absolute().parent.is_dir()):
        raise wrong_value("--png", png, "a file in a folder that exists, its name ending in .png or .svg")
    if (is_map := file.suffix in {".yaml", ".yml"}) or part_survey.is_model(file):
        if robots is not None or seed is not None or setting:
            raise OptionError(f"{file}: is no scenario; must stand without --robots, --seed and --set")
        _part(file, png, is_map=is_map)
        return
    overrides = Overrides(robots, seed, settings=settings(setting or ()))
    found = survey.survey(resolve(load_scenario(file, overrides)))
    console = Console(soft_wrap=True, highlight=False)
    for sentence in survey.sentences(found):
        console.print(sentence, markup=False)
    if png is None:
        return
    from deploy.picture import scenario_picture

    with out_folder.writing(png.parent):
        scenario_picture.write(found, png)
    console.print(str(png), markup=False)


def _part(file: Path, png: Path | None, *, is_map: bool) -> None:
    """The same for a map or a robot model."""
    from actors.robot_model import load_model
    from deploy.run import out_folder
    from deploy.scenario import part_survey

    floor = part_survey.survey_map(file) if is_map else None
    model = None if is_map else load_model(str(file))
    console = Console(soft_wrap=True, highlight=False)
    told = part_survey.map_sentences(floor) if floor else ()
    for sentence in (*told, *(part_survey.model_sentences(model) if model else ())):
        console.print(sentence, markup=False)
    if png is None:
        return
    from deploy.picture import part_picture

    with out_folder.writing(png.parent):
        if floor:
            part_picture.write_map(floor, png)
        elif model:
            part_picture.write_model(model, png)
    console.print(str(png), markup=False)
