"""The systemd service that runs one robot from power-on to power-off: `robot.service`, filled in.

Source: systemd.unit(5), systemd.service(5), systemd.exec(5), systemd.resource-control(5).
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Final

from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import Fleet, FleetRobot
from deploy.fleet.udev import GROUP, UsbPort, rules, unnamed
from firmware_bridge.onboard.onboard_setup import OPENNI

RULES_FILE: Final = "60-acrc.rules"
_TEMPLATE: Final = Path(__file__).with_name("robot.service")
_USER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,30}")


@dataclass(frozen=True)
class Units:
    """What makes a computer a robot's."""

    service_file: Path
    rules_file: Path
    unnamed: Sequence[str]
    """Why a device gets no name, a sentence for each."""


def write(
    fleet: Fleet,
    robot: FleetRobot,
    out: Path,
    *,
    program: Path,
    user: str,
    plugged: Sequence[UsbPort],
    modules: Sequence[Path] = (),
) -> Units:
    """Write service and rules into the folder `out`, made if need be; files that are there are replaced.

    `program`: the script acrc on the robot. `user`: who the robot runs as. `plugged`: see `rules`. `modules`:
    where its strategy may be loaded from. Raises AcrcError or OptionError.
    """
    if not _USER.fullmatch(user):
        raise wrong_value("--user", user, "the name of a user of this computer")
    if out.exists() and not out.is_dir():
        raise OptionError(f"--out: {out} is a file; must be a folder")
    written = Units(out / f"acrc-{robot.id}.service", out / RULES_FILE, unnamed(robot, plugged))
    try:
        out.mkdir(parents=True, exist_ok=True)
        written.service_file.write_text(service(fleet, robot, program=program, user=user, modules=modules))
        written.rules_file.write_text(rules(robot, plugged))
    except OSError as error:
        raise AcrcError(f"{out}: the units cannot be written: {error.strerror}") from None
    return written


def everyday_user(clone: Path) -> str:
    """Who a robot of this clone runs as: its owner, or who became root by sudo; never root. OptionError."""
    try:
        owner = clone.owner()
    except KeyError:  # a number without a name
        owner = ""
    names = [name for name in (owner, os.environ.get("SUDO_USER", "")) if name not in {"", "root"}]
    if not names:
        raise OptionError(
            "--user: is missing; must say who the robot runs as, for this clone belongs to root, and a robot "
            "should run without root's rights"
        )
    return names[0]


def service(
    fleet: Fleet, robot: FleetRobot, *, program: Path, user: str, modules: Sequence[Path] = ()
) -> str:
    """Return the text of the service's file."""
    root = program.parent
    devices = " ".join(_device(port) for port in _ports(robot) if port.startswith("/dev/"))
    after, wants = "time-set.target", ""
    if robot.listen is not None and not robot.listens_everywhere:
        # The address that it listens at has to be there; robots do not need the network otherwise.
        after, wants = f"{after} network-online.target", "network-online.target"
    own = (word for folder in modules for word in ("--modules", str(folder)))
    start = (str(program), "fleet", "onboard", str(fleet.path), "--robot", robot.id, *own)
    guardian = root / "firmware_bridge" / "kobuki" / "guardian.py"
    # The guardian alone; the sign in front: its exit code does not change the service's.
    stop = (f"-{root / '.venv' / 'bin' / 'python'}", "-I", "-S", str(guardian), "alone", robot.base)
    return Template(_TEMPLATE.read_text()).substitute(
        robot=robot.id,
        fleet=_plain(fleet.path.stem),
        wants=f"{devices} {wants}".strip(),
        after=f"{after} {devices}".strip(),
        user=user,
        group=GROUP,
        start=" ".join(map(_word, start)),
        stop=" ".join(map(_word, stop)),
        camera="DeviceAllow=char-usb_device rw" if robot.range == OPENNI else "# No depth camera.",
        root=_word(str(root), of_command=False),
    )


def _ports(robot: FleetRobot) -> list[str]:
    return [port for port in (robot.base, robot.radio, robot.range) if port is not None and port != OPENNI]


def _device(path: str) -> str:
    """The device unit of a path in /dev, escaped as by systemd-escape --path."""
    return _escaped("/".join(part for part in path.split("/") if part)) + ".device"


def _escaped(path: str) -> str:
    def one(index: int, byte: int) -> str:
        char = chr(byte)
        if char == "/":
            return "-"
        plain = char.isascii() and (char.isalnum() or char in ":_" or (char == "." and index > 0))
        return char if plain else f"\\x{byte:02x}"

    return "".join(one(index, byte) for index, byte in enumerate(path.encode()))


def _plain(text: str) -> str:
    return text.replace("%", "%%")


def _word(text: str, *, of_command: bool = True) -> str:
    """One word, as it is, of a command line or a list of paths."""
    text = _plain(text.replace("\\", "\\\\").replace('"', '\\"'))
    if of_command:
        text = text.replace("$", "$$")
    return text if re.fullmatch(r"[\w/.,:=@%+$-]+", text) else f'"{text}"'
