"""Checks of a robot's computer and devices, and of its map, start, places, behaviour and keys."""

import contextlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.geometry import Point
from actors.installation import pins
from actors.robot import assembly
from actors.robot.behaviour.foreign import Permit
from actors.robot.behaviour.modules import look_in
from actors.robot_model import RobotModel, load_model
from actors.runtime.access.tls import load_keys
from actors.runtime.errors import AcrcError
from deploy.fleet.doctor.machine import DoctorFinding, Machine, well, wrong
from deploy.fleet.fleet_file import Fleet, FleetRobot, own_code
from deploy.fleet.udev import GROUP, given_name, is_kobuki, may_be
from deploy.scenario.resolve import robot_setup
from firmware_bridge.onboard.onboard_setup import OPENNI
from firmware_bridge.range_sensors.depth import DepthScanner
from firmware_bridge.serial_port import BOARD, KOBUKI, RPLIDAR, PortDevice

_BRINGS: Final = {"base": "acrc", "hardware": "acrc fleet units"}
"""The command for which ./acrc installs what a robot needs."""


@dataclass(frozen=True)
class ComputerParameters:
    """What is enough."""

    first_year: int = 2025
    """A clock that shows an earlier one was never set. Default: the year of this software."""
    last_year: int = 2100
    free_bytes: int = 2_000_000_000
    """On the disk. Default: own choice; a robot with a lidar records up to 100 MB an hour."""


def packages(machine: Machine, constraints: str, needed: tuple[str, ...]) -> Iterator[DoctorFinding]:
    """Whether the extras in the text of constraints.txt are installed as they were tested."""
    for extra, pinned in pins.sections(constraints, machine.python[1]).items():
        if extra == "build":
            continue  # there while building only
        subject = f"packages {extra}"
        tested = {pin.name: pin.version for pin in pinned}
        found = {name: machine.version_of(name) for name in tested}
        missing = [name for name, version in found.items() if version is None]
        others = [name for name, version in found.items() if version not in {None, tested[name]}]
        if others:
            name = others[0]
            yield wrong(
                subject,
                f"{name} is {found[name]}, but was tested as {tested[name]}; remove .venv, and the next "
                "./acrc makes it anew",
            )
        elif not missing:
            said = "1 package, as it was" if len(tested) == 1 else f"{len(tested)} packages, as they were"
            yield well(subject, f"{said} tested")
        elif extra in needed:
            yield wrong(subject, f"{', '.join(missing)} missing; `./{_BRINGS[extra]}` installs what is")
        else:
            yield well(subject, "not all installed, and not needed here")


def clock(machine: Machine, parameters: ComputerParameters = ComputerParameters()) -> Iterator[DoctorFinding]:
    """Whether the clock shows the time."""
    now = machine.now()
    if not parameters.first_year <= now.year < parameters.last_year:
        yield wrong(
            "clock",
            f'it shows the year {now.year}; set it with `sudo date --set="2026-01-31 12:00"`, or connect the '
            "computer to a network with time",
        )
        return
    error = machine.clock_error()
    if error is None:
        yield wrong(
            "clock",
            f"it shows {now:%Y-%m-%d %H:%M} UTC, but nothing keeps it right; connect the computer to a "
            "network and run `sudo timedatectl set-ntp true`",
        )
    else:
        yield well("clock", f"{now:%Y-%m-%d %H:%M} UTC, synchronised, off by at most {error * 1000:.0f} ms")


def disk(machine: Machine, parameters: ComputerParameters = ComputerParameters()) -> Iterator[DoctorFinding]:
    """Whether recordings find room."""
    free, least = machine.free_bytes() / 1e9, parameters.free_bytes / 1e9
    if free < least:
        yield wrong(
            "disk",
            f"{free:.1f} GB are free at {machine.here}, but {least:.1f} should be; remove old recordings",
        )
    else:
        yield well("disk", f"{free:.1f} GB are free at {machine.here}")


