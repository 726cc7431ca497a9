"""All that the checks ask of the computer, and what they find; tests put another one in its place."""

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
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import msgspec
from numba.core.dispatcher import Dispatcher

from actors.kernels import cache_folder
from actors.robot import assembly as robot_setup
from actors.runtime.isolation import sandbox
from deploy.fleet import udev
from deploy.fleet.udev import UsbPort
from firmware_bridge.range_sensors.depth_camera import CameraError, find_library
from firmware_bridge.serial_port import PortDevice, PortError, SerialPort


class DoctorFinding(msgspec.Struct, frozen=True):
    """One thing that was looked at: how it is, and if it is wrong what would put it right: one sentence."""

    subject: str
    ok: bool
    text: str


def well(subject: str, text: str) -> DoctorFinding:
    """As it should be."""
    return DoctorFinding(subject, True, text)


def wrong(subject: str, text: str) -> DoctorFinding:
    """Not as it should be."""
    return DoctorFinding(subject, False, text)


@dataclass(frozen=True)
class GroupMembership:
    """How this user and a group stand."""

    exists: bool
    listed: bool
    """The user is in the group."""
    in_force: bool
    """And was when he logged in; so it is for root always."""


@dataclass(frozen=True)
class Certified:
    """What stands in a certificate."""

    name: str
    begins: datetime
    ends: datetime


@dataclass(frozen=True)
class Kernels:
    """How the numeric kernels are."""

    cache: Path
    """Folder for the compiled ones."""
    can_be_kept: bool
    """True if this user can write there."""
    seconds: float
    """How long it took to have them all."""
    compiled: int
    """How many were not compiled before."""


_UNSYNCHRONISED = 0x0040
"""STA_UNSYNC of adjtimex(2)."""


class _Timex(ctypes.Structure):
    """The head of struct timex, and room for the rest (adjtimex(2))."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("frequency", ctypes.c_long),
        ("largest_error_us", ctypes.c_long),
        ("estimated_error_us", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def clock_error() -> float | None:
    """By how much the clock may be off at most, s; None if it is not synchronised, or if nobody can tell."""
    if sys.platform != "linux":
        return None
    answer = _Timex()  # modes 0: look, do not touch
    if ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(answer)) < 0:
        return None
    if answer.status & _UNSYNCHRONISED:
        return None
    return float(answer.largest_error_us) / 1e6


class Machine:
    """The computer that this runs on, which may become a robot's."""

    def __init__(self) -> None:
        self.user = getpass.getuser()
        """Name of whoever asks."""
        self.here = Path.cwd()
        """Where recordings go."""
        self.python = sys.version_info[:2]
        """Version of Python, such as 3, 11."""

    def exists(self, path: str) -> bool:
        """True if there is something of that name."""
        return os.path.exists(path)  # noqa: PTH110 - Path.exists raises where access is denied

    def usb_port(self, path: str) -> UsbPort | None:
        """The USB device behind a port's name; None if it is none."""
        return udev.usb_port(path)

    def usb_ports(self) -> list[UsbPort]:
        """All of them."""
        return udev.usb_ports()

    def holders(self, path: str) -> list[str]:
        """The processes that have it open, as far as this user can see, such as "python3 (PID 812)"."""
        wanted, found = Path(path).resolve(), []
        for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda entry: int(entry.name)):
            with suppress(OSError):  # another user's, or ended meanwhile
                if process.name != str(os.getpid()) and any(
                    link.readlink() == wanted for link in (process / "fd").iterdir()
                ):
                    found.append(f"{(process / 'comm').read_text().strip()} (PID {process.name})")
        return found

    def port_fault(self, path: str, device: PortDevice) -> str | None:
        """Why the port cannot be opened, in one sentence; None if it can."""
        try:
            SerialPort(path, device).close()
        except PortError as error:
            return str(error)
        return None

    def camera_fault(self) -> str | None:
        """Why no depth camera can be used; None if the library for it is there."""
        try:
            find_library()
        except CameraError as error:
            return str(error)
        return None

    def membership(self, group: str) -> GroupMembership:
        """How this user and the group stand."""
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
        """The clock."""
        return datetime.now(UTC)

    def clock_error(self) -> float | None:
        """By how much the clock may be off, s, as the kernel believes; None: it is not synchronised."""
        return clock_error()

    def free_bytes(self) -> int:
        """What this user may still write to the disk with `here`."""
        return shutil.disk_usage(self.here).free

    def version_of(self, package: str) -> str | None:
        """Of an installed Python package; None if it is not."""
        try:
            return metadata.version(package)
        except metadata.PackageNotFoundError:
            return None

    def mode(self, path: Path) -> int:
        """Permission bits of a file. Raises OSError."""
        return stat.S_IMODE(path.stat().st_mode)

    def certificate(self, path: Path) -> Certified:
        """What stands in a certificate file. Raises ValueError if it is none, or none can be read here."""
        try:
            certificates = importlib.import_module("deploy.hosts.certificates")
        except ModuleNotFoundError as error:
            raise ValueError(f"the Python package {error.name} is missing") from None
        own = certificates.read(path.read_bytes())
        return Certified(certificates.common_name(own), own.not_valid_before_utc, own.not_valid_after_utc)

    def kernels(self) -> Kernels:
        """Compile those that are not yet."""
        began = time.monotonic()
        robot_setup.kernels()
        seconds = time.monotonic() - began
        cache = cache_folder()
        return Kernels(cache, _can_write(cache), seconds, _compiled())

    def isolation_fault(self) -> str | None:
        """Why a robot's process cannot be shut off, in one sentence; None if it can."""
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
