"""The computer that this runs on."""

import getpass
import grp
import importlib
import os
import pwd
import shutil
import stat
import sys
import time
from contextlib import suppress
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from actors.robot import assembly as robot_setup
from actors.runtime.isolation import sandbox
from deploy.fleet import usb_ports
from deploy.fleet.doctor.kernel_clock import clock_error
from deploy.fleet.doctor.machine import Certified, GroupMembership, Kernels
from deploy.fleet.usb_ports import UsbPort
from firmware_bridge.range_sensors.openni import CameraError, find_library
from firmware_bridge.serial_port import PortDevice, PortError, SerialPort


class ThisMachine:
    """As Machine says."""

    def __init__(self) -> None:
        self.user = getpass.getuser()
        self.here = Path.cwd()
        self.python = sys.version_info[:2]

    def exists(self, path: str) -> bool:
        """As Machine says."""
        return os.path.exists(path)  # noqa: PTH110 - Path.exists raises where access is denied

    def usb_port(self, path: str) -> UsbPort | None:
        """As Machine says."""
        return usb_ports.usb_port(path)

    def usb_ports(self) -> list[UsbPort]:
        """As Machine says."""
        return usb_ports.usb_ports()

    def holders(self, path: str) -> list[str]:
        """As Machine says."""
        wanted, found = Path(path).resolve(), []
        for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda entry: int(entry.name)):
            with suppress(OSError):  # another user's, or ended meanwhile
                if process.name != str(os.getpid()) and any(
                    link.readlink() == wanted for link in (process / "fd").iterdir()
                ):
                    found.append(f"{(process / 'comm').read_text().strip()} (PID {process.name})")
        return found

    def port_fault(self, path: str, device: PortDevice) -> str | None:
        """As Machine says."""
        try:
            SerialPort(path, device).close()
        except PortError as error:
            return str(error)
        return None

    def camera_fault(self) -> str | None:
        """As Machine says."""
        try:
            find_library()
        except CameraError as error:
            return str(error)
        return None

    def membership(self, group: str) -> GroupMembership:
        """As Machine says."""
        root = os.geteuid() == 0
        try:
            entry = grp.getgrnam(group)
        except KeyError:
            return GroupMembership(exists=False, listed=False, in_force=root)
        primary = pwd.getpwnam(self.user).pw_gid
        listed = self.user in entry.gr_mem or primary == entry.gr_gid
        in_force = root or entry.gr_gid in {os.getegid(), *os.getgroups()}
        return GroupMembership(exists=True, listed=listed, in_force=in_force)

    def now(self) -> datetime:
        """As Machine says."""
        return datetime.now(UTC)

    def clock_error(self) -> float | None:
        """As Machine says."""
        return clock_error()

    def free_bytes(self) -> int:
        """As Machine says."""
        return shutil.disk_usage(self.here).free

    def version_of(self, package: str) -> str | None:
        """As Machine says."""
        try:
            return metadata.version(package)
        except metadata.PackageNotFoundError:
            return None

    def mode(self, path: Path) -> int:
        """As Machine says."""
        return stat.S_IMODE(path.stat().st_mode)

    def certificate(self, path: Path) -> Certified:
        """As Machine says."""
        try:
            certificates = importlib.import_module("deploy.fleet.certificates")
        except ModuleNotFoundError as error:
            raise ValueError(f"the Python package {error.name} is missing") from None
        own = certificates.read(path.read_bytes())
        return Certified(certificates.common_name(own), own.not_valid_before_utc, own.not_valid_after_utc)

    def kernels(self) -> Kernels:
        """As Machine says."""
        began = time.monotonic()
        robot_setup.kernels()
        seconds = time.monotonic() - began
        cache = Path(os.environ["NUMBA_CACHE_DIR"])  # actors has set it
        return Kernels(cache, _can_write(cache), seconds, _compiled())

    def isolation_fault(self) -> str | None:
        """As Machine says."""
        return sandbox.available()


def _can_write(folder: Path) -> bool:
    nearest = next(path for path in (folder, *folder.parents) if path.exists())
    return os.access(nearest, os.W_OK | os.X_OK)


def _compiled() -> int:
    """Kernels that this process found in no cache."""
    found = {
        id(item): sum(item.stats.cache_misses.values())
        for name, module in sys.modules.items()
        if name.startswith("actors.")
        for item in vars(module).values()
        if isinstance(item, Dispatcher)
    }
    return sum(found.values())
