"""Navigation, and the chapter's failures, on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from command_line import completion
from command_line.bench.options import Localisation, Navigation
from command_line.options import Json


def navigation(
    map_file: Annotated[
        list[Path] | None,
        typer.Option("--map", metavar="YAML", help="May be repeated.  [default: all of maps/]"),
    ] = None,
    robots: Annotated[
        list[int] | None, typer.Option(metavar="N", min=1, max=100, help="May be repeated.  [default: 1, 4]")
    ] = None,
    goals: Annotated[
        int,
        typer.Option(metavar="N", min=1, max=100_000, help="Of all robots, per map and number of robots."),
    ] = 200,
    runs: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Over which they spread.")] = 8,
    localisation: Localisation = None,
    preset: Navigation = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Only write what r1 decides on the first map, cycle by cycle."),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the run for --log.")] = 1,
    json: Json = False,
) -> None:
    """Measure how many random goals robots reach, how fast, and how near to walls and each other."""
    from benchmarks.navigation import navigation as driving

    task = driving.NavigationTask(
        tuple(map_file or driving.MAPS), tuple(robots or driving.ROBOTS), goals, runs, localisation, preset
    )
    if log is None:
        driving.run(task, json)
    else:
        driving.write_log(task, log, seed)


def failures(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCENARIO.toml",
            help="What to run.  [default: scenarios/chapter.toml]",
            autocompletion=completion.scenarios,
        ),
    ] = None,
    robots: Annotated[
        list[int] | None, typer.Option(metavar="N", min=1, max=500, help="May be repeated.  [default: 4, 8]")
    ] = None,
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="Seeds 1 to N.")] = 20,
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help="Simulated seconds of each run.  [default: the scenario's]"),
    ] = None,
    strategy: Annotated[
        str,
        typer.Option(metavar="NAME", help="What robots do about it.", autocompletion=completion.strategies),
    ] = "none",
    localisation: Localisation = None,
    preset: Navigation = None,
    json: Json = False,
) -> None:
    """Count the chapter's three failures over many seeds: lost, no valid trajectory, mutual blocking."""
    from benchmarks.failures import failures as chapter

    chapter.run(
        scenario or chapter.SCENARIO,
        robots or chapter.ROBOTS,
        seeds,
        strategy=strategy,
        duration=duration,
        localisation=localisation,
        navigation=preset,
        json_output=json,
    )


def causes(
    count: Annotated[
        int, typer.Argument(metavar="N", min=1, max=10_000, help="Situations with a cause, and without.")
    ] = 200,
    json: Json = False,
) -> None:
    """Plant causes of lost time, and count how often they are named, and how often one is invented."""
    from benchmarks.causes import causes as planted

    planted.run(count, json_output=json)


def wedge(
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="Of each kind of pair.")] = 5,
) -> None:
    """Put pairs head-on and too near, and count how many come apart, with and without backing off."""
    from benchmarks.causes import wedge as pairs

    pairs.run(seeds)
