"""`acrc fleet`: what makes computers robots, and what is done with them then."""

import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actors.installation.repository import clone
from command_line.collect import collect
from command_line.laptop import pause, resume, stop, watch
from command_line.onboard import onboard
from command_line.options import FleetFile, Json, Modules, answer
from command_line.robot_bundle import bundle

if TYPE_CHECKING:
    from deploy.fleet.fleet_file import Fleet
    from deploy.fleet.keys import FleetKeys


def units(
    fleet: FleetFile,
    robot: Annotated[str, typer.Option(metavar="ID", help="Id of the robot that this computer is.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the files.")] = Path("units"),
    user: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Run the robot as this user.  [default: the clone's owner]"),
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Write a robot's systemd service and udev rules.

    Run it on the robot's own computer with all devices plugged in: the service holds the paths of this clone
    and of the fleet file, the rules hold the serial numbers of the devices. It installs nothing, and prints
    the commands that do.
    """
    from actors.robot.behaviour.foreign import permit_of
    from deploy.fleet import units as unit_files
    from deploy.fleet.fleet_file import load_fleet
    from deploy.fleet.udev import usb_ports

    root = clone("fleet units")
    loaded = load_fleet(fleet)
    chosen = loaded.robot(robot)
    written = unit_files.write(
        loaded,
        chosen,
        out,
        program=root / "acrc",
        user=user or unit_files.everyday_user(root),
        plugged=usb_ports(),
        modules=permit_of(modules).modules,
    )
    service, rules = written.service_file, written.rules_file
    said = (
        f"{service}\n{rules}\n\n"
        "Look at them, then install them, here on the robot's own computer:\n\n"
        f"  sudo install -m 644 {rules} /etc/udev/rules.d/\n"
        f"  sudo install -m 644 {service} /etc/systemd/system/\n"
        "  sudo udevadm control --reload && sudo udevadm trigger --subsystem-match=tty\n"
        "  sudo systemctl daemon-reload\n"
        f"  sudo systemctl enable --now {service.name}\n\n"
        f"Then `journalctl -fu {service.name}` shows what the robot says, and `acrc fleet doctor` what is "
        "wrong."
    )
    answer([said], {"service": service, "rules": rules}, json=json)
    for sentence in written.unnamed:
        sys.stderr.write(f"acrc: {sentence}\n")


def keys(
    fleet: FleetFile,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="New folder for the keys.  [default: as in the fleet file]"),
    ] = None,
    host: Annotated[
        list[str] | None,
        typer.Option(metavar="ID=HOST", help="Name or address of a robot. Repeatable."),
    ] = None,
    days: Annotated[int, typer.Option(metavar="N", help="Days that the keys are valid.")] = 730,
    revoke: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Replace all keys after this robot (or the operator) lost its own. Repeatable.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Make the keys of a fleet.

    They are a certificate authority, and a certificate for each robot and the operator. Only the operator's
    laptop can then watch and stop robots. A robot's certificate is valid for its id, its id with .local, the
    address it listens at, and what --host says.
    """
    from deploy.fleet import keys as fleet_keys
    from deploy.fleet.fleet_file import load_fleet

    loaded = load_fleet(fleet)
    hosts = fleet_keys.hosts_of(host or [], loaded)
    folder, now = (out or loaded.keys).absolute(), datetime.now(UTC)
    if not revoke:
        made = fleet_keys.issue(loaded, folder, hosts, now=now, days=days)
        _answer_keys(loaded, made, [], None, json=json)
        return
    made, aside = fleet_keys.renew(loaded, folder, revoke, hosts, now=now, days=days)
    said = [
        f"What {', '.join(revoke)} had is worth nothing to a machine that has its new folder: copy them all, "
        "the operator's first, and start the robots again.",
        f"The old keys are in {aside}; delete them after that.",
    ]
    _answer_keys(loaded, made, said, aside, json=json)


def doctor(
    fleet: Annotated[
        Path | None, typer.Argument(metavar="FLEET.toml", help="Fleet file: which robots there are.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(metavar="ID", help="Id of the robot that this computer is.")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Find what is wrong with this computer, and say the remedy.

    With a fleet file and a robot it also checks the robot's ports, map and keys. It changes nothing, except
    that it compiles numeric kernels. The exit code is 1 if anything is wrong.
    """
    from actors.robot.behaviour.foreign import permit_of
    from deploy.fleet.doctor import consult

    if not consult(fleet, robot, permit_of(modules), json=json):
        raise typer.Exit(1)


def _answer_keys(
    fleet: "Fleet", made: "FleetKeys", revoked: list[str], aside: Path | None, *, json: bool
) -> None:
    """Say where the keys are, then what was `revoked`, and where the old keys are now: `aside`."""
    told = {"home": made.home, "valid_until": made.valid_until, "machines": made.machines, "old_keys": aside}
    answer([*_keys_told(fleet, made), *revoked], told, json=json)
    for machine in made.machines:
        if machine.listens_unnamed:
            sys.stderr.write(
                f"acrc: {machine.machine} listens at all its addresses, but its certificate holds for "
                f"names only; to reach it by an address, give that: --host {machine.machine}=192.168.1.12\n"
            )


def _keys_told(fleet: "Fleet", made: "FleetKeys") -> Iterator[str]:
    yield (
        f"{made.home}\n  stays with you, and off the robots: whoever has it can make keys of this fleet, "
        "for its key is not encrypted"
    )
    for machine in made.machines:
        if machine.hosts:
            goal = f"{machine.machine}:{fleet.keys_of(machine.machine)}"
            yield f"{machine.folder}\n  to {goal}; holds for {', '.join(machine.hosts)}"
        else:
            yield f"{machine.folder}\n  to the laptop of whoever watches and stops the robots"
    yield f"All hold until {made.valid_until:%Y-%m-%d}."


app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
for _command in (keys, units, bundle, doctor, onboard, watch, stop, pause, resume, collect):
    app.command()(_command)
