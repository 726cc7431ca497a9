"""`acrc fleet onboard`: this computer is a robot's."""

from pathlib import Path
from typing import Annotated

import typer

from actors.console import screen
from command_line.options import FleetFile, Modules


def onboard(
    fleet: FleetFile,
    robot: Annotated[str, typer.Option(metavar="ID", help="Id of the robot that this computer is.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="New folder for the recordings.  [default: in runs/]")
    ] = None,
    isolate: Annotated[
        bool | None,
        typer.Option(
            "--isolate/--no-isolate",
            help="Run the robot's process in a sandbox that leaves it base and bridge only.  "
            "[default: where the machine can]",
        ),
    ] = None,
    debugpy: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            min=1,
            max=65535,
            help="Let an editor attach to the robot's process at 127.0.0.1:PORT.",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Where the robot stands: `start` (as in the fleet file), or X,Y,HEADING in m and rad.  "
            "[default: near its last pose, which it verifies; `start` the first time]",
        ),
    ] = None,
    modules: Modules = None,
) -> None:
    """Be a robot: drive the plugged-in TurtleBot and radio board."""
    from actors.processes.kernels import compile_kernels
    from actors.robot.behaviour.foreign import permit_of
    from deploy.fleet import onboard_run
    from deploy.fleet.fleet_file import load_fleet
    from deploy.run import out_folder

    console = screen(stderr=True)
    loaded = load_fleet(fleet)
    named = permit_of(modules).modules
    folder = out_folder.checked(out, mesh=True) if out else onboard_run.new_folder(Path("runs"))
    options = onboard_run.OnboardOptions(folder, isolate, debugpy, at, named)
    with out_folder.dropped_if_empty(folder):
        prepared = onboard_run.prepare(loaded, robot, options, console.print)
        compile_kernels(onboard=True)  # else it would seem to hang for a minute, or five on a small board
        onboard_run.run(prepared, console.print)
