"""Checks of a robot's computer and configuration: packages, clock, disk, ports, map, behaviour, keys."""

import contextlib
import ctypes
import getpass
import grp
import importlib
import os
import pwd
import shutil
import struct
import sys
import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Final

import msgspec
from numba.core.dispatcher import Dispatcher
from rich.text import Text

from actors.console import create_console
from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.installation import version
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.kernels import cache_folder
from actors.robot import assembly
from actors.robot.behaviour.code_permit import INSTALLED, Permit
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import sandbox
from actors.runtime.isolation.credentials import PACKET_KEY_FILE, read_packet_key
from actors.runtime.isolation.tls import load_keys
from actors.task.loading import decode_items, load_task
from actors.user_code import set_folders
from actors.wording import toml_text
from deploy.fleet import units
from deploy.fleet.fleet_file import NETWORK, Fleet, FleetRobot, load_fleet, user_code_folders
from deploy.fleet.operator_station import connection_fault
from deploy.fleet.units import GROUP
from deploy.scenario.resolve import robot_setup
from firmware_bridge.onboard.device_loop import OPENNI
from firmware_bridge.range_sensors.depth import DepthScanner, find_library
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.serial_port import BOARD, KOBUKI, RPLIDAR, PortDevice, SerialPort

_INSTALL_COMMANDS: Final = {
    "base": "acrc",
    "hardware": "acrc fleet units",
    "logs": "acrc fleet doctor FLEET.toml",
}
"""Command with which ./acrc installs each extra."""
_FREE_GB: Final = 2.0
"""Required free disk space, GB; our choice: a robot with a lidar records up to 100 MB per hour."""


class DoctorFinding(msgspec.Struct, frozen=True):
    """Result of one check; `text` is the state, and the remedy of a fault."""

    subject: str
    ok: bool
    text: str


class DoctorReport(msgspec.Struct, frozen=True):
    """The findings of all checks."""

    robot: str | None
    ok: bool
    findings: tuple[DoctorFinding, ...]


def run_check(subject: str, check: Callable[..., str], *arguments: object) -> DoctorFinding:
    """Run a check, which returns the state or raises AcrcError with fault and remedy."""
    try:
        return DoctorFinding(subject, True, check(*arguments))
    except AcrcError as error:
        return DoctorFinding(subject, False, str(error))


def version_of(package: str) -> str | None:
    """Return the version of a Python package; None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def check_packages(
    constraints: str, needed: Container[str], minor: int = sys.version_info.minor
) -> Iterator[DoctorFinding]:
    """Check that the extras in the text of constraints.txt are installed as tested with Python 3.`minor`."""
    for extra, pinned in version.sections(constraints, minor).items():
        if extra != "build":  # present while building only
            yield run_check(f"packages {extra}", _check_extra, pinned, extra, extra in needed)


def _check_extra(pinned: Sequence[version.PinnedPackage], extra: str, needed: bool) -> str:
    found = {pin: version_of(pin.name) for pin in pinned}
    for pin, release in found.items():
        if release not in {None, pin.version}:
            raise AcrcError(
                f"{pin.name} {release} is installed, tested is {pin.version}; remove .venv and run ./acrc, "
                "which recreates it"
            )
    missing = [pin.name for pin, release in found.items() if release is None]
    if missing and needed:
        raise AcrcError(f"{', '.join(missing)} missing; run `./{_INSTALL_COMMANDS[extra]}` to install")
    if missing:
        return "not all installed; not needed here"
    return "1 package, tested version" if len(pinned) == 1 else f"{len(pinned)} packages, tested versions"


_TIMEX: Final = struct.Struct("@Ixxxx lllli")
"""First fields of struct timex, adjtimex(2): modes, offset, frequency, maximum and estimated error,
status."""
_UNSYNCHRONISED: Final = 0x0040
"""STA_UNSYNC of adjtimex(2)."""


def clock_error() -> float | None:
    """Return the kernel's bound on the clock error, s; None if not synchronised or unknown."""
    if sys.platform != "linux":
        return None
    buffer = ctypes.create_string_buffer(512)  # modes 0: read only
    if ctypes.CDLL(None, use_errno=True).adjtimex(buffer) < 0:
        return None
    _, _, _, largest_error_us, _, status = _TIMEX.unpack_from(buffer.raw)
    return None if status & _UNSYNCHRONISED else float(largest_error_us) / 1e6


def now() -> datetime:
    """Return the current time, UTC."""
    return datetime.now(UTC)


