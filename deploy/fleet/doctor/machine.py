"""All that the checks ask of the computer, so that they can be tried without it."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Protocol

from deploy.fleet.usb_ports import UsbPort
from firmware_bridge.serial_port import PortDevice


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


class Machine(Protocol):
    """A computer that may become a robot."""

    @property
    def user(self) -> str:
        """Name of whoever asks."""

    @property
    def here(self) -> Path:
        """Where recordings go."""

    @property
    def python(self) -> tuple[int, int]:
        """Version of Python, such as 3, 11."""

    def exists(self, path: str) -> bool:
        """True if there is something of that name."""

    def usb_port(self, path: str) -> UsbPort | None:
        """The USB device behind a port's name; None if it is none."""

    def usb_ports(self) -> list[UsbPort]:
        """All of them."""

    def holders(self, path: str) -> list[str]:
        """The processes that have it open, as far as this user can see, such as "python3 (PID 812)"."""

    def port_fault(self, path: str, device: PortDevice) -> str | None:
        """Why the port cannot be opened, in one sentence; None if it can."""

    def camera_fault(self) -> str | None:
        """Why no depth camera can be used; None if the library for it is there."""

    def membership(self, group: str) -> GroupMembership:
        """How this user and the group stand."""

    def now(self) -> datetime:
        """The clock."""

    def clock_error(self) -> float | None:
        """By how much the clock may be off, s, as the kernel believes; None: it is not synchronised."""

    def free_bytes(self) -> int:
        """What this user may still write to the disk with `here`."""

    def version_of(self, package: str) -> str | None:
        """Of an installed Python package; None if it is not."""

    def mode(self, path: Path) -> int:
        """Permission bits of a file. Raises OSError."""

    def certificate(self, path: Path) -> Certified:
        """What stands in a certificate file. Raises ValueError if it is none, or none can be read here."""

    def kernels(self) -> Kernels:
        """Compile those that are not yet."""

    def isolation_fault(self) -> str | None:
        """Why a robot's process cannot be shut off, in one sentence; None if it can."""
