"""Commands `acrc fleet` for real robots and `acrc cluster` for simulations on several computers."""

import contextlib
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from acrc_testbed.command_line.shared_options import (
    Endpoints,
    FleetFile,
    Json,
    Modules,
    OperatorKeys,
    Ros2,
    Router,
    answer,
    argument,
    command_group,
    isolation,
    option,
    permission,
)
from actors.console import create_console
from actors.installation.repository import clone
from actors.orders import Order, Pause, Resume, Stop
from actors.processes.signals import Interruption
from actors.runtime.errors import AcrcError
from deploy.hosts.address import dask_address, host_and_port

if TYPE_CHECKING:
    from deploy.fleet.fleet_file import Fleet
    from deploy.fleet.keys import FleetKeys


def collect(
    folders: Annotated[
        list[Path], argument("FOLDER…", "Folder of a robot, such as runs/mine/r2, or a folder of these.")
    ],
    out: Annotated[
        Path | None,
        option("DIR", "Write run.json and the table of items to this new folder.  [default: print only]"),
    ] = None,
    truth: Annotated[
        Path | None, option("FILE", "Read ground truth from this file of the device emulation.")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Collect recordings of a field trial and align their clocks."""
    from acrc_testbed.results.summary import print_result
    from deploy.fleet import collect as recordings

    permission(modules)
    print_result(recordings.collect(folders, out, truth), json=json)


def watch(
    endpoints: Endpoints,
    keys: OperatorKeys,
    view: Annotated[
        Path | None, option("FLEET.toml", "Show robots in the viewer, on the fleet's map.")
    ] = None,
    modules: Modules = None,
) -> None:
    """Watch robots from a laptop until Ctrl-C."""
    from deploy.fleet import operator_station

    permission(modules)
    with contextlib.suppress(Interruption):
        if view is None:
            operator_station.watch(endpoints, keys)
        else:
            _show_robots(endpoints, keys, view)
    _exit_now(130)


def _show_robots(endpoints: list[str], keys: Path, fleet: Path) -> None:
    """Show robots in the viewer."""
    from deploy.fleet import fleet_view

    fleet_view.show(endpoints, keys, _load(fleet))


def _load(fleet: Path) -> "Fleet":
    from deploy.fleet.fleet_file import load_fleet

    return load_fleet(fleet)


def stop(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Stop all robots for good.

    Each robot confirms within 2 s; otherwise an error names it and the exit code is 1.
    """
    _send_order(endpoints, keys, Stop(), json=json)


def pause(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Pause all robots until resume; output as for stop."""
    _send_order(endpoints, keys, Pause(), json=json)


def resume(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Resume paused robots; output as for stop."""
    _send_order(endpoints, keys, Resume(), json=json)


def _send_order(endpoints: list[str], keys: Path, order: Order, *, json: bool) -> NoReturn:
    """Send an order to all robots, print each outcome and exit."""
    from deploy.fleet import operator_station

    failures = operator_station.send_order(endpoints, keys, order)
    lines = []
    for endpoint, failure in failures.items():
        if failure:
            _log(f"{endpoint}: {failure}")
        else:
            lines.append(f"acrc: {endpoint}: {operator_station.STATE_AFTER[type(order)]}")
    rows = [{"endpoint": endpoint, "failure": failure} for endpoint, failure in failures.items()]
    answer(lines, rows, json=json)
    _exit_now(int(any(failures.values())))


def _exit_now(code: int) -> NoReturn:
    """Exit without waiting for threads that hang in the network."""
    sys.stdout.flush()
    os._exit(code)


def onboard(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Run as this robot of the fleet.")],
    out: Annotated[
        Path | None, option("DIR", "Write recordings to this new folder.  [default: in runs/]")
    ] = None,
    isolate: Annotated[
        bool | None, isolation("Run the robot's process in a sandbox with access to base and bridge only.")
    ] = None,
    debugpy: Annotated[
        int | None,
        option("PORT", "Let an editor attach to the robot's process at 127.0.0.1:PORT.", min=1, max=65535),
    ] = None,
    at: Annotated[
        str | None,
        option(
            "WHERE",
            "Set the start pose: `start` (as in the fleet file), or X,Y,HEADING in m and rad.  "
            "[default: near the last pose, verified by scans; the first time `start`]",
        ),
    ] = None,
    ros2: Ros2 = False,
    router: Router = None,
    modules: Modules = None,
) -> None:
    """Run a robot: drive the connected TurtleBot and radio board."""
    from actors.processes.kernel_compilation import compile_kernels
    from deploy.fleet import onboard_run
    from deploy.run import out_folder
    from deploy.run.options import RunOptions, check_options

    say = create_console(stderr=True).print
    named = permission(modules).modules
    loaded = _load(fleet)
    folder = out or onboard_run.new_folder(Path("runs"))
    options = RunOptions(folder, speed="1", isolate=isolate, ros2=ros2, router=router or "", modules=named)
    with out_folder.remove_if_empty(folder):
        prepared = onboard_run.prepare(loaded, robot, check_options(options), say, at=at, debug_port=debugpy)
        compile_kernels(onboard=True)  # reports progress: it takes a minute, five on a small board
        onboard_run.run(prepared, say)


def radio(
    fleet: FleetFile,
    out: Annotated[
        Path | None, option("DIR", "Write the recording to this new folder.  [default: in runs/]")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Simulate the radio of robots without boards until Ctrl-C.

    Run it on the computer named by radio.network of the fleet file.
    """
    from deploy.fleet import onboard_run, radio_station
    from deploy.run import out_folder

    permission(modules)
    loaded = _load(fleet)
    if out is not None:
        out_folder.make_folder(out)
    folder = out or onboard_run.new_folder(Path("runs"))
    with out_folder.remove_if_empty(folder):
        outcome = radio_station.run(loaded, folder, create_console(stderr=True).print)
    lines = [f"{name}: {counters}" for name, counters in outcome.items()]
    answer([*lines, f"recording in {folder}"], outcome, json=json)


def bundle(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Make the bundle for this robot.")],
    machine: Annotated[
        str, option("NAME", "Processor of the robot's computer: x86-64 or aarch64.")
    ] = "x86-64",
    python: Annotated[str, option("3.N", "Python of the robot's computer, from 3.11 to 3.14.")] = "3.11",
    out: Annotated[Path | None, option("FILE", "Write this new archive.  [default: acrc-ID.tar]")] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Pack a robot's software and keys, for a computer without a network.

    The archive contains wheels, program, map, fleet file and the robot's keys; only you can read it. Fleet
    file, map and keys are checked as by `acrc fleet doctor`.
    """
    from deploy.fleet import robot_bundle

    root, permit = clone("fleet bundle"), permission(modules)
    archive = robot_bundle.write_bundle(
        root,
        _load(fleet),
        robot,
        permit,
        machine=machine,
        python=python,
        out=out or Path(f"acrc-{robot}.tar"),
    )
    text = (
        f"{archive.file}: {archive.bytes / 1e6:.1f} MB, {archive.files} files, "
        f"for {machine} with Python {python}\n"
        f"SHA-256 {archive.sha256}\n\n"
        "Copy it to the robot's computer, then run in /srv there:\n\n"
        f"  tar -xf {archive.file.name}\n"
        f"  acrc-{robot}/acrc fleet units acrc-{robot}/{archive.fleet} --robot {robot}"
        + (f" --modules acrc-{robot}/modules" if archive.own_code else "")
    )
    answer([text], archive._asdict(), json=json)
    if archive.lacks:
        _log(f"the bundle lacks packages of requirements.txt: {archive.lacks}")


def units(
    fleet: FleetFile,
    robot: Annotated[str, option("ID", "Write the files for this robot.")],
    out: Annotated[Path, option("DIR", "Write the files to this folder.")] = Path("units"),
    user: Annotated[
        str | None, option("NAME", "Run the robot as this user.  [default: the clone's owner]")
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Write a robot's systemd service and udev rules.

    Run it on the robot's own computer with all devices plugged in: the service contains the paths of this
    clone and of the fleet file, the rules contain the serial numbers of the devices. Nothing is installed;
    the installation commands are printed.
    """
    from deploy.fleet import units as unit_files
    from deploy.fleet.units import usb_ports

    root, permit = clone("fleet units"), permission(modules)
    loaded = _load(fleet)
    identity = loaded.robot_named(robot)
    files = unit_files.write_units(
        loaded,
        identity,
        out,
        program=root / "acrc",
        user=user or unit_files.default_user(root),
        plugged=usb_ports(),
        modules=permit.modules,
    )
    service, rules = files.service_file, files.rules_file
    answer(
        [
            f"{service}\n{rules}\n\n"
            "Review them, then install them on this computer:\n\n"
            f"  sudo install -m 644 {rules} /etc/udev/rules.d/\n"
            f"  sudo install -m 644 {service} /etc/systemd/system/\n"
            "  sudo udevadm control --reload && sudo udevadm trigger --subsystem-match=tty\n"
            "  sudo systemctl daemon-reload\n"
            f"  sudo systemctl enable --now {service.name}\n\n"
            f"Then `journalctl -fu {service.name}` shows the robot's log; `acrc fleet doctor` finds faults."
        ],
        {"service": service, "rules": rules},
        json=json,
    )
    for sentence in files.unassigned:
        _log(sentence)


def keys(
    fleet: FleetFile,
    out: Annotated[
        Path | None, option("DIR", "Write the keys to this new folder.  [default: as in the fleet file]")
    ] = None,
    host: Annotated[
        list[str] | None, option("ID=HOST", "Add a name or address of a robot. Repeatable.")
    ] = None,
    days: Annotated[int, option("N", "Make the keys valid for this many days.")] = 730,
    revoke: Annotated[
        list[str] | None,
        option("ID", "Replace all keys after this robot (or the operator) lost its own. Repeatable."),
    ] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Create the keys of a fleet.

    Create a certificate authority, and a certificate for each robot and the operator. Only the operator's
    laptop can then watch and stop robots. A robot's certificate is valid for its id, its id with .local, its
    listening address, and the hosts of --host.
    """
    from deploy.fleet import keys as fleet_keys

    permission(modules)
    loaded = _load(fleet)
    hosts = fleet_keys.parse_hosts(host or [], loaded)
    folder, now = (out or Path(loaded.keys)).absolute(), datetime.now(UTC)
    sentences, old_keys = list[str](), None
    if revoke:
        created, old_keys = fleet_keys.replace_keys(loaded, folder, revoke, hosts, now=now, days=days)
        sentences = [
            f"Machines with their new folders reject the old keys of {', '.join(revoke)}: copy all folders, "
            "the operator's first, and restart the robots.",
            f"The old keys are in {old_keys}; delete them after that.",
        ]
    else:
        created = fleet_keys.create_keys(loaded, folder, hosts, now=now, days=days)
    data = {
        "home": created.home,
        "valid_until": created.valid_until,
        "machines": created.machines,
        "old_keys": old_keys,
    }
    answer([*_key_sentences(loaded, created), *sentences], data, json=json)
    for machine in created.machines:
        if machine.listens_unnamed:
            _log(
                f"{machine.machine} listens at all its addresses, but its certificate is valid for "
                f"names only; to reach it by address, add: --host {machine.machine}=192.168.1.12"
            )


def doctor(
    fleet: Annotated[Path | None, argument("FLEET.toml", "Fleet file, which lists the robots.")] = None,
    robot: Annotated[str | None, option("ID", "Check this computer as this robot.")] = None,
    modules: Modules = None,
    json: Json = False,
) -> None:
    """Diagnose this computer and print remedies.

    With a fleet file and a robot, check also the robot's ports or ROS 2 topics, map and keys. Nothing is
    changed, except that numeric kernels are compiled. The exit code is 1 if a check fails.
    """
    from deploy.fleet.doctor import check_computer

    if not check_computer(fleet, robot, permission(modules), json=json):
        raise typer.Exit(1)


def _key_sentences(fleet: "Fleet", keys: "FleetKeys") -> Iterator[str]:
    yield (
        f"{keys.home}\n  keep it private and off the robots: its unencrypted key can sign keys of this fleet"
    )
    for machine in keys.machines:
        if machine.hosts:
            target = f"{machine.machine}:{fleet.key_folder(machine.machine)}"
            yield f"{machine.folder}\n  copy to {target}; valid for {', '.join(machine.hosts)}"
        else:
            yield f"{machine.folder}\n  copy to the operator's laptop"
    yield f"All are valid until {keys.valid_until:%Y-%m-%d}."


app = command_group(
    "Set up, start, watch and stop real robots.",
    *(keys, units, bundle, doctor, onboard, radio, watch, stop, pause, resume, collect),
)


Address = Annotated[
    str, argument("ADDRESS", "Scheduler address: tls://HOST:PORT, or tcp://127.0.0.1:PORT on this computer.")
]


def start(address: Address) -> None:
    """Run a cluster's scheduler on this computer until Ctrl-C.

    It listens at ADDRESS, which must reach this computer from the others.
    """
    place = dask_address(address, "ADDRESS")
    host, port = host_and_port(place)
    protocol = place.partition("://")[0]
    _exec("dask_scheduler", "--protocol", protocol, "--host", host, "--port", str(port))


def join(
    address: Address,
    workers: Annotated[
        int | None, option("N", "Run this many workers.  [default: one per core]", min=1, max=1024)
    ] = None,
) -> None:
    """Add this computer to a cluster until Ctrl-C.

    The first call installs packages and compiles kernels.
    """
    from actors.processes.kernel_compilation import compile_kernels
    from deploy.hosts.connection import TIMEOUT_S, create_security

    place = dask_address(address, "ADDRESS")
    if place.startswith("tls://"):
        create_security(place, TIMEOUT_S, "ADDRESS")  # reports faults of the certificates
    compile_kernels()
    local = ("--host", "127.0.0.1") if place.startswith("tcp://") else ()
    number = workers or len(os.sched_getaffinity(0))
    _exec("dask_worker", place, *local, "--nworkers", str(number), "--nthreads", "1")


def fetch(
    out: Annotated[Path, argument("OUT", "Folder of a run on a cluster.")],
    on: Annotated[
        str | None, option("ADDRESS", "Connect to this scheduler.  [default: the run's scheduler]")
    ] = None,
    json: Json = False,
) -> None:
    """Fetch a run's recordings from other computers and delete them there."""
    from acrc_testbed.recordings.topics import is_running
    from deploy.hosts.files import fetch

    address = dask_address(on) if on else ""
    if not (out / "run.json").is_file() and is_running(out):
        raise AcrcError(f"{out}: the run is in progress; wait for its end")
    fetched = fetch(out, address, _log)
    files = "1 file" if fetched.files == 1 else f"{fetched.files} files"
    answer([f"fetched {files}, {fetched.bytes} B"], asdict(fetched), json=json)


cluster = command_group(
    "Start a cluster, add this computer to one, fetch its recordings.", start, join, fetch
)


def _log(sentence: str) -> None:
    sys.stderr.write(f"acrc: {sentence}\n")


def _exec(program: str, *arguments: str) -> NoReturn:
    command = [sys.executable, "-P", "-m", f"distributed.cli.{program}", *arguments, "--no-dashboard"]
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, command)
