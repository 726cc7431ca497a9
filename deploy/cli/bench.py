"""The benchmarks on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from deploy.cli.bench_localisation import localisation
from deploy.repository import REPOSITORY

CORRIDOR = REPOSITORY / "maps" / "corridor.yaml"
app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Map = Annotated[
    Path | None, typer.Option("--map", metavar="YAML", help="Floor plan.  [default: maps/corridor.yaml]")
]
_Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
_Localisation = Annotated[
    str | None, typer.Option(metavar="PRESET", help="As in [localisation] of a scenario.")
]
_Navigation = Annotated[
    str | None, typer.Option("--navigation", metavar="PRESET", help="As in [navigation] of a scenario.")
]


@app.command("map")
def compare_map(
    against: Annotated[Path, typer.Option(metavar="DIR", help="Folder with the other map, one *.yaml.")],
    map_file: _Map = None,
    json: _Json = False,
) -> None:
    """Say how like a map is to another one."""
    from benchmarks.world import map as likeness

    likeness.run(against, map_file or CORRIDOR, json)


@app.command()
def radio_plots(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the figures are written.")],
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder with the figures of ns-3, for its dots.")
    ] = None,
    map_file: _Map = None,
    json: _Json = False,
) -> None:
    """Draw the figures of docs/radio.md."""
    from benchmarks.radio import plots

    plots.run(out, map_file or CORRIDOR, data, json)


@app.command()
def scan(map_file: _Map = None, json: _Json = False) -> None:
    """Measure range scans, beside those of pymunk."""
    from benchmarks.world import scan as scans

    scans.run(map_file or CORRIDOR, json)


@app.command()
def world(map_file: _Map = None, json: _Json = False) -> None:
    """Measure physics with scans, beside Stage and navground."""
    from benchmarks.world import world as worlds

    worlds.run(map_file or CORRIDOR, json)


@app.command()
def steps(
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=1000, help="May be repeated.  [default: 1, 4, 10, 20, 50]"),
    ] = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=1, max=3600, help="Simulated time.")] = 60.0,
    json: _Json = False,
) -> None:
    """Measure whole steps of a swarm, beside a bare ping-pong."""
    from benchmarks.swarm import steps as whole

    whole.run(robots or whole.ROBOTS, seconds, json)


@app.command()
def swarm(
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=500, help="May be repeated.  [default: 4, 10, 20, 50]"),
    ] = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=1, max=3600, help="Simulated time.")] = 60.0,
    repeat: Annotated[int, typer.Option(metavar="N", min=1, max=100, help="Runs whose median counts.")] = 3,
    json: _Json = False,
) -> None:
    """Measure the whole stack with many robots: speed, CPU by part and how it grows, memory."""
    from benchmarks.swarm import full_swarm
    from benchmarks.swarm.task import SwarmTask

    full_swarm.run(SwarmTask(tuple(robots or SwarmTask.robots), seconds, repeat), json)


@app.command()
def seeds(
    scenario: Annotated[
        Path | None,
        typer.Argument(metavar="SCENARIO.toml", help="What to run.  [default: scenarios/corridor.toml]"),
    ] = None,
    robots: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N", min=1, max=500, help="May be repeated.  [default: the scenario's; shipped: 1, 4]"
        ),
    ] = None,
    count: Annotated[int, typer.Option("--seeds", metavar="N", min=1, max=10_000, help="Seeds 1 to N.")] = 10,
    strategy: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="May be repeated.  [default: none]")
    ] = None,
    json: _Json = False,
) -> None:
    """Run a scenario from many seeds, with each strategy, and count places and contacts."""
    from benchmarks.swarm import seeds as by_seed

    by_seed.run(robots or (), count, json, strategies=strategy or by_seed.STRATEGIES, scenario=scenario)


@app.command()
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
    localisation: _Localisation = None,
    preset: _Navigation = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Only write what r1 decides on the first map, cycle by cycle."),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=1, help="Of the run for --log.")] = 1,
    json: _Json = False,
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


@app.command()
def failures(
    scenario: Annotated[
        Path | None, typer.Option(metavar="TOML", help="What to run.  [default: scenarios/chapter.toml]")
    ] = None,
    robots: Annotated[
        list[int] | None, typer.Option(metavar="N", min=1, max=500, help="May be repeated.  [default: 4, 8]")
    ] = None,
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="Seeds 1 to N.")] = 20,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Of each run, s.  [default: the scenario's]")
    ] = None,
    strategy: Annotated[str, typer.Option(metavar="NAME", help="What robots do about it.")] = "none",
    localisation: _Localisation = None,
    preset: _Navigation = None,
    json: _Json = False,
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


@app.command()
def deeco(json: _Json = False) -> None:
    """Measure the component model: memberships, processes, the chapter's robot among peers."""
    from benchmarks.foundations import deeco as model

    model.run(json)


@app.command()
def beeclick(
    size: Annotated[int, typer.Option("--bytes", metavar="N", min=1, help="Of noise and talk.")] = 10_000_000,
    json: _Json = False,
) -> None:
    """Soak the link to a BEE-click board in scrambled bytes, and measure what it carries."""
    from benchmarks.hardware import beeclick as boards

    boards.run(size, json)