def _check_clock() -> str:
    """Check that the clock has been set and is synchronised."""
    time_of_day, error = now(), clock_error()
    if not 2025 <= time_of_day.year < 2100:
        raise AcrcError(
            f'the year is {time_of_day.year}; set the clock with `sudo date --set="2026-01-31 12:00"`, or '
            "connect the computer to a network with NTP"
        )
    if error is None:
        raise AcrcError(
            f"{time_of_day:%Y-%m-%d %H:%M} UTC, not synchronised; connect the computer to a network and run "
            "`sudo timedatectl set-ntp true`"
        )
    return f"{time_of_day:%Y-%m-%d %H:%M} UTC, synchronised, error at most {error * 1000:.0f} ms"


def _check_disk() -> str:
    here = Path.cwd()
    gigabytes = shutil.disk_usage(here).free / 1e9
    free = f"{gigabytes:.1f} GB free at {here}"
    if gigabytes < _FREE_GB:
        raise AcrcError(f"{free}, {_FREE_GB:.1f} GB needed; remove old recordings")
    return free


def _check_namespaces() -> str:
    if fault := sandbox.isolation_fault():
        raise AcrcError(fault)
    return "sandboxing of the robot's process is available"


def compiled_kernels() -> tuple[float, int]:
    """Load or compile all kernels; return the duration, s, and the number of cache misses."""
    started = time.monotonic()
    assembly.kernels()
    seconds = time.monotonic() - started
    found = {
        id(item): sum(item.stats.cache_misses.values())
        for name, module in sys.modules.items()
        if name.startswith("actors.")
        for item in vars(module).values()
        if isinstance(item, Dispatcher)
    }
    return seconds, sum(found.values())


def _check_kernels() -> str:
    (seconds, compiled), cache = compiled_kernels(), cache_folder()
    nearest = next(path for path in (cache, *cache.parents) if path.exists())
    if not os.access(nearest, os.W_OK | os.X_OK):
        user = getpass.getuser()
        raise AcrcError(
            f"compiled kernels cannot be cached: {user} has no write access to {cache}; "
            f"run `sudo chown -R {user} {cache.parent}`"
        )
    if compiled:
        return f"{compiled} compiled in {seconds:.0f} s and cached"
    return f"all compiled, loaded in {seconds:.1f} s"


def _check_group() -> str:
    user = getpass.getuser()
    add = f"run `sudo usermod -aG {GROUP} {user}`, then log in again"
    try:
        entry = grp.getgrnam(GROUP)
    except KeyError:
        entry = None
    if os.geteuid() == 0 or (entry is not None and entry.gr_gid in {os.getegid(), *os.getgroups()}):
        return f"{user} may open ports of the group {GROUP}"
    if entry is None:
        raise AcrcError(f"group {GROUP} does not exist; run `sudo groupadd {GROUP}`, {add}")
    if user in entry.gr_mem or pwd.getpwnam(user).pw_gid == entry.gr_gid:
        raise AcrcError(f"{user} is a member of the group {GROUP} after the next login; log in again")
    raise AcrcError(f"{user} is not in the group {GROUP}; {add}")


COMPUTER_CHECKS: Final = {
    "clock": _check_clock,
    "disk": _check_disk,
    "namespaces": _check_namespaces,
    "kernels": _check_kernels,
    "group": _check_group,
}
"""Checks that need no fleet file; `group` is for robots only."""


def check_devices(robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Check that each device is at its port in the fleet file, and that a depth camera can be used."""
    if isinstance(robot.base, Ros2Base):
        yield from _ros2_findings(robot, robot.base)
    else:
        yield run_check("base", _check_port, robot.base, KOBUKI)
    if robot.radio != NETWORK:
        yield run_check("radio", _check_port, robot.radio, BOARD)
    if robot.range == OPENNI:
        yield run_check("range", _check_camera, robot)
    elif robot.range is not None:
        yield run_check("range", _check_port, robot.range, RPLIDAR)


def _ros2_findings(robot: FleetRobot, base: Ros2Base) -> Iterator[DoctorFinding]:
    """Check what the robot's router shows; not without the packages of the extra `logs`."""
    with contextlib.suppress(ModuleNotFoundError):  # reported as missing packages
        ros2 = importlib.import_module("deploy.fleet.ros2_check")
        yield from ros2.findings(base, load_model(robot.model, robot.sensor), ros2.observe(base))


def _check_camera(robot: FleetRobot) -> str:
    find_library()
    DepthScanner(load_model(robot.model, robot.sensor).sensor)  # checks the model's field of view
    return "OpenNI2 is installed"


def processes_using(path: str) -> list[str]:
    """Return the visible processes that have the port open, such as "python3 (PID 812)"."""
    target, found = Path(path).resolve(), []
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda entry: int(entry.name)):
        with contextlib.suppress(OSError):  # owned by another user, or exited
            if process.name != str(os.getpid()) and any(
                link.readlink() == target for link in (process / "fd").iterdir()
            ):
                found.append(f"{(process / 'comm').read_text().strip()} (PID {process.name})")
    return found


