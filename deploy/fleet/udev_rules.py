"""The udev rules of one robot: names, group and latency of the ports that its devices are plugged in at.

Sources: udev(7); Linux, drivers ftdi_sio (attribute latency_timer) and cp210x; yujinrobot/kobuki_core,
60-kobuki.rules.
"""

import re
from typing import Final

from deploy.fleet.fleet_file import FleetRobot
from firmware_bridge.beeclick.port import BOARD
from firmware_bridge.kobuki.port import KOBUKI
from firmware_bridge.onboard.onboard_setup import OPENNI
from firmware_bridge.range_sensors.rplidar import RPLIDAR
from firmware_bridge.serial_port import Device

GROUP: Final = "dialout"
"""Who may open serial ports; Debian's and Ubuntu's name for it."""
_FAST: Final = 'ATTR{device/latency_timer}="1", '
_NAME: Final = re.compile(
    r"/dev/((?!tty|pts/|serial/|bus/)[A-Za-z0-9][A-Za-z0-9_.+-]*(?:/[A-Za-z0-9][A-Za-z0-9_.+-]*)*)"
)


def rules(robot: FleetRobot) -> str:
    """The text of the robot's rules file; a port that has its kernel's name gets no other one."""
    parts = [
        f"# Ports of robot {robot.id}, written by `acrc fleet units`.",
        "",
        'ACTION=="remove", GOTO="acrc_end"',
        'SUBSYSTEM!="tty", GOTO="acrc_end"',
        "",
        "# Kobuki: its own FTDI chip, told from others by its serial number. FTDI chips hold bytes back for",
        "# 16 ms unless told otherwise; a Kobuki reports every 20.",
        _rule(f'{_of(KOBUKI)}, ATTRS{{serial}}=="kobuki*"', robot.base, _FAST),
        "",
        "# BEE click: any other FTDI chip, in the USB UART of the board it sits on. If yours has another,",
        "# `udevadm info --attribute-walk /dev/ttyUSB0` shows its idVendor and idProduct.",
        _rule(_of(BOARD), robot.radio, _FAST),
    ]
    if robot.range is not None and robot.range != OPENNI:
        parts += ["", "# RPLIDAR: the CP2102 of its USB adapter.", _rule(_of(RPLIDAR), robot.range)]
    parts += ["", 'LABEL="acrc_end"', ""]
    return "\n".join(parts)


def given_name(port: str) -> str | None:
    """What a rule calls the port, below /dev; None if it is the kernel that names it."""
    match = _NAME.fullmatch(port)
    return None if match is None else match[1]


def _of(device: Device) -> str:
    """What a port's rule asks for, so that it is one of that device's chip."""
    return f'ATTRS{{idVendor}}=="{device.chip.vendor}", ATTRS{{idProduct}}=="{device.chip.product}"'


def _rule(which: str, port: str, more: str = "") -> str:
    name = given_name(port)
    symlink = "" if name is None else f'SYMLINK+="{name}", '
    return f'{which}, GROUP="{GROUP}", MODE="0660", {more}{symlink}TAG+="systemd", GOTO="acrc_end"'
