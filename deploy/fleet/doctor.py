"""Checks of a robot's computer: packages, clock, disk, ports, and of its map, behaviour and keys."""

import contextlib
import ctypes
import getpass
import grp
import importlib
import os
import pwd
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from numba.core.dispatcher import Dispatcher
from rich.text import Text

from actors.console import screen
from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.geometry import Point
from actors.installation import version
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.kernels import cache_folder
from actors.robot import assembly
from actors.robot.behaviour.foreign import INSTALLED, Permit
from actors.robot.behaviour.modules import look_in
from actors.robot_model import load_model
from actors.runtime.access.tls import load_keys
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import sandbox
from deploy.fleet import units
from deploy.fleet.fleet_file import Fleet, FleetRobot, load_fleet, own_code
from deploy.fleet.units import GROUP, UsbPort
from deploy.scenario.resolve import robot_setup
from firmware_bridge.onboard.onboard_setup import OPENNI
from firmware_bridge.range_sensors.depth import CameraError, DepthScanner, find_library
from firmware_bridge.serial_port import BOARD, KOBUKI, RPLIDAR, PortDevice, PortError, SerialPort

_BRINGS: Final = {"base": "acrc", "hardware": "acrc fleet units"}
"""The command for which ./acrc installs what a robot needs."""
_YEARS: Final = range(2025, 2100)
"""A clock that shows an earlier year, before that of this software, was never set."""
_FREE_GB: Final = 2.0
"""Free space that the disk needs. Own choice; a robot with a lidar records up to 100 MB an hour."""


class DoctorFinding(msgspec.Struct, frozen=True):
    """The result of one check: the state, and if it is wrong the remedy, in one sentence."""

    subject: str
    ok: bool
    text: str


class Report(msgspec.Struct, frozen=True):
    """The findings of all checks."""

    robot: str | None
    ok: bool
    findings: tuple[DoctorFinding, ...]


class GroupMembership(NamedTuple):
    """Whether a group exists, the user is in it, and was when he logged in (always so for root)."""

    exists: bool
    listed: bool
    in_force: bool


class Certified(NamedTuple):
    """The name in a certificate and its period of validity."""

    name: str
    begins: datetime
    ends: datetime


class Kernels(NamedTuple):
    """State of the compiled numeric kernels."""

    cache: Path
    """Folder for the compiled ones."""
    can_be_kept: bool
    """True if this user can write there."""
    seconds: float
    """How long it took to load or compile all."""
    compiled: int
    """How many were not compiled before."""