@app.command()
def mutations(
    size: Annotated[
        int, typer.Option("--bytes", metavar="N", min=1, help="Damaged bytes for each parser.")
    ] = 10_000_000,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the damage.")] = 1,
    json: _Json = False,
) -> None:
    """Feed every parser of files, messages, frames and serial lines with damaged bytes."""
    from benchmarks.mutations import command

    command.run(size, json, seed)


@app.command()
def kobuki(
    size: Annotated[int, typer.Option("--bytes", metavar="N", min=1, help="Of noise and talk.")] = 10_000_000,
    json: _Json = False,
) -> None:
    """Soak the driver of a Kobuki in scrambled bytes."""
    from benchmarks.hardware import kobuki as bases

    bases.run(size, json)


@app.command()
def onboard(json: _Json = False) -> None:
    """Run three robots as on board, in wall time, without any network between them."""
    from benchmarks.hardware import onboard as robots

    robots.run(json)


@app.command()
def standstill(
    trials: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Of each case.")] = 3,
    json: _Json = False,
) -> None:
    """Kill, stop and hold each process of a robot in the loop while it drives: when it stands, and where."""
    from benchmarks.hardware import standstill as cases

    cases.run(json, cases.StandstillTask(trials))


app.command("localisation")(localisation)


@app.command()
def radio_truth(
    data: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder with the rows of ns-3, one CSV per family.")
    ],
    times: Annotated[int, typer.Option(metavar="N", min=1, help="Own frames per frame of the rows.")] = 10,
    json: _Json = False,
) -> None:
    """Compare the radio's medium with figures of ns-3, point by point."""
    from benchmarks.radio import truth

    truth.run(data, json, truth.TruthTask(times=times))


@app.command()
def radio_speed(
    ns3: Annotated[
        Path | None,
        typer.Option(metavar="PYTHON", help="Interpreter of an environment with the package ns3."),
    ] = None,
    json: _Json = False,
) -> None:
    """Measure frames on the air per CPU second, beside ns-3."""
    from benchmarks.radio import speed

    speed.run(ns3, json)


@app.command()
def radio_hardware(json: _Json = False) -> None:
    """Measure what the BEE-click firmware's clear channel assessment costs."""
    from benchmarks.radio import hardware

    hardware.run(json)


@app.command()
def portable(
    arguments: Annotated[
        int, typer.Option(metavar="N", min=1, max=1_000_000, help="Of each kind, for the largest error.")
    ] = 5000,
    json: _Json = False,
) -> None:
    """Measure the portable functions: error against exact values, time beside the C library's."""
    from benchmarks.foundations import portable as functions

    functions.run(arguments, json)


@app.command()
def processors(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Of the chapter's run.")
    ] = 600.0,
    crowd: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Of the house test's run.")
    ] = 50.0,
    install: Annotated[
        bool, typer.Option("--install", help="Let apt-get install qemu and debootstrap if they are missing.")
    ] = False,
    folder: Annotated[
        Path, typer.Option(metavar="DIR", help="Where what is built is kept.", show_default=False)
    ] = REPOSITORY / ".processors",
    only: Annotated[
        list[str] | None, typer.Option(metavar="WORD", help="Only what is so called. May be repeated.")
    ] = None,
    json: _Json = False,
) -> None:
    """Compare the digests of two runs over processors, their features and Pythons; aarch64 in an emulator."""
    from benchmarks.processors import table

    raise typer.Exit(table.run(seconds, crowd, install, folder.absolute(), json, only or ()))


@app.command()
def endings(
    count: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="Runs.")] = 200,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="From which all that is done follows.")] = 1,
    longest_stop: Annotated[
        float, typer.Option(metavar="S", min=5, max=3600, help="Processes are stopped for 5 s to so long.")
    ] = 60.0,
    workers: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Runs at a time.")] = 4,
    json: _Json = False,
) -> None:
    """Kill, stop and signal runs at random instants; say what was not named, was left, or cannot be read."""
    from benchmarks.swarm import endings as trials
    from benchmarks.swarm.endings_trial import EndingsTask

    task = EndingsTask(count, seed, longest_stop=longest_stop)
    if not trials.run(task, workers, json):
        raise typer.Exit(1)


@app.command("crowded-start")
def crowded_start(
    robots: Annotated[int, typer.Option(metavar="N", min=1, max=500)] = 100,
    hogs: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Busy processes per core.")] = 4,
    json: _Json = False,
) -> None:
    """Start many robots beside processes that keep every core busy, and compare with the run alone."""
    from benchmarks.swarm import crowded_start as trials

    if not trials.run(trials.CrowdedStartTask(robots, hogs_per_core=hogs), json):
        raise typer.Exit(1)


@app.command()
def attacks(json: _Json = False) -> None:
    """Try every known way between robots past the radio, and say what held and what got through."""
    from benchmarks.attacks import command

    command.run(json)
