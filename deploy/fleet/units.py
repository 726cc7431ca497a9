"""The systemd service that runs one robot from switching on to switching off.

Source: systemd.unit(5), systemd.service(5), systemd.exec(5), systemd.resource-control(5).
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import Fleet, FleetRobot
from deploy.fleet.udev_rules import GROUP, rules, unnamed
from deploy.fleet.usb_ports import UsbPort
from firmware_bridge.onboard.onboard_setup import OPENNI

RULES_FILE: Final = "60-acrc.rules"
_USER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,30}")


@dataclass(frozen=True)
class ServiceParameters:
    """How the service is started and ended."""

    restarts: int = 5
    """So often it is started within `restart_window_s`, then it stays down. Default: own choice; the
    supervisor has a budget of its own and gives up for a reason that a restart seldom mends."""
    restart_window_s: int = 300
    restart_pause_s: int = 5
    """Before it is started again, s. Default: own choice; a USB device that was reset is back by then."""
    stop_s: int = 20
    """After so long a stopping service is killed, s. Default: own choice; three processes close their
    recordings."""
    start_s: int = 900
    """So long it may take until all processes have been started, s. Default: own choice; the very first start
    installs packages and compiles kernels."""
    watchdog_s: int = 20
    """A supervisor that gives no sign of life for so long hangs, and is ended, s. Default: own choice."""
    nice: int = -5
    """Ahead of what else the computer does, so that steps are not late."""


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
    fleet: Fleet,
    robot: FleetRobot,
    *,
    program: Path,
    user: str,
    modules: Sequence[Path] = (),
    parameters: ServiceParameters = ServiceParameters(),
) -> str:
    """The text of the service's file."""
    sections = {
        "Unit": _unit(fleet, robot, parameters),
        "Service": [
            *_service(_onboard(fleet, robot, program, modules), robot, program, user, parameters),
            *_sandbox(robot, program.parent),
        ],
        "Install": [("WantedBy", "multi-user.target")],
    }
    parts = [
        f"# Robot {robot.id}, written by `acrc fleet units`; write it anew once the fleet file has moved."
    ]
    for title, lines in sections.items():
        parts.append("\n".join([f"[{title}]", *(f"{key}={value}" if key else value for key, value in lines)]))
    return "\n\n".join(parts) + "\n"


Lines = list[tuple[str, str]]
"""Keys and values; without a key a comment."""


def _unit(fleet: Fleet, robot: FleetRobot, parameters: ServiceParameters) -> Lines:
    devices = " ".join(_device(port) for port in _ports(robot) if port.startswith("/dev/"))
    after, wants = "time-set.target", ""
    if robot.listen is not None and not robot.listens_everywhere:
        # The address that it listens at has to be there; robots do not need the network otherwise.
        after, wants = f"{after} network-online.target", "network-online.target"
    return [
        ("Description", f"Robot {robot.id} of the fleet {_plain(fleet.path.stem)}"),
        (
            "",
            "# Waits a while for the devices; what is missing then, the robot says itself and looks on for.",
        ),
        ("Wants", f"{devices} {wants}".strip()),
        ("After", f"{after} {devices}".strip()),
        ("StartLimitIntervalSec", f"{parameters.restart_window_s}"),
        ("StartLimitBurst", f"{parameters.restarts}"),
    ]


def _onboard(fleet: Fleet, robot: FleetRobot, program: Path, modules: Sequence[Path]) -> tuple[str, ...]:
    own = (word for folder in modules for word in ("--modules", str(folder)))
    return (str(program), "fleet", "onboard", str(fleet.path), "--robot", robot.id, *own)


def _service(
    words: Sequence[str], robot: FleetRobot, program: Path, user: str, parameters: ServiceParameters
) -> Lines:
    return [
        ("Type", "notify"),
        ("NotifyAccess", "main"),
        ("TimeoutStartSec", f"{parameters.start_s}"),
        ("WatchdogSec", f"{parameters.watchdog_s}"),
        ("User", user),
        ("SupplementaryGroups", GROUP),
        ("", "# Recordings are in /var/lib/acrc/runs."),
        ("StateDirectory", "acrc"),
        ("WorkingDirectory", "%S/acrc"),
        ("ExecStart", " ".join(map(_word, words))),
        ("", "# The last word, should all processes be killed at once: stop, until the wheels stand."),
        ("ExecStopPost", " ".join(map(_word, _stop(robot, program)))),
        ("Restart", "on-failure"),
        ("RestartSec", f"{parameters.restart_pause_s}"),
        ("", "# The supervisor is told first, and stops its processes in order."),
        ("KillMode", "mixed"),
        ("SuccessExitStatus", "143"),
        ("TimeoutStopSec", f"{parameters.stop_s}"),
        ("Nice", f"{parameters.nice}"),
        ("StandardOutput", "journal"),
        ("StandardError", "journal"),
        ("SyslogIdentifier", f"acrc-{robot.id}"),
    ]


def _stop(robot: FleetRobot, program: Path) -> tuple[str, ...]:
    """The guardian alone; the sign in front: whatever it comes to, the service has ended as it has."""
    python = program.parent / ".venv" / "bin" / "python"
    script = program.parent / "firmware_bridge" / "kobuki" / "guardian.py"
    return (f"-{python}", "-I", "-S", str(script), "alone", robot.base)


def _sandbox(robot: FleetRobot, root: Path) -> Lines:
    """What is taken from the service because a robot needs none of it."""
    camera = [("DeviceAllow", "char-usb_device rw")] if robot.range == OPENNI else []
    return [
        ("", "# The devices, this folder (compiled kernels) and the recordings are all it may touch."),
        ("DevicePolicy", "closed"),
        ("DeviceAllow", "char-ttyUSB rw"),
        ("DeviceAllow", "char-ttyACM rw"),
        *camera,
        ("ProtectSystem", "strict"),
        ("ReadWritePaths", _word(str(root), of_command=False)),
        ("PrivateTmp", "yes"),
        ("NoNewPrivileges", "yes"),
        ("CapabilityBoundingSet", ""),
        ("ProtectClock", "yes"),
        ("ProtectControlGroups", "yes"),
        ("ProtectHostname", "yes"),
        ("ProtectKernelLogs", "yes"),
        ("ProtectKernelModules", "yes"),
        ("ProtectKernelTunables", "yes"),
        ("RestrictAddressFamilies", "AF_UNIX AF_INET AF_INET6 AF_NETLINK"),
        ("RestrictRealtime", "yes"),
        ("RestrictSUIDSGID", "yes"),
        ("LockPersonality", "yes"),
        ("SystemCallArchitectures", "native"),
        (
            "",
            "# RestrictNamespaces= would forbid robots' isolation, MemoryDenyWriteExecute= their kernels.",
        ),
    ]


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
