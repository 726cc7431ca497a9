"""Commands `acrc demo`, `acrc view` and `acrc scenario`, which show runs and scenarios."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from msgspec.structs import replace

from acrc_testbed.command_line import shared_options
from acrc_testbed.command_line.shared_options import (
    Json,
    Modules,
    Robots,
    Seed,
    Setting,
    Trust,
    answer,
    argument,
    flag,
    option,
    permission,
)
from actors.console import create_console
from actors.installation.usage import OptionError, command_line, output_file
from actors.runtime.errors import AcrcError

if TYPE_CHECKING:
    from acrc_testbed.run_model.data import RunData
    from actors.robot_model import RobotModel
    from deploy.scenario.map_survey import MapSurvey

_PAGES: Final = (".png", ".svg", ".html")
_MIN_STATISTICS_S: Final = 5.0
"""Simulated duration from which a run has meaningful statistics, s."""


def demo(
    out: Annotated[
        Path | None, option("DIR", "Write both runs and pictures to this new folder.  [default: in runs/]")
    ] = None,
    json: Json = False,
) -> None:
    """Show two robots in a doorway, without and with adaptation."""
    from acrc_testbed.picture import run_page
    from acrc_testbed.run_model.simulated_runs import read_run
    from deploy.run import out_folder, start
    from deploy.run.options import RunOptions, check_options, run_folder_name

    name = run_folder_name(Path("demo"))
    options = check_options(RunOptions(out or Path("runs", name), json=json))
    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    with start.output_folder(options.out, quiet=json):
        results = start.demonstrate(options)
    runs = [read_run(options.out / strategy) for strategy in results]
    pictures = [options.out / "demo.png", options.out / "demo.svg"]
    with out_folder.convert_write_errors(options.out):
        for picture in pictures:
            run_page.write(runs, picture)
    sentences = start.demonstration_lines(results, len(runs[-1].taken_over), pictures)
    answer(sentences, {"out": options.out, "pictures": pictures, "results": results}, json=json)
    if not json and sys.stdout.isatty() and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        typer.launch(str(pictures[0]))


def view(
    paths: Annotated[
        list[Path] | None,
        argument(
            "OUT|FILE",
            "OUT: folder of a run, or of folders collected from robots.  [default: the newest in runs/]  "
            "FILE: output of --png, --svg or --html, by its suffix, as in --html page.html.",
        ),
    ] = None,
    png: Annotated[
        bool, flag("Draw the run on one page: FILE.png.  [default: OUT/run.png]", "--png")
    ] = False,
    svg: Annotated[bool, flag("Draw it as FILE.svg.  [default: OUT/run.svg]", "--svg")] = False,
    html: Annotated[
        bool, flag("Write a page with text and tables: FILE.html.  [default: OUT/run.html]", "--html")
    ] = False,
    movie: Annotated[
        Path | None, option("FILE", "Write a movie of the robots: a .gif, or an .mp4 (requires ffmpeg).")
    ] = None,
    beside: Annotated[
        list[Path] | None,
        option(
            "DIR",
            "Also show this run, side by side and time-aligned; with --png or --svg on one picture.  "
            "[default: OUT/beside.png] Repeatable.",
        ),
    ] = None,
    speed: Annotated[
        float, option("X", "Show this many simulated seconds per second of --movie.", min=1.0, max=1000.0)
    ] = 20.0,
    save: Annotated[Path | None, option("FILE", "Write the view to a .rrd file; open nothing.")] = None,
    screenshot: Annotated[Path | None, option("FILE", "Write a screenshot to a .png file.")] = None,
    at: Annotated[
        float | None,
        option("S", "Take the screenshot at this simulated time.  [default: middle of the run]", min=0),
    ] = None,
    robot: Annotated[
        list[str] | None,
        option("ID", "Show this robot's perception; repeatable.  [default: the first eight]"),
    ] = None,
    json: Annotated[
        bool, flag("Print the state of the run and the files as JSON; open nothing.", "--json")
    ] = False,
) -> None:
    """Open a run in the viewer, or draw it.

    The viewer shows the floor, each robot's perception, radio, lanes and plots over time. The exit code is 1
    if data are missing, such as the perception of a robot that was recorded lean.

    All data come from recordings; nothing is replayed. With --png, --svg, --html or --movie: draw floor,
    trails, places, meetings, radio and progress.
    """
    folder, files = _folder_and_files(paths or ())
    out = folder or _newest_run()
    name = "beside" if beside else "run"
    for requested, suffix in ((png, ".png"), (svg, ".svg"), (html, ".html")):
        if requested:
            files.setdefault(suffix, out / f"{name}{suffix}")
    if beside and (".html" in files or movie):
        raise OptionError("--beside: cannot be combined with --html or --movie")
    pages = list(files.values())
    folders = (out, *(beside or ()))
    if pages or movie or (json and save is None and screenshot is None):
        drawn = _draw(folders, pages, movie, speed) if pages or movie else []
        _print_files(out, drawn, json=json)
        return
    if save is not None:
        output_file("--save", save, ".rrd")
    if screenshot is not None:
        output_file("--screenshot", screenshot, ".png")
    _show_runs(folders, robot or (), save=save, screenshot=screenshot, at=at)
    if json:
        _print_files(out, [file for file in (save, screenshot) if file is not None], json=True)


def _folder_and_files(paths: Sequence[Path]) -> tuple[Path | None, dict[str, Path]]:
    """Return the run's folder, and the files for its pages by suffix. Raises OptionError."""
    files = {path.suffix: path for path in paths if path.suffix in _PAGES and not path.is_dir()}
    folders = [path for path in paths if path not in files.values()]
    for suffix, file in files.items():
        output_file(f"--{suffix[1:]}", file, suffix)
    if folders[1:]:
        example = command_line("view", folders[0], "--html", "page.html")
        raise OptionError(
            f"view: unexpected argument {folders[1]}; a picture is a .png, .svg or .html file: {example}"
        )
    return next(iter(folders), None), files


