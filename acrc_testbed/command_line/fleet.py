"""`acrc fleet`: real robots; `acrc cluster`: computers that run simulations together."""

import contextlib
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from acrc_testbed.command_line.options import (
    Endpoints,
    FleetFile,
    Json,
    Modules,
    OperatorKeys,
    answer,
    argument,
    isolation,
    option,
)
from actors.console import screen
from actors.installation.repository import clone
from actors.processes.signals import Interrupted
from actors.runtime.errors import AcrcError

if TYPE_CHECKING:
    from actors.orders import Order
    from deploy.fleet.fleet_file import Fleet
    from deploy.fleet.keys import FleetKeys


def collect(
    folders: Annotated[
        list[Path], argument("FOLDER…", "A robot's folder, such as runs/mine/r2, or a folder of these.")
    ],
    out: Annotated[
        Path | None, option("DIR", "New folder for run.json and places.csv.  [default: print only]")
    ] = None,
    truth: Annotated[
        Path | None, option("FILE", "Ground truth, by the laboratory of emulated devices.")
    ] = None,
    json: Json = False,
) -> None:
    """Collect recordings of a field trial and align their clocks."""
    from acrc_testbed.results.summary import print_result
    from deploy.fleet import collect as recordings

    print_result(recordings.collect(folders, out, truth), json=json)


def watch(
    endpoints: Endpoints,
    keys: OperatorKeys,
    view: Annotated[
        Path | None, option("FLEET.toml", "Show robots in the viewer, on the fleet's map.")
    ] = None,
) -> None:
    """Watch robots from a laptop, until Ctrl-C."""
    from deploy.fleet import operator_station

    with contextlib.suppress(Interrupted):
        if view is None:
            operator_station.watch(endpoints, keys)
        else:
            _show(endpoints, keys, view)
    _leave(130)


def _show(endpoints: list[str], keys: Path, fleet: Path) -> None:
    """Show robots in the viewer."""
    from deploy.fleet import fleet_view
    from deploy.fleet.fleet_file import load_fleet

    fleet_view.show(endpoints, keys, load_fleet(fleet))


