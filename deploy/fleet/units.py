"""systemd service (from `robot.service`) and udev rules of one robot.

Source: systemd.unit(5), systemd.service(5), systemd.exec(5), systemd.resource-control(5).
"""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template
from typing import Final, NamedTuple

import msgspec

from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import NETWORK, Fleet, FleetRobot
from firmware_bridge.onboard.device_loop import OPENNI
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.serial_port import BOARD, KOBUKI, RPLIDAR, PortDevice

_TERMINALS = Path("/sys/class/tty")


class UsbPort(NamedTuple):
    """A serial port of a USB device."""

    path: str
    """Kernel name, such as /dev/ttyUSB0."""
    vendor: str
    """Vendor ID, four hexadecimal digits."""
    product: str
    serial: str
    """Serial number; empty if it has none."""
    socket: str = ""
    """USB socket, such as 1-1.3: bus, and port of each hub."""


def usb_port(path: str) -> UsbPort | None:
    """Return the port at `path`, links followed; None if missing or not a USB device."""
    name = Path(path).resolve().name
    folder = (_TERMINALS / name / "device").resolve()
    for parent in (folder, *folder.parents):
        if (parent / "idVendor").is_file():
            files = [parent / key for key in ("idVendor", "idProduct", "serial")]
            vendor, product, serial = (one.read_text().strip() if one.is_file() else "" for one in files)
            return UsbPort(f"/dev/{name}", vendor, product, serial, parent.name)
    return None


def usb_ports() -> list[UsbPort]:
    """Return all serial ports of USB devices, sorted by name."""
    names = sorted(path.name for path in _TERMINALS.iterdir()) if _TERMINALS.is_dir() else []
    found = (usb_port(f"/dev/{name}") for name in names)
    return [port for port in found if port is not None]


def is_kobuki(port: UsbPort) -> bool:
    """Return whether the port is a Kobuki, by the chip's serial number."""
    return port.serial.startswith("kobuki")


def matches_chip(device: PortDevice, port: UsbPort) -> bool:
    """Return whether the port's chip is that of the device."""
    if (port.vendor, port.product) != device.chip:
        return False
    return device not in {KOBUKI, BOARD} or is_kobuki(port) is (device is KOBUKI)


GROUP: Final = "dialout"
"""Group with access to serial ports on Debian and Ubuntu."""
_SERIAL: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_NAME: Final = re.compile(
    r"/dev/((?!tty|pts/|serial/|bus/)[A-Za-z0-9][A-Za-z0-9_.+-]*(?:/[A-Za-z0-9][A-Za-z0-9_.+-]*)*)"
)
_LOW_LATENCY: Final = 'ATTR{device/latency_timer}="1", '
"""FTDI chips buffer bytes for 16 ms by default; a Kobuki reports every 20 ms."""
_HEAD: Final = """\
# Ports of robot {robot}, written by `acrc fleet units`.

ACTION=="remove", GOTO="acrc_end"
SUBSYSTEM!="tty", GOTO="acrc_end"
"""


def udev_rules(robot: FleetRobot, plugged: Sequence[UsbPort]) -> str:
    """Return the text of the robot's udev rules; a port given by its kernel name gets no other name.

    `plugged`: ports of this computer. Board and lidar have common chips, so the name is assigned to the one
    device with the chip that is plugged in; with none or several, it is not assigned (see `unassigned`).
    """
    parts = [_HEAD.format(robot=robot.id)]
    if isinstance(robot.base, str):
        kobuki = _rule(f'{_chip_condition(KOBUKI)}, ATTRS{{serial}}=="kobuki*"', robot.base, _LOW_LATENCY)
        parts += ["# Kobuki: FTDI chip, identified by its serial number.", kobuki, ""]
    for device, port, chosen, text in _assignments(robot, plugged):
        attributes = _LOW_LATENCY if device is BOARD else ""
        parts.append(f"# {device.name}: {text}.")
        if chosen is not None:
            parts.append(_rule(f"{_chip_condition(device)}, {_identity(chosen)[0]}", port, attributes))
        parts += [_rule(_chip_condition(device), "", attributes), ""]
    return "\n".join([*parts, 'LABEL="acrc_end"', ""])


def unassigned(robot: FleetRobot, plugged: Sequence[UsbPort]) -> list[str]:
    """Return one sentence with cause and remedy per device whose name is not assigned."""
    return [
        f"{one.port}: {one.text}"
        for one in _assignments(robot, plugged)
        if one.chosen is None and symlink_name(one.port) is not None
    ]


class PortAssignment(NamedTuple):
    """Assignment of a board's or lidar's port name to a USB port."""

    device: PortDevice
    port: str
    chosen: UsbPort | None
    text: str
    """Reason for the choice."""


def _assignments(robot: FleetRobot, plugged: Sequence[UsbPort]) -> Iterator[PortAssignment]:
    for device, port in ((BOARD, robot.radio), (RPLIDAR, robot.range)):
        if port in {None, OPENNI, NETWORK}:
            continue
        candidates = [one for one in plugged if matches_chip(device, one)]
        traits = [f"{one.path} ({_identity(one)[1]})" for one in candidates]
        chosen = None
        if symlink_name(port) is None:
            text = f"{port} is a kernel name, which a rule cannot assign"
        elif not candidates:
            text = f"no {device.name} found, name not assigned; plug it in and write the units again"
        elif len(candidates) > 1:
            text = (
                f"{' and '.join(traits)} could each be the {device.name}, name not assigned; unplug all "
                "others and write the units again"
            )
        else:
            (chosen,) = candidates
            text = f"identified by {_identity(chosen)[1]}, was at {chosen.path}"
        yield PortAssignment(device, port, chosen, text)