def _print_files(out: Path, files: Sequence[Path], *, json: bool) -> None:
    """Print the written files; with `json` also the state of the run."""
    from acrc_testbed.recordings.topics import run_state

    data = {"out": out, "stands": run_state(out).value, "files": files} if json else None
    answer(map(str, files), data, json=json)


def _newest_run() -> Path:
    """Return the newest run and print its name. Raises OptionError if there is none."""
    from deploy.run import out_folder

    found = out_folder.newest_run(Path("runs"))
    if found is None:
        raise OptionError("OUT: missing, and runs/ contains no run; give a run's folder")
    sys.stderr.write(f"acrc: newest run: {found}\n")
    return found


def _show_runs(
    folders: Sequence[Path],
    robots: Sequence[str],
    *,
    save: Path | None,
    screenshot: Path | None,
    at: float | None,
) -> None:
    """Show one run, or several side by side."""
    from acrc_testbed.view import run_view
    from deploy.run import out_folder

    say, complete = create_console(stderr=True).print, True
    with out_folder.convert_write_errors((save or screenshot or folders[0]).absolute().parent):
        if save is not None:
            complete = run_view.save_view(folders, robots, save, say)
        if screenshot is not None:
            complete &= run_view.take_screenshot(folders, robots, screenshot, at, say)
        if save is None and screenshot is None:
            complete = run_view.show_view(folders, robots, say)
    if not complete:
        raise AcrcError(f"{folders[0]}: the view is incomplete, see above")


def _warn_if_incomplete(out: Path, run: "RunData") -> None:
    """Warn if a run is too short for statistics, or some of its recordings are elsewhere."""
    from acrc_testbed.results.seal import fetch_sentence, remote_recordings

    if remote := remote_recordings(out):
        sys.stderr.write(f"acrc: {fetch_sentence(out, remote)}; until then only the ground truth is drawn\n")
    if run.end < _MIN_STATISTICS_S:
        sentence = f"the run lasts {run.end:g} s; statistics require at least {_MIN_STATISTICS_S:g} s"
        sys.stderr.write(f"acrc: {out}: {sentence}\n")


