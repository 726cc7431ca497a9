"""A simulated computer with adjustable properties, for the checks of `acrc fleet doctor`."""

import getpass
import grp
import os
import pwd
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from actors.runtime.errors import AcrcError
from actors.runtime.isolation import sandbox
from deploy.fleet import doctor, units
from deploy.fleet.units import UsbPort
from firmware_bridge.range_sensors.depth import CameraError
from firmware_bridge.serial_port import PortDevice
from tests.fleet.fleet_texts import BOARD_AT_1, KOBUKI_AT_0, LIDAR_AT_2

CACHE = Path("/clone/actors/__pycache__/kernels-1")
DIALOUT = 20


@dataclass(frozen=True)
class SimulatedComputer:
    """State of the simulated computer; by default without faults."""

    names: Mapping[str, UsbPort | None] = field(
        default_factory=lambda: {
            "/dev/kobuki": KOBUKI_AT_0,
            "/dev/beeclick": BOARD_AT_1,
            "/dev/rplidar": LIDAR_AT_2,
        }
    )
    """USB port by path; None: not a USB device."""
    plugged: tuple[UsbPort, ...] = (KOBUKI_AT_0, BOARD_AT_1, LIDAR_AT_2)
    held: Mapping[str, list[str]] = field(default_factory=dict)
    port_faults: Mapping[str, str] = field(default_factory=dict)
    camera: str | None = None
    has_group: bool = True
    listed: bool = True
    groups: tuple[int, ...] = (DIALOUT,)
    time: datetime = datetime(2030, 5, 1, 12, tzinfo=UTC)
    error: float | None = 0.012
    free: int = 20_000_000_000
    versions: Mapping[str, str] = field(default_factory=dict)
    certified: tuple[str, datetime, datetime] | None = None
    keeps_kernels: bool = True
    compiled: tuple[float, int] = (0.4, 0)
    isolation: str | None = None

    def install(self, patch: pytest.MonkeyPatch) -> None:
        """Patch the checks to see this computer."""
        for module, name, value in (
            (units, "usb_port", self.names.get),
            (units, "usb_ports", lambda: list(self.plugged)),
            (doctor, "processes_using", lambda path: self.held.get(path, [])),
            (doctor, "SerialPort", self._opened),
            (doctor, "find_library", self._library),
            (doctor, "now", lambda: self.time),
            (doctor, "clock_error", lambda: self.error),
            (doctor, "version_of", self.versions.get),
            (doctor, "read_certificate", self._certificate),
            (doctor, "compiled_kernels", lambda: self.compiled),
            (doctor, "cache_folder", lambda: CACHE),
            (sandbox, "isolation_fault", lambda: self.isolation),
            (shutil, "disk_usage", lambda path: SimpleNamespace(free=self.free)),
            (grp, "getgrnam", self._group),
            (pwd, "getpwnam", lambda name: SimpleNamespace(pw_gid=1000)),
            (getpass, "getuser", lambda: "robot"),
            (os, "access", self._access),
            (os, "geteuid", lambda: 1000),
            (os, "getegid", lambda: 1000),
            (os, "getgroups", lambda: list(self.groups)),
        ):
            patch.setattr(module, name, value)

    def _opened(self, path: str, device: PortDevice) -> SimpleNamespace:
        if path in self.port_faults:
            raise AcrcError(self.port_faults[path])
        return SimpleNamespace(close=lambda: None)

    def _library(self) -> None:
        if self.camera:
            raise CameraError(self.camera)

    def _group(self, name: str) -> SimpleNamespace:
        if not self.has_group:
            raise KeyError(name)
        return SimpleNamespace(gr_gid=DIALOUT, gr_mem=["robot"] if self.listed else [])

    def _access(self, path: object, mode: int) -> bool:
        return str(path) in self.names if mode == os.F_OK else self.keeps_kernels

    def _certificate(self, path: Path) -> tuple[str, datetime, datetime]:
        if self.certified is None:
            raise ValueError("no certificate")
        return self.certified