class _Timex(ctypes.Structure):
    """The head of struct timex, and room for the rest (adjtimex(2))."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset_and_frequency", ctypes.c_long * 2),
        ("largest_error_us", ctypes.c_long),
        ("estimated_error_us", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


_UNSYNCHRONISED: Final = 0x0040
"""STA_UNSYNC of adjtimex(2)."""


class Machine:
    """The computer that this runs on; tests replace it."""

    def __init__(self) -> None:
        self.user = getpass.getuser()
        self.here = Path.cwd()
        """Folder of recordings."""
        self.python = sys.version_info[:2]

    def exists(self, path: str) -> bool:
        """Return whether the path exists."""
        return os.path.exists(path)  # noqa: PTH110 - Path.exists raises where access is denied

    def usb_port(self, path: str) -> UsbPort | None:
        """Return the USB device behind a port's name, if there is one."""
        return units.usb_port(path)

    def usb_ports(self) -> list[UsbPort]:
        """Return all USB serial ports."""
        return units.usb_ports()

    def holders(self, path: str) -> list[str]:
        """Return the processes that have the port open, as far as visible, such as "python3 (PID 812)"."""
        wanted, found = Path(path).resolve(), []
        for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda entry: int(entry.name)):
            with contextlib.suppress(OSError):  # another user's, or ended meanwhile
                if process.name != str(os.getpid()) and any(
                    link.readlink() == wanted for link in (process / "fd").iterdir()
                ):
                    found.append(f"{(process / 'comm').read_text().strip()} (PID {process.name})")
        return found

    def port_fault(self, path: str, device: PortDevice) -> str | None:
        """Return why the port cannot be opened; None if it can."""
        try:
            SerialPort(path, device).close()
        except PortError as error:
            return str(error)
        return None

    def camera_fault(self) -> str | None:
        """Return why no depth camera can be used; None if the library for it is there."""
        try:
            find_library()
        except CameraError as error:
            return str(error)
        return None

    def membership(self, group: str) -> GroupMembership:
        """Return whether this user has the rights of a group."""
        root = os.geteuid() == 0
        try:
            entry = grp.getgrnam(group)
        except KeyError:
            return GroupMembership(exists=False, listed=False, in_force=root)
        listed = self.user in entry.gr_mem or pwd.getpwnam(self.user).pw_gid == entry.gr_gid
        in_force = root or entry.gr_gid in {os.getegid(), *os.getgroups()}
        return GroupMembership(exists=True, listed=listed, in_force=in_force)

    def now(self) -> datetime:
        """Return the time of the clock."""
        return datetime.now(UTC)

    def clock_error(self) -> float | None:
        """Return the kernel's bound of the clock's error, s; None if it is not synchronised, or unknown."""
        if sys.platform != "linux":
            return None
        answer = _Timex()  # modes 0: read only
        if ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(answer)) < 0:
            return None
        return None if answer.status & _UNSYNCHRONISED else float(answer.largest_error_us) / 1e6

    def free_bytes(self) -> int:
        """Return the free space of the disk with `here`."""
        return shutil.disk_usage(self.here).free

    def version_of(self, package: str) -> str | None:
        """Return the version of a Python package; None if it is not installed."""
        try:
            return metadata.version(package)
        except metadata.PackageNotFoundError:
            return None

    def mode(self, path: Path) -> int:
        """Return the permission bits of a file. Raises OSError."""
        return stat.S_IMODE(path.stat().st_mode)

    def certificate(self, path: Path) -> Certified:
        """Read a certificate file. Raises ValueError if it is none, or none can be read here."""
        try:
            certificates = importlib.import_module("deploy.hosts.certificates")
        except ModuleNotFoundError as error:
            raise ValueError(f"the Python package {error.name} is missing") from None
        own = certificates.read(path.read_bytes())
        return Certified(certificates.common_name(own), own.not_valid_before_utc, own.not_valid_after_utc)

    def kernels(self) -> Kernels:
        """Compile the kernels that are not in the cache."""
        began = time.monotonic()
        assembly.kernels()
        seconds, cache = time.monotonic() - began, cache_folder()
        nearest = next(path for path in (cache, *cache.parents) if path.exists())
        found = {
            id(item): sum(item.stats.cache_misses.values())
            for name, module in sys.modules.items()
            if name.startswith("actors.")
            for item in vars(module).values()
            if isinstance(item, Dispatcher)
        }
        return Kernels(cache, os.access(nearest, os.W_OK | os.X_OK), seconds, sum(found.values()))

    def isolation_fault(self) -> str | None:
        """Return why a robot's process cannot be isolated; None if it can."""
        return sandbox.available()


def finding(subject: str, check: Callable[..., str], *arguments: object) -> DoctorFinding:
    """Run a check, which returns the words for a sound state or raises AcrcError with fault and remedy."""
    try:
        return DoctorFinding(subject, True, check(*arguments))
    except AcrcError as error:
        return DoctorFinding(subject, False, str(error))


def packages(machine: Machine, constraints: str, needed: tuple[str, ...]) -> Iterator[DoctorFinding]:
    """Check that the extras in the text of constraints.txt are installed as they were tested."""
    for extra, pinned in version.sections(constraints, machine.python[1]).items():
        if extra != "build":  # present while building only
            tested = {pin.name: pin.version for pin in pinned}
            yield finding(f"packages {extra}", _extra, machine, tested, extra, extra in needed)


def _extra(machine: Machine, tested: Mapping[str, str], extra: str, needed: bool) -> str:
    found = {name: machine.version_of(name) for name in tested}
    missing = [name for name, release in found.items() if release is None]
    for name, release in found.items():
        if release not in {None, tested[name]}:
            raise AcrcError(
                f"{name} is {release}, but was tested as {tested[name]}; remove .venv, and the next "
                "./acrc makes it anew"
            )
    if not missing:
        said = "1 package, as it was" if len(tested) == 1 else f"{len(tested)} packages, as they were"
        return f"{said} tested"
    if needed:
        raise AcrcError(f"{', '.join(missing)} missing; `./{_BRINGS[extra]}` installs what is")
    return "not all installed, and not needed here"


def _clock(machine: Machine) -> str:
    now = machine.now()
    if now.year not in _YEARS:
        raise AcrcError(
            f'it shows the year {now.year}; set it with `sudo date --set="2026-01-31 12:00"`, or connect the '
            "computer to a network with time"
        )
    error = machine.clock_error()
    if error is None:
        raise AcrcError(
            f"it shows {now:%Y-%m-%d %H:%M} UTC, but nothing keeps it right; connect the computer to a "
            "network and run `sudo timedatectl set-ntp true`"
        )
    return f"{now:%Y-%m-%d %H:%M} UTC, synchronised, off by at most {error * 1000:.0f} ms"


def _disk(machine: Machine) -> str:
    free = f"{machine.free_bytes() / 1e9:.1f} GB are free at {machine.here}"
    if machine.free_bytes() / 1e9 < _FREE_GB:
        raise AcrcError(f"{free}, but {_FREE_GB:.1f} should be; remove old recordings")
    return free