def kernels(machine: Machine) -> Iterator[DoctorFinding]:
    """Whether numeric kernels are compiled before the robot's first step."""
    state = machine.kernels()
    if not state.can_be_kept:
        yield wrong(
            "kernels",
            f"compiled ones cannot be kept, as {machine.user} may not write to {state.cache}; "
            f"`sudo chown -R {machine.user} {state.cache.parent}` allows it",
        )
    elif state.compiled:
        yield well("kernels", f"{state.compiled} compiled just now, in {state.seconds:.0f} s, and kept")
    else:
        yield well("kernels", f"all compiled, loaded in {state.seconds:.1f} s")


def namespaces(machine: Machine) -> Iterator[DoctorFinding]:
    """Whether robots can be isolated."""
    fault = machine.isolation_fault()
    if fault is None:
        yield well("namespaces", "the robot's process can have a sandbox")
    else:
        yield wrong("namespaces", fault)


_DEVICES: Final = (KOBUKI, BOARD, RPLIDAR)


def ports(machine: Machine, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether every device is where the fleet file says."""
    lidar = None if robot.range == OPENNI else robot.range
    for subject, path, device in zip(
        ("base", "radio", "range"), (robot.base, robot.radio, lidar), _DEVICES, strict=True
    ):
        if path is not None:
            yield _port(machine, subject, path, device)


def group(machine: Machine) -> Iterator[DoctorFinding]:
    """Whether this user may open serial ports."""
    state = machine.membership(GROUP)
    add = f"`sudo usermod -aG {GROUP} {machine.user}`"
    if state.in_force:
        yield well("group", f"{machine.user} may open the ports of the group {GROUP}")
    elif not state.exists:
        yield wrong("group", f"there is no group {GROUP}; `sudo groupadd {GROUP}`, {add}, then log in again")
    elif state.listed:
        yield wrong("group", f"{machine.user} is in the group {GROUP} only from the next login; log in again")
    else:
        yield wrong("group", f"{machine.user} is not in the group {GROUP}; {add}, then log in again")


def camera(machine: Machine, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether a depth camera can be used, and sees what the robot's model says; nothing if there is none."""
    if robot.range != OPENNI:
        return
    fault = machine.camera_fault()
    if fault is None:
        try:
            DepthScanner(load_model(robot.model, robot.sensor).sensor)
        except AcrcError as error:
            fault = str(error)
    yield well("range", "OpenNI2 is there") if fault is None else wrong("range", fault)


def _port(machine: Machine, subject: str, path: str, device: PortDevice) -> DoctorFinding:
    name = device.name
    if not machine.exists(path):
        return wrong(subject, f"{path}: {_missing(machine, path, device)}")
    usb = machine.usb_port(path)
    if usb is not None and device is KOBUKI and not is_kobuki(usb):
        return wrong(
            subject,
            f"{path}: {usb.vendor}:{usb.product} is plugged in there, which is no {name}; the name of the "
            "Kobuki's own port should stand in the fleet file",
        )
    holders = [] if usb is None else machine.holders(path)  # an emulator holds its own port open
    if holders:
        return wrong(
            subject,
            f"{path}: {holders[0]} has the port open, so the {name} cannot be tried; end it, unless it is "
            "this very robot",
        )
    fault = machine.port_fault(path, device)
    if fault is not None:
        return wrong(subject, fault)
    return well(
        subject, f"{path} opens" if usb is None or usb.path == path else f"{path} opens, at {usb.path}"
    )


def _missing(machine: Machine, path: str, device: PortDevice) -> str:
    plugged = [port.path for port in machine.usb_ports() if may_be(device, port)]
    if not plugged:
        return f"there is no such port, and no {device.name} is seen; plug it in and switch it on"
    if given_name(path) is None:
        return f"there is no such port, but {plugged[0]} looks like the {device.name}; give that as its port"
    return (
        f"there is no such port, but {plugged[0]} looks like the {device.name}; install the udev rules that "
        "`acrc fleet units` writes, then plug it in again"
    )


def floor(fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether the map loads, and start and places are on free floor."""
    try:
        grid, radii = (
            load_map(fleet.map),
            {one.id: _model(one).footprint.circumradius for one in fleet.robots},
        )
    except AcrcError as error:
        yield wrong("map", str(error))
        return
    width, height = grid.columns * grid.resolution, grid.rows * grid.resolution
    yield well("map", f"{fleet.map}: {width:.1f} m by {height:.1f} m")
    yield _start(fleet, robot, grid, radii)
    yield _places(robot, grid)


def behaviour(fleet: Fleet, robot: FleetRobot, permit: Permit) -> Iterator[DoctorFinding]:
    """Whether the robot can be made, with its strategy; runs the strategy's code once."""
    try:
        look_in(own_code(fleet, permit))
        with contextlib.redirect_stdout(sys.stderr):  # --json leaves nothing else there
            _make(fleet, robot)
    except AcrcError as error:
        yield wrong("behaviour", str(error))
    except Exception as error:
        yield wrong(
            "behaviour",
            f"strategy {fleet.run.strategy!r} fails with {type(error).__name__}: {error}; mend its code",
        )
    else:
        yield well("behaviour", f"strategy {fleet.run.strategy!r} makes a behaviour of its settings")


def keys(machine: Machine, fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether a robot that listens has keys of its own that hold today; nothing if it does not listen."""
    if robot.listen is None:
        return
    try:
        files = load_keys(fleet.keys_of(robot.id))
        own = machine.certificate(files.certificate)
        mode = machine.mode(files.private_key)
    except (AcrcError, OSError, ValueError) as error:
        yield wrong("keys", str(error))
        return
    now = machine.now()
    if own.name != robot.id:
        yield wrong(
            "keys", f"{files.certificate} is that of {own.name}; the folder of {robot.id} belongs here"
        )
    elif mode & 0o077:
        yield wrong("keys", f"{files.private_key} can be read by others; `chmod 600 {files.private_key}`")
    elif not own.begins <= now <= own.ends:
        yield wrong(
            "keys",
            f"{files.certificate} holds from {own.begins:%Y-%m-%d} to {own.ends:%Y-%m-%d}, but it is "
            f"{now:%Y-%m-%d} here; set the clock, or make new keys with `acrc fleet keys`",
        )
    else:
        yield well("keys", f"{files.certificate} holds until {own.ends:%Y-%m-%d}")


def _model(robot: FleetRobot) -> RobotModel:
    return load_model(robot.model, robot.sensor)


def _start(fleet: Fleet, robot: FleetRobot, grid: OccupancyGrid, radii: Mapping[str, float]) -> DoctorFinding:
    here = Point(*robot.start[:2])
    try:
        check_pose(grid, here, radii[robot.id], robot.id)
    except AcrcError as error:
        return wrong("start", str(error))
    for other in fleet.robots:
        gap, least = here.distance_to(Point(*other.start[:2])), radii[robot.id] + radii[other.id]
        if other.id != robot.id and gap < least:
            return wrong(
                "start",
                f"{robot.id} would stand {gap:.2f} m from {other.id}, but must be at least {least:.2f} m off",
            )
    return well("start", f"({here.x:g}, {here.y:g}) is free; put {robot.id} there, then switch it on")


def _places(robot: FleetRobot, grid: OccupancyGrid) -> DoctorFinding:
    for index, (x, y) in enumerate(robot.places):
        if not grid.is_free(Point(x, y)):
            return wrong("places", f"place {index} at ({x:g}, {y:g}) is not free, but must be on free floor")
    return well("places", f"all {len(robot.places)} are on free floor")


def _make(fleet: Fleet, robot: FleetRobot) -> None:
    alone = fleet.swarm(robot)
    told = robot_setup(alone, alone.world.robots[0])
    assembly.robot(told, _model(robot), load_map(fleet.map))
