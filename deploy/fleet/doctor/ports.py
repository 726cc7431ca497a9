"""Checks of a robot's devices: ports, who may open them, who has them open, the depth camera."""

from collections.abc import Iterator
from typing import Final

from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from deploy.fleet.doctor.machine import DoctorFinding, Machine, well, wrong
from deploy.fleet.fleet_file import FleetRobot
from deploy.fleet.udev_rules import GROUP, given_name
from deploy.fleet.usb_ports import is_kobuki, may_be
from firmware_bridge.onboard.onboard_setup import OPENNI
from firmware_bridge.range_sensors.depth import DepthScanner
from firmware_bridge.serial_port import BOARD, KOBUKI, RPLIDAR, PortDevice

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
