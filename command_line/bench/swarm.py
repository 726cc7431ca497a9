"""Whole swarms on the command line: speed, relays, crowded starts and violent ends."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from command_line import completion
from command_line.options import Json


def steps(
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=1000, help="May be repeated.  [default: 1, 4, 10, 20, 50]"),
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds.")] = 60.0,
    json: Json = False,
) -> None:
    """Measure whole steps of a swarm, beside a bare ping-pong."""
    from benchmarks.swarm import steps as whole

    whole.run(robots or whole.ROBOTS, duration, json)


def swarm(
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=500, help="May be repeated.  [default: 4, 20, 50, 100]"),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=1,
            max=3600,
            help="Simulated seconds of each run.  [default: 60, and at most 800 robot-seconds]",
        ),
    ] = None,
    repeat: Annotated[int, typer.Option(metavar="N", min=1, max=100, help="Runs whose median counts.")] = 3,
    timeline: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Only draw some steps of one swarm, for a viewer of Chrome traces."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Measure the whole stack with many robots: speed, CPU by part and how it grows, memory."""
    from benchmarks.swarm import full_swarm
    from benchmarks.swarm.task import SwarmTask
    from benchmarks.swarm.timeline import command as drawn

    if timeline is not None:
        drawn.run(drawn.one(robots), duration or drawn.SECONDS, timeline, json)
        return
    task = SwarmTask(tuple(robots or SwarmTask.robots), repeat=repeat)
    if duration is not None:
        task = replace(task, seconds=duration, robot_seconds=None)
    full_swarm.run(task, json)


def growth(
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=1000, help="May be repeated.  [default: 1, 2, 5, 10 … 200]"),
    ] = None,
    duration: Annotated[
        float, typer.Option(metavar="S", min=2, max=3600, help="Simulated seconds of each run.")
    ] = 10.0,
    json: Json = False,
) -> None:
    """Measure what a robot costs among how many: CPU by part, traffic, memory."""
    from benchmarks.swarm.growth import command

    command.run(robots or command.SIZES, duration, json)


def resume(
    kills: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="At random moments.")] = 10,
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Of two strategies.")] = 10,
    duration: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds of each run.")
    ] = 20.0,
    json: Json = False,
) -> None:
    """Kill a campaign again and again, and compare what is resumed with one that never was."""
    from benchmarks.swarm import resume as killed

    if not killed.run(killed.ResumeTask(kills, seeds, duration), json):
        raise typer.Exit(1)


def recordings(
    robots: Annotated[int, typer.Option(metavar="N", min=1, max=500, help="How many robots.")] = 20,
    duration: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds of the run.")
    ] = 600.0,
    robot: Annotated[str, typer.Option(metavar="ROBOT", help="Which is executed again.")] = "r1",
    json: Json = False,
) -> None:
    """Measure what recording a swarm costs, how large it gets, and how fast one robot is executed again."""
    from benchmarks.recordings import recordings as cost

    if not cost.run(robots, duration, robot, json):
        raise typer.Exit(1)


def relays(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCENARIO.toml",
            help="What to run.  [default: scenarios/chapter.toml]",
            autocompletion=completion.scenarios,
        ),
    ] = None,
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=2, max=500, help="May be repeated.  [default: 4, 10, 20, 50, 100]"),
    ] = None,
    below: Annotated[
        list[float] | None,
        typer.Option(metavar="DBM", min=-90, max=0, help="May be repeated.  [default: -75, -80, -82, -85]"),
    ] = None,
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="So many, each rule.")] = 2,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="The first of them.")] = 1,
    duration: Annotated[float, typer.Option(metavar="S", min=15, max=3600, help="Simulated seconds.")] = 20.0,
    json: Json = False,
) -> None:
    """Compare rules of relaying: what robots send and hear, and how old what they know is."""
    from benchmarks.swarm import relays as rules

    task = rules.RelaysTask(
        scenario or rules.SCENARIO,
        tuple(robots or rules.ROBOTS),
        tuple(below or rules.BELOW_DBM),
        seeds,
        seed,
        duration,
    )
    rules.run(task, json)


def crowded_start(
    robots: Annotated[int, typer.Option(metavar="N", min=1, max=500, help="How many robots.")] = 100,
    hogs: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Busy processes per core.")] = 4,
    json: Json = False,
) -> None:
    """Start many robots beside processes that keep every core busy, and compare with the run alone."""
    from benchmarks.swarm import crowded_start as trials

    if not trials.run(trials.CrowdedStartTask(robots, hogs_per_core=hogs), json):
        raise typer.Exit(1)


def endings(
    runs: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="How many.")] = 200,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="From which all that is done follows.")] = 1,
    longest_stop: Annotated[
        float, typer.Option(metavar="S", min=5, max=3600, help="Processes are stopped for 5 s to so long.")
    ] = 60.0,
    workers: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Runs at a time.")] = 4,
    json: Json = False,
) -> None:
    """Kill, stop and signal runs at random instants; say what was not named, was left, or cannot be read."""
    from benchmarks.swarm import endings as trials
    from benchmarks.swarm.endings_trial import EndingsTask

    task = EndingsTask(runs, seed, longest_stop=longest_stop)
    if not trials.run(task, workers, json):
        raise typer.Exit(1)


def branches(
    forks: Annotated[int, typer.Option(metavar="N", min=1, max=10_000, help="How many unchanged.")] = 20,
    frames: Annotated[int, typer.Option(metavar="N", min=0, max=10_000, help="And without a frame.")] = 20,
    duration: Annotated[
        float, typer.Option(metavar="S", min=2, max=3600, help="Of the run that they leave.")
    ] = 60.0,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the run, and of the instants.")] = 1,
    json: Json = False,
) -> None:
    """Branch a run at random instants, unchanged or without one frame, and see what becomes otherwise."""
    from benchmarks.branches import forks as trials

    if not trials.run(trials.BranchesTask(forks, frames, duration, seed), json):
        raise typer.Exit(1)