def _namespaces(machine: Machine) -> str:
    if fault := machine.isolation_fault():
        raise AcrcError(fault)
    return "the robot's process can have a sandbox"


def _kernels(machine: Machine) -> str:
    state = machine.kernels()
    if not state.can_be_kept:
        raise AcrcError(
            f"compiled ones cannot be kept, as {machine.user} may not write to {state.cache}; "
            f"`sudo chown -R {machine.user} {state.cache.parent}` allows it"
        )
    if state.compiled:
        return f"{state.compiled} compiled just now, in {state.seconds:.0f} s, and kept"
    return f"all compiled, loaded in {state.seconds:.1f} s"


def _group(machine: Machine) -> str:
    state, user = machine.membership(GROUP), machine.user
    add = f"`sudo usermod -aG {GROUP} {user}`, then log in again"
    if state.in_force:
        return f"{user} may open the ports of the group {GROUP}"
    if not state.exists:
        raise AcrcError(f"there is no group {GROUP}; `sudo groupadd {GROUP}`, {add}")
    if state.listed:
        raise AcrcError(f"{user} is in the group {GROUP} only from the next login; log in again")
    raise AcrcError(f"{user} is not in the group {GROUP}; {add}")


COMPUTER: Final[Mapping[str, Callable[[Machine], str]]] = {
    "clock": _clock,
    "disk": _disk,
    "namespaces": _namespaces,
    "kernels": _kernels,
    "group": _group,
}
"""The checks of the computer alone; the group matters to robots only."""