def _identity(port: UsbPort) -> tuple[str, str]:
    """Return the udev condition for this port, and its description: unique serial number, or USB socket."""
    # Factory default of CP2102 chips: serial number 0001.
    if _SERIAL.fullmatch(port.serial) and port.serial.strip("0") != "1":
        return f'ATTRS{{serial}}=="{port.serial}"', f"serial number {port.serial}"
    return f'KERNELS=="{port.socket}"', f"USB port {port.socket}"


def symlink_name(port: str) -> str | None:
    """Return the port's name below /dev if a rule can assign it; None for kernel names."""
    match = _NAME.fullmatch(port)
    return None if match is None else match[1]


def _chip_condition(device: PortDevice) -> str:
    """Return the udev condition for the device's chip."""
    return f'ATTRS{{idVendor}}=="{device.chip.vendor}", ATTRS{{idProduct}}=="{device.chip.product}"'


def _rule(condition: str, port: str, attributes: str = "") -> str:
    name = symlink_name(port)
    symlink = "" if name is None else f'SYMLINK+="{name}", '
    return f'{condition}, GROUP="{GROUP}", MODE="0660", {attributes}{symlink}TAG+="systemd", GOTO="acrc_end"'


RULES_FILE: Final = "60-acrc.rules"
_TEMPLATE: Final = Path(__file__).with_name("robot.service")
_USER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,30}")


class UnitFiles(NamedTuple):
    """Written service and rules."""

    service_file: Path
    rules_file: Path
    unassigned: Sequence[str]
    """One sentence with cause and remedy per device whose name is not assigned."""


def write_units(
    fleet: Fleet,
    robot: FleetRobot,
    out: Path,
    *,
    program: Path,
    user: str,
    plugged: Sequence[UsbPort],
    modules: Sequence[Path] = (),
) -> UnitFiles:
    """Write service and rules to the folder `out`, created if missing; existing files are replaced.

    `program`: path of acrc on the robot. `user`: account of the service. `plugged`: see `udev_rules`.
    `modules`: folders from which the strategy may be loaded. Raises AcrcError or OptionError.
    """
    if not _USER.fullmatch(user):
        raise wrong_value("--user", user, "the name of a user of this computer")
    if out.exists() and not out.is_dir():
        raise OptionError(f"--out: {out} is a file; give a directory")
    written = UnitFiles(out / f"acrc-{robot.id}.service", out / RULES_FILE, unassigned(robot, plugged))
    try:
        out.mkdir(parents=True, exist_ok=True)
        written.service_file.write_text(
            service_text(fleet, robot, program=program, user=user, modules=modules)
        )
        written.rules_file.write_text(udev_rules(robot, plugged))
    except OSError as error:
        raise AcrcError(f"{out}: the units cannot be written: {error.strerror}") from None
    return written


def default_user(clone: Path) -> str:
    """Return the owner of the clone, or the user of sudo; never root. Raises OptionError."""
    try:
        owner = clone.owner()
    except KeyError:  # a number without a name
        owner = ""
    names = [name for name in (owner, os.environ.get("SUDO_USER", "")) if name not in {"", "root"}]
    if not names:
        raise OptionError(
            "--user: missing; this clone belongs to root, and a robot must not run as root: give another "
            "user's name"
        )
    return names[0]


def service_text(
    fleet: Fleet, robot: FleetRobot, *, program: Path, user: str, modules: Sequence[Path] = ()
) -> str:
    """Return the text of the service file."""
    root = program.parent
    named = (robot.base, robot.radio, robot.range)
    ports = [port for port in named if isinstance(port, str) and port.startswith("/dev/")]
    devices = " ".join(map(_device_unit, ports))
    after, wants = "time-set.target", ""
    listens = robot.listen is not None and not robot.listens_everywhere
    if listens or isinstance(robot.base, Ros2Base) or robot.radio == NETWORK:
        # Listening at a specific address, a robot's router, and a radio medium need a configured network.
        after, wants = f"{after} network-online.target", "network-online.target"
    own = (word for folder in modules for word in ("--modules", str(folder)))
    start = [str(program), "fleet", "onboard", str(fleet.path), "--robot", robot.id, *own]
    guardian = root / "firmware_bridge" / "kobuki" / "guardian.py"
    # "-": systemd ignores the exit code.
    if isinstance(robot.base, str):
        alone = ["-S", str(guardian), "alone", robot.base]
    else:
        settings = msgspec.json.encode(robot.base).decode()
        alone = ["-m", "firmware_bridge.ros2.guardian", "alone", settings]
    stop = [f"-{root / '.venv' / 'bin' / 'python'}", "-I", *alone]
    start_line, stop_line = (
        " ".join(_quoted(word).replace("$", "$$") for word in words) for words in (start, stop)
    )
    return Template(_TEMPLATE.read_text()).substitute(
        robot=robot.id,
        fleet=fleet.path.stem.replace("%", "%%"),
        wants=f"{devices} {wants}".strip(),
        after=f"{after} {devices}".strip(),
        user=user,
        group=GROUP,
        start=start_line,
        stop=stop_line,
        camera="DeviceAllow=char-usb_device rw" if robot.range == OPENNI else "# No depth camera.",
        root=_quoted(str(root)),
    )


def _device_unit(path: str) -> str:
    """Return the device unit of a path in /dev, escaped as by `systemd-escape --path`."""
    name = "/".join(part for part in path.split("/") if part).encode()
    escaped = re.sub(rb"[^A-Za-z0-9:_./]|^\.", lambda match: b"\\x%02x" % match[0][0], name)
    return escaped.replace(b"/", b"-").decode() + ".device"


def _quoted(word: str) -> str:
    """Return a word quoted for a unit file."""
    word = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
    return word if re.fullmatch(r"[\w/.,:=@%+$-]+", word) else f'"{word}"'