def stop(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Stop all robots for good.

    Within 2 s each robot has confirmed, or is named with what is in the way; then the exit code is 1.
    """
    from actors.orders import Stop

    _give(endpoints, keys, Stop(), json=json)


def pause(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Pause all robots until resume; answers as of stop."""
    from actors.orders import Pause

    _give(endpoints, keys, Pause(), json=json)


def resume(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Resume paused robots; answers as of stop."""
    from actors.orders import Resume

    _give(endpoints, keys, Resume(), json=json)


def _give(endpoints: list[str], keys: Path, order: "Order", *, json: bool) -> NoReturn:
    """Give an order to all robots, and say what became of it."""
    from deploy.fleet import operator_station

    answers = operator_station.send_order(endpoints, keys, order)
    for one in answers:
        if one.failure:
            print(f"acrc: {one.endpoint}: {one.failure}", file=sys.stderr)
    said = [
        f"acrc: {one.endpoint}: {operator_station.state_after(order)}" for one in answers if not one.failure
    ]
    answer(said, [{"endpoint": one.endpoint, "failure": one.failure} for one in answers], json=json)
    _leave(1 if any(one.failure for one in answers) else 0)


def _leave(code: int) -> NoReturn:
    """End at once: attempts that hang in the network keep their interpreter, and are not waited for."""
    sys.stdout.flush()
    os._exit(code)


def onboard(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Id of the robot that this computer is.")],
    out: Annotated[Path | None, option("DIR", "New folder for the recordings.  [default: in runs/]")] = None,
    isolate: Annotated[
        bool | None, isolation("Run the robot's process in a sandbox that leaves it base and bridge only.")
    ] = None,
    debugpy: Annotated[
        int | None,
        option("PORT", "Let an editor attach to the robot's process at 127.0.0.1:PORT.", min=1, max=65535),
    ] = None,
    at: Annotated[
        str | None,
        option(
            "WHERE",
            "Where the robot stands: `start` (as in the fleet file), or X,Y,HEADING in m and rad.  "
            "[default: near its last pose, which it verifies; `start` the first time]",
        ),
    ] = None,
    modules: Modules = None,
) -> None:
    """Be a robot: drive the plugged-in TurtleBot and radio board."""
    from actors.processes.kernels import compile_kernels
    from actors.robot.behaviour.code_permit import permit_of
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


def bundle(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Id of the robot that the bundle is for.")],
    machine: Annotated[str, option("NAME", "Processor of its computer: x86-64 or aarch64.")] = "x86-64",
    python: Annotated[str, option("3.N", "Python of its computer, from 3.11 to 3.14.")] = "3.11",
    out: Annotated[Path | None, option("FILE", "New archive.  [default: acrc-ID.tar]")] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Pack all that a robot needs, for a computer without a network.

    The archive holds wheels, program, map, fleet file and the robot's keys. Only you can read it. Faults of
    fleet file, map and keys that `acrc fleet doctor` would report are refused.
    """
    from actors.robot.behaviour.code_permit import permit_of
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


def units(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Id of the robot that this computer is.")],
    out: Annotated[Path, option("DIR", "Folder for the files.")] = Path("units"),
    user: Annotated[
        str | None, option("NAME", "Run the robot as this user.  [default: the clone's owner]")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Write a robot's systemd service and udev rules.

    Run it on the robot's own computer with all devices plugged in: the service holds the paths of this clone
    and of the fleet file, the rules hold the serial numbers of the devices. It installs nothing, and prints
    the commands that do.
    """
    from actors.robot.behaviour.code_permit import permit_of
    from deploy.fleet import units as unit_files
    from deploy.fleet.fleet_file import load_fleet
    from deploy.fleet.units import usb_ports

    root = clone("fleet units")
    loaded = load_fleet(fleet)
    chosen = loaded.robot_named(robot)
    written = unit_files.write_units(
        loaded,
        chosen,
        out,
        program=root / "acrc",
        user=user or unit_files.default_user(root),
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
    for sentence in written.unassigned:
        sys.stderr.write(f"acrc: {sentence}\n")


def keys(
    fleet: FleetFile,
    out: Annotated[
        Path | None, option("DIR", "New folder for the keys.  [default: as in the fleet file]")
    ] = None,
    host: Annotated[list[str] | None, option("ID=HOST", "Name or address of a robot. Repeatable.")] = None,
    days: Annotated[int, option("N", "Days that the keys are valid.")] = 730,
    revoke: Annotated[
        list[str] | None,
        option("ID", "Replace all keys after this robot (or the operator) lost its own. Repeatable."),
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
    hosts = fleet_keys.parse_hosts(host or [], loaded)
    folder, now = (out or Path(loaded.keys)).absolute(), datetime.now(UTC)
    if not revoke:
        made = fleet_keys.create_keys(loaded, folder, hosts, now=now, days=days)
        _answer_keys(loaded, made, [], None, json=json)
        return
    made, aside = fleet_keys.replace_keys(loaded, folder, revoke, hosts, now=now, days=days)
    said = [
        f"Machines with their new folders reject the old keys of {', '.join(revoke)}: copy all folders, "
        "the operator's first, and start the robots again.",
        f"The old keys are in {aside}; delete them after that.",
    ]
    _answer_keys(loaded, made, said, aside, json=json)


def doctor(
    fleet: Annotated[Path | None, argument("FLEET.toml", "Fleet file: which robots there are.")] = None,
    robot: Annotated[str | None, option("ID", "Id of the robot that this computer is.")] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Find what is wrong with this computer, and say the remedy.

    With a fleet file and a robot it also checks the robot's ports, map and keys. It changes nothing, except
    that it compiles numeric kernels. The exit code is 1 if anything is wrong.
    """
    from actors.robot.behaviour.code_permit import permit_of
    from deploy.fleet.doctor import check_computer

    if not check_computer(fleet, robot, permit_of(modules), json=json):
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
        f"{made.home}\n  stays with you, and off the robots: it can make keys of this fleet, "
        "for its key is not encrypted"
    )
    for machine in made.machines:
        if machine.hosts:
            goal = f"{machine.machine}:{fleet.keys_of(machine.machine)}"
            yield f"{machine.folder}\n  to {goal}; holds for {', '.join(machine.hosts)}"
        else:
            yield f"{machine.folder}\n  to the laptop that watches and stops the robots"
    yield f"All hold until {made.valid_until:%Y-%m-%d}."


app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
for _command in (keys, units, bundle, doctor, onboard, watch, stop, pause, resume, collect):
    app.command()(_command)


cluster = typer.Typer(
    help="Start a cluster, add this computer to one, fetch what it has kept.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Address = Annotated[
    str, argument("ADDRESS", "Scheduler address: tls://HOST:PORT, or tcp://127.0.0.1:PORT on this computer.")
]


@cluster.command()
def start(address: Address) -> None:
    """Start a cluster's scheduler here, until Ctrl-C.

    It listens at the address, by which others reach this computer.
    """
    from deploy.hosts.address import host_and_port, plain

    place = plain(address, "ADDRESS")
    host, port = host_and_port(place)
    protocol = place.partition("://")[0]
    _become("dask_scheduler", "--protocol", protocol, "--host", host, "--port", str(port))


@cluster.command()
def join(
    address: Address,
    workers: Annotated[
        int | None, option("N", "Number of workers.  [default: one per core]", min=1, max=1024)
    ] = None,
) -> None:
    """Let a cluster use this computer, until Ctrl-C.

    The first time it installs and compiles what that needs.
    """
    from actors.processes.kernels import compile_kernels
    from deploy.hosts.address import plain
    from deploy.hosts.connection import PATIENCE_S, security

    place = plain(address, "ADDRESS")
    if place.startswith("tls://"):
        security(place, PATIENCE_S, "ADDRESS")  # what is wrong with the certificates is said in a sentence
    compile_kernels()
    local = ("--host", "127.0.0.1") if place.startswith("tcp://") else ()
    number = workers or len(os.sched_getaffinity(0))
    _become("dask_worker", place, *local, "--nworkers", str(number), "--nthreads", "1")


@cluster.command()
def fetch(
    out: Annotated[Path, argument("OUT", "Folder of a run over several computers.")],
    on: Annotated[str | None, option("ADDRESS", "Scheduler address.  [default: the run's scheduler]")] = None,
    json: Json = False,
) -> None:
    """Bring what a run has left on other computers, and remove it there."""
    from acrc_testbed.recordings.topics import is_running
    from deploy.hosts.address import plain
    from deploy.hosts.files import fetch

    address = plain(on) if on else ""
    if not (out / "run.json").is_file() and is_running(out):
        raise AcrcError(f"{out}: the run is going on; must have ended")
    fetched = fetch(out, address, _say)
    what = "1 file has come" if fetched.files == 1 else f"{fetched.files} files have come"
    answer([f"{what}, {fetched.bytes} B"], asdict(fetched), json=json)


def _say(sentence: str) -> None:
    sys.stderr.write(f"acrc: {sentence}\n")


def _become(program: str, *words: str) -> NoReturn:
    command = [sys.executable, "-P", "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, command)
