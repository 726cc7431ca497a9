"""Serial lines and processes on board on the command line."""

from typing import Annotated

import typer

from command_line.options import Json


def beeclick(
    size: Annotated[int, typer.Option("--bytes", metavar="N", min=1, help="Of noise and talk.")] = 10_000_000,
    json: Json = False,
) -> None:
    """Soak the link to a BEE-click board in scrambled bytes, and measure what it carries."""
    from benchmarks.hardware import beeclick as boards

    boards.run(size, json)


def kobuki(
    size: Annotated[int, typer.Option("--bytes", metavar="N", min=1, help="Of noise and talk.")] = 10_000_000,
    json: Json = False,
) -> None:
    """Soak the driver of a Kobuki in scrambled bytes."""
    from benchmarks.hardware import kobuki as bases

    bases.run(size, json)


def onboard(json: Json = False) -> None:
    """Run three robots as on board, in wall time, without any network between them."""
    from benchmarks.hardware import onboard as robots

    robots.run(json)


def standstill(
    trials: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Of each case.")] = 3,
    sensors: Annotated[
        bool, typer.Option("--sensors", help="Let sensors lie instead, in simulated time.")
    ] = False,
    hours: Annotated[
        float,
        typer.Option(metavar="H", min=0, max=1000, help="Of robots without a fault, for --sensors."),
    ] = 2.0,
    json: Json = False,
) -> None:
    """Kill, stop and hold each process of a robot in the loop while it drives: when it stands, and where."""
    if sensors:
        from benchmarks.hardware import sensor_trials as lies

        lies.run(json, lies.SensorTask(trials, hours))
        return
    from benchmarks.hardware import standstill as cases

    cases.run(json, cases.StandstillTask(trials))