def _draw(folders: Sequence[Path], pages: Sequence[Path], movie: Path | None, speed: float) -> Sequence[Path]:
    """Draw a run, or several side by side, into each page and, if given, into `movie`; return the files."""
    from acrc_testbed import picture

    picture.import_matplotlib()
    from acrc_testbed.picture import run_page
    from acrc_testbed.recordings.topics import partial_run_sentence
    from acrc_testbed.run_model.simulated_runs import read_run
    from deploy.run import out_folder

    if movie is not None:
        from acrc_testbed.picture import run_movie

        run_movie.check(movie)
    runs = [read_run(folder) for folder in folders]
    run, *others = runs
    if run.result is None and not others:
        create_console(stderr=True).print(partial_run_sentence(folders[0], run.end))
    for folder, one in zip(folders, runs, strict=True):
        _warn_if_incomplete(folder, one)
    for page in pages:
        with out_folder.convert_write_errors(page.parent):
            if page.suffix == ".html":  # of a single run
                from acrc_testbed.picture import run_html

                run_html.write(run, page)
            else:
                run_page.write(runs, page)
    if movie is None:
        return pages
    with out_folder.convert_write_errors(movie.parent):
        run_movie.write(run, movie, speed)
    return [*pages, movie]


def scenario(
    file: Annotated[
        Path, argument("FILE", "Scenario, map or robot model.", autocompletion=shared_options.scenarios)
    ],
    robots: Robots = None,
    seed: Seed = None,
    setting: Setting = None,
    png: Annotated[
        Path | None, option("FILE", "Draw floor, doors, starts, places and radio range to this file.")
    ] = None,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Check a scenario, a map or a robot model.

    Prints a summary of the file. Options override the scenario. The strategy is created once, as for a run,
    to check its module and its settings.
    """
    from actors.floor import offices

    if png is not None:
        output_file("--png", png, ".png", ".svg")
    if file.suffix.lower() in {".yaml", ".yml"} or offices.is_name(file):
        from deploy.scenario.map_survey import survey_map

        _check_no_changes(file, robots, seed, setting)
        _print_survey(survey_map(file), png, json=json)
        return
    from actors.robot.behaviour.code_permit import permitted_folders
    from deploy.scenario.scenario_file import (
        Overrides,
        is_model,
        load_scenario,
        module_folders,
        parse_settings,
    )

    if is_model(file):
        from actors.robot_model import load_model

        _check_no_changes(file, robots, seed, setting)
        _print_survey(load_model(str(file)), png, json=json)
        return
    from deploy.run.dry_run import preflight_in_process
    from deploy.scenario.resolve import resolve
    from deploy.scenario.survey import survey

    permit = permission(modules, trust=trust)
    overrides = Overrides(robots, seed, settings=parse_settings(setting or ()))
    resolved = resolve(load_scenario(file, overrides))
    _print_survey(survey(resolved), png, json=json)
    folders = permitted_folders(file, resolved.behaviour, module_folders(resolved.scenario), permit)
    preflight_in_process(resolved, folders)


def _check_no_changes(file: Path, *changes: object) -> None:
    """Raise OptionError if an option would change a file that is not a scenario."""
    if any(change not in (None, []) for change in changes):
        raise OptionError(f"{file}: not a scenario; cannot be combined with --robots, --seed and --set")


def _print_survey(found: "MapSurvey | RobotModel", png: Path | None, *, json: bool) -> None:
    """Print the summary of a file and, with `png`, draw it."""
    from deploy.scenario.map_survey import json_content, sentences

    if png is not None:
        from deploy.run import out_folder
        from deploy.scenario import scenario_picture

        with out_folder.convert_write_errors(png.parent):
            scenario_picture.write(found, png)
    drawn = [] if png is None else [str(png)]
    answer([*sentences(found), *drawn], json_content(found) | {"picture": png}, json=json)
