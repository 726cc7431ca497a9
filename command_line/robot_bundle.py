"""`acrc fleet bundle`: a robot for a computer without a network."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from actors.installation.repository import clone
from command_line.options import FleetFile, Json, Modules, answer


def bundle(
    fleet: FleetFile,
    robot: Annotated[str, typer.Option(metavar="ID", help="Id of the robot that the bundle is for.")],
    machine: Annotated[
        str, typer.Option(metavar="NAME", help="Processor of its computer: x86-64 or aarch64.")
    ] = "x86-64",
    python: Annotated[
        str, typer.Option(metavar="3.N", help="Python of its computer, from 3.11 to 3.14.")
    ] = "3.11",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="New archive.  [default: acrc-ID.tar]")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Pack all that a robot needs, for a computer without a network.

    The archive holds wheels, program, map, fleet file and the robot's keys. Only you can read it. Faults of
    fleet file, map and keys that `acrc fleet doctor` would report are refused.
    """
    from actors.robot.behaviour.foreign import permit_of
    from deploy.fleet import bundle as robot_bundle
    from deploy.fleet.fleet_file import load_fleet

    root = clone("fleet bundle")
    made = robot_bundle.make(
        root,
        load_fleet(fleet),
        robot,
        permit_of(modules),
        machine=machine,
        python=python,
        out=out or Path(f"acrc-{robot}.tar"),
    )
    said = (
        f"{made.file}: {made.bytes / 1e6:.1f} MB, {made.files} files, for {machine} with Python {python}\n"
        f"SHA-256 {made.sha256}\n\n"
        "Copy it onto the robot's computer, then in /srv there:\n\n"
        f"  tar -xf {made.file.name}\n"
        f"  acrc-{robot}/acrc fleet units acrc-{robot}/{made.fleet} --robot {robot}"
        + (f" --modules acrc-{robot}/modules" if made.own_code else "")
    )
    answer([said], made._asdict(), json=json)
    if made.lacks:
        sys.stderr.write(f"acrc: the bundle lacks what requirements.txt names: {made.lacks}\n")