def _check_port(path: str, device: PortDevice) -> str:
    name = device.name
    if not os.access(path, os.F_OK):
        raise AcrcError(f"{path}: {_missing_port(path, device)}")
    usb = units.usb_port(path)
    if usb is not None and device is KOBUKI and not units.is_kobuki(usb):
        raise AcrcError(
            f"{path}: USB device {usb.vendor}:{usb.product} is not a {name}; enter the Kobuki's port in the "
            "fleet file"
        )
    if usb is not None and (others := processes_using(path)):  # an emulator keeps its own port open
        raise AcrcError(
            f"{path}: {others[0]} has the port open, so the {name} cannot be tested; stop it, unless it is "
            "this robot's program"
        )
    SerialPort(path, device).close()
    return f"{path} opens" if usb is None or usb.path == path else f"{path} opens ({usb.path})"


def _missing_port(path: str, device: PortDevice) -> str:
    plugged = [port.path for port in units.usb_ports() if units.matches_chip(device, port)]
    if not plugged:
        return f"no such port, and no {device.name} found; plug it in and switch it on"
    like = f"no such port, but {plugged[0]} looks like the {device.name}; "
    if units.symlink_name(path) is None:
        return like + "enter it in the fleet file"
    return like + "install the udev rules written by `acrc fleet units`, then replug the device"