def devices(machine: Machine, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Check that every device is at the port of the fleet file, and that a depth camera can be used."""
    yield finding("base", _port, machine, robot.base, KOBUKI)
    yield finding("radio", _port, machine, robot.radio, BOARD)
    if robot.range == OPENNI:
        yield finding("range", _camera, machine, robot)
    elif robot.range is not None:
        yield finding("range", _port, machine, robot.range, RPLIDAR)


def _camera(machine: Machine, robot: FleetRobot) -> str:
    if fault := machine.camera_fault():
        raise AcrcError(fault)
    DepthScanner(load_model(robot.model, robot.sensor).sensor)  # it must see as far round as the model says
    return "OpenNI2 is there"


def _port(machine: Machine, path: str, device: PortDevice) -> str:
    name = device.name
    if not machine.exists(path):
        raise AcrcError(f"{path}: {_missing(machine, path, device)}")
    usb = machine.usb_port(path)
    if usb is not None and device is KOBUKI and not units.is_kobuki(usb):
        raise AcrcError(
            f"{path}: {usb.vendor}:{usb.product} is plugged in there, which is no {name}; the name of the "
            "Kobuki's own port should stand in the fleet file"
        )
    if usb is not None and (holders := machine.holders(path)):  # an emulator holds its own port open
        raise AcrcError(
            f"{path}: {holders[0]} has the port open, so the {name} cannot be tried; end it, unless it is "
            "this very robot"
        )
    if fault := machine.port_fault(path, device):
        raise AcrcError(fault)
    return f"{path} opens" if usb is None or usb.path == path else f"{path} opens, at {usb.path}"


def _missing(machine: Machine, path: str, device: PortDevice) -> str:
    plugged = [port.path for port in machine.usb_ports() if units.may_be(device, port)]
    if not plugged:
        return f"there is no such port, and no {device.name} is seen; plug it in and switch it on"
    like = f"there is no such port, but {plugged[0]} looks like the {device.name}; "
    if units.given_name(path) is None:
        return like + "give that as its port"
    return like + "install the udev rules that `acrc fleet units` writes, then plug it in again"


def floor(fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Check that the map loads, and that start and places are on free floor."""
    try:
        grid = load_map(fleet.map)
        radii = {one.id: load_model(one.model, one.sensor).footprint.circumradius for one in fleet.robots}
    except AcrcError as error:
        yield DoctorFinding("map", False, str(error))
        return
    width, height = grid.columns * grid.resolution, grid.rows * grid.resolution
    yield DoctorFinding("map", True, f"{fleet.map}: {width:.1f} m by {height:.1f} m")
    yield finding("start", _start, fleet, robot, grid, radii)
    yield finding("places", _places, robot, grid)


def _start(fleet: Fleet, robot: FleetRobot, grid: OccupancyGrid, radii: Mapping[str, float]) -> str:
    here = Point(*robot.start[:2])
    check_pose(grid, here, radii[robot.id], robot.id)
    for other in fleet.robots:
        gap, least = here.distance_to(Point(*other.start[:2])), radii[robot.id] + radii[other.id]
        if other.id != robot.id and gap < least:
            raise AcrcError(
                f"{robot.id} would stand {gap:.2f} m from {other.id}, but must be at least {least:.2f} m off"
            )
    return f"({here.x:g}, {here.y:g}) is free; put {robot.id} there, then switch it on"


def _places(robot: FleetRobot, grid: OccupancyGrid) -> str:
    for index, (x, y) in enumerate(robot.places):
        if not grid.is_free(Point(x, y)):
            raise AcrcError(f"place {index} at ({x:g}, {y:g}) is not free, but must be on free floor")
    return f"all {len(robot.places)} are on free floor"


def behaviour(fleet: Fleet, robot: FleetRobot, permit: Permit) -> str:
    """Make the robot with its strategy, whose code runs once."""
    try:
        look_in(own_code(fleet, permit))
        with contextlib.redirect_stdout(sys.stderr):  # --json leaves nothing else there
            alone = fleet.swarm(robot)
            setup = robot_setup(alone, alone.world.robots[0])
            assembly.robot(setup, load_model(robot.model, robot.sensor), load_map(fleet.map))
    except AcrcError:
        raise
    except Exception as error:
        raise AcrcError(
            f"strategy {fleet.run.strategy!r} fails with {type(error).__name__}: {error}; mend its code"
        ) from None
    return f"strategy {fleet.run.strategy!r} makes a behaviour of its settings"


def keys(machine: Machine, fleet: Fleet, robot: FleetRobot) -> str:
    """Check that the robot's keys are its own, private and valid today."""
    files = load_keys(fleet.keys_of(robot.id))
    try:
        own, mode = machine.certificate(files.certificate), machine.mode(files.private_key)
    except (OSError, ValueError) as error:
        raise AcrcError(str(error)) from None
    now = machine.now()
    if own.name != robot.id:
        raise AcrcError(f"{files.certificate} is that of {own.name}; the folder of {robot.id} belongs here")
    if mode & 0o077:
        raise AcrcError(f"{files.private_key} can be read by others; `chmod 600 {files.private_key}`")
    if not own.begins <= now <= own.ends:
        raise AcrcError(
            f"{files.certificate} holds from {own.begins:%Y-%m-%d} to {own.ends:%Y-%m-%d}, but it is "
            f"{now:%Y-%m-%d} here; set the clock, or make new keys with `acrc fleet keys`"
        )
    return f"{files.certificate} holds until {own.ends:%Y-%m-%d}"


def configuration(
    machine: Machine, fleet: Fleet, robot: FleetRobot, permit: Permit
) -> Iterator[DoctorFinding]:
    """Check the robot's map, start, places, behaviour, and keys if it listens."""
    yield from floor(fleet, robot)
    yield finding("behaviour", behaviour, fleet, robot, permit)
    if robot.listen is not None:
        yield finding("keys", keys, machine, fleet, robot)


def findings(
    machine: Machine, fleet: Fleet | None, robot: FleetRobot | None, permit: Permit = INSTALLED
) -> Iterator[DoctorFinding]:
    """Run all checks, the quick ones first."""
    constraints = (SHIPPED / "constraints.txt").read_text("utf-8")
    yield from packages(machine, constraints, ("base",) if robot is None else ("base", "hardware"))
    for subject, check in COMPUTER.items():
        if robot is not None or check is not _group:
            yield finding(subject, check, machine)
    if fleet is not None and robot is not None:
        yield from devices(machine, robot)
        yield from configuration(machine, fleet, robot, permit)


def consult(
    path: Path | None,
    name: str | None,
    permit: Permit = INSTALLED,
    *,
    json: bool,
    machine: Machine | None = None,
) -> bool:
    """Check this computer, or as the robot `name` of the fleet in the file, and print; True if all is well.

    Raises OptionError if only one of both is given, and AcrcError for a file that cannot be used.
    """
    if path is None and name is not None:
        raise OptionError(
            f"--robot: {name} without a fleet file; must be as in acrc fleet doctor fleet.toml --robot {name}"
        )
    fleet = None if path is None else load_fleet(path)
    if fleet is not None and name is None:
        known = ", ".join(robot.id for robot in fleet.robots)
        raise OptionError(f"--robot: is missing; must say which of the robots this computer is: {known}")
    robot = fleet.robot_named(name) if fleet is not None and name is not None else None
    found: list[DoctorFinding] = []
    for one in findings(machine or Machine(), fleet, robot, permit):
        found.append(one)
        if not json:
            line = Text("ok     " if one.ok else "wrong  ", style="green" if one.ok else "bold red")
            line.append(f"{one.subject:<20} ", style="bold").append(one.text, style="default")
            screen().print(line)
    bad = sum(not one.ok for one in found)
    if json:
        report = Report(name, not bad, tuple(found))
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        count = f"{bad} of {len(found)} {'is' if bad == 1 else 'are'} wrong"
        screen().print(count if bad else f"all {len(found)} are well")
    return not bad