def check_floor(fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Check that the map loads and that start and items of the task fit it."""
    try:
        grid = load_map(fleet.map)
        radii = {one.id: load_model(one.model, one.sensor).footprint.circumradius for one in fleet.robots}
    except AcrcError as error:
        yield DoctorFinding("map", False, str(error))
        return
    width, height = grid.columns * grid.resolution, grid.rows * grid.resolution
    yield DoctorFinding("map", True, f"{fleet.map}: {width:.1f} m by {height:.1f} m")
    yield run_check("start", _check_start, fleet, robot, grid, radii)
    yield run_check(fleet.table, _check_items, fleet, robot, grid)


def _check_start(fleet: Fleet, robot: FleetRobot, grid: OccupancyGrid, radii: Mapping[str, float]) -> str:
    here = robot.start_point
    check_pose(grid, here, radii[robot.id], robot.id)
    for other in fleet.robots:
        distance, minimum = here.distance_to(other.start_point), radii[robot.id] + radii[other.id]
        if other.id != robot.id and distance < minimum:
            raise AcrcError(
                f"{robot.id} starts {distance:.2f} m from {other.id}, must be at least {minimum:.2f} m"
            )
    return f"({here.x:g}, {here.y:g}) is free; put {robot.id} there before switching it on"


def _check_items(fleet: Fleet, robot: FleetRobot, grid: OccupancyGrid) -> str:
    task = load_task(fleet.task.use)
    for index, item in enumerate(decode_items(task, robot.items)):
        if fault := task.check(item, grid):
            raise AcrcError(f"{task.declaration.item} {index} is {toml_text(item)}, but must {fault}")
    return f"{len(robot.items)} {task.declaration.items} checked"


def check_behaviour(fleet: Fleet, robot: FleetRobot, permit: Permit) -> str:
    """Check that the robot can be created with its strategy; executes the strategy's code once."""
    try:
        set_folders(user_code_folders(fleet, permit))
        with contextlib.redirect_stdout(sys.stderr):  # keep --json output clean
            swarm = fleet.swarm(robot)
            setup = robot_setup(swarm, swarm.world.robots[0])
            assembly.robot(setup, load_model(robot.model, robot.sensor), load_map(fleet.map))
    except AcrcError:
        raise
    except Exception as error:
        raise AcrcError(
            f"strategy {fleet.run.strategy!r} failed with {type(error).__name__}: {error}; fix its code"
        ) from None
    return f"strategy {fleet.run.strategy!r} returns a behaviour"


def read_certificate(path: Path) -> tuple[str, datetime, datetime]:
    """Return the name, start and end of validity of a certificate. Raises ValueError or OSError."""
    try:
        certificates = importlib.import_module("deploy.hosts.certificates")
    except ModuleNotFoundError as error:
        raise ValueError(f"the Python package {error.name} is missing") from None
    own = certificates.load_certificate(path.read_bytes())
    return certificates.common_name(own), own.not_valid_before_utc, own.not_valid_after_utc


def check_keys(fleet: Fleet, robot: FleetRobot) -> str:
    """Check that the robot's keys are its own, private and currently valid."""
    files = load_keys(fleet.key_folder(robot.id))
    try:
        (name, begins, ends), mode = read_certificate(files.certificate), files.private_key.stat().st_mode
    except (OSError, ValueError) as error:
        raise AcrcError(str(error)) from None
    if name != robot.id:
        raise AcrcError(f"{files.certificate} belongs to {name}; install the keys of {robot.id}")
    if mode & 0o077:
        raise AcrcError(
            f"{files.private_key} is readable by other users; run `chmod 600 {files.private_key}`"
        )
    if not begins <= now() <= ends:
        raise AcrcError(
            f"{files.certificate} is valid from {begins:%Y-%m-%d} to {ends:%Y-%m-%d}, today is "
            f"{now():%Y-%m-%d}; set the clock, or create keys with `acrc fleet keys`"
        )
    return f"{files.certificate} is valid until {ends:%Y-%m-%d}"


def check_network_radio(fleet: Fleet, robot: FleetRobot) -> str:
    """Check that the computer with the simulated medium accepts the robot's certificate, and vice versa."""
    endpoint = str(fleet.radio.network)
    fault = connection_fault(endpoint, load_keys(fleet.key_folder(robot.id)), "robot")
    if fault:
        remedy = "correct radio.network, or mend the network between both computers"
        if "refused" in fault:
            remedy = f"run `acrc fleet radio {fleet.path.name}` on that computer"
        elif "certificate" in fault:
            remedy = "set both clocks, and give both computers the folders of one `acrc fleet keys`"
        raise AcrcError(f"{endpoint}: {fault}; {remedy}")
    return f"{endpoint} accepts {robot.id}"


def check_packet_key(fleet: Fleet, robot: FleetRobot) -> str:
    """Check that the key of packets is readable, valid and private."""
    file = fleet.key_folder(robot.id) / PACKET_KEY_FILE
    read_packet_key(file)
    return f"{file} is private"


def check_configuration(fleet: Fleet, robot: FleetRobot, permit: Permit) -> Iterator[DoctorFinding]:
    """Check map, start, items, behaviour, and the keys that the robot needs."""
    yield from check_floor(fleet, robot)
    yield run_check("behaviour", check_behaviour, fleet, robot, permit)
    if robot.needs_keys:
        yield run_check("keys", check_keys, fleet, robot)
    if fleet.radio.authenticated:
        yield run_check("packet key", check_packet_key, fleet, robot)


def run_checks(
    fleet: Fleet | None, robot: FleetRobot | None, permit: Permit = INSTALLED
) -> Iterator[DoctorFinding]:
    """Run all checks, fast ones first."""
    constraints = (SHIPPED / "constraints.txt").read_text("utf-8")
    yield from check_packages(constraints, ("base",) if robot is None else robot.extras)
    for subject, check in COMPUTER_CHECKS.items():
        if robot is not None or check is not _check_group:
            yield run_check(subject, check)
    if fleet is not None and robot is not None:
        yield from check_devices(robot)
        yield from check_configuration(fleet, robot, permit)
        if robot.radio == NETWORK:
            yield run_check("radio", check_network_radio, fleet, robot)


def check_computer(path: Path | None, name: str | None, permit: Permit = INSTALLED, *, json: bool) -> bool:
    """Check this computer, or robot `name` of the fleet file; print findings, return True if all passed.

    Raises OptionError if only one of both is given, and AcrcError for an unusable file.
    """
    if path is None and name is not None:
        raise OptionError(
            f"--robot: {name} needs a fleet file; use acrc fleet doctor fleet.toml --robot {name}"
        )
    fleet = None if path is None else load_fleet(path)
    if fleet is not None and name is None:
        known = ", ".join(robot.id for robot in fleet.robots)
        raise OptionError(f"--robot: missing; give the robot that this computer is: {known}")
    robot = fleet.robot_named(name) if fleet is not None and name is not None else None
    found: list[DoctorFinding] = []
    for one in run_checks(fleet, robot, permit):
        found.append(one)
        if not json:
            line = Text("ok     " if one.ok else "failed ", style="green" if one.ok else "bold red")
            line.append(f"{one.subject:<20} ", style="bold").append(one.text, style="default")
            create_console().print(line)
    failed = sum(not one.ok for one in found)
    if json:
        report = DoctorReport(name, not failed, tuple(found))
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        create_console().print(
            f"{failed} of {len(found)} checks failed" if failed else f"all {len(found)} checks passed"
        )
    return not failed
