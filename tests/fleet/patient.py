"""A computer of which everything can be set."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from deploy.fleet.doctor import Certified, GroupMembership, Kernels, Machine
from deploy.fleet.units import UsbPort
from firmware_bridge.serial_port import PortDevice
from tests.fleet.texts import BOARD_AT_1, KOBUKI_AT_0, LIDAR_AT_2


@dataclass(frozen=True)
class Patient(Machine):
    """By default nothing is wrong."""

    user: str = "robot"
    here: Path = Path("/home/robot")
    python: tuple[int, int] = (3, 11)
    names: Mapping[str, UsbPort | None] = field(
        default_factory=lambda: {
            "/dev/kobuki": KOBUKI_AT_0,
            "/dev/beeclick": BOARD_AT_1,
            "/dev/rplidar": LIDAR_AT_2,
        }
    )
    """What there is; None: no USB device."""
    plugged: tuple[UsbPort, ...] = (KOBUKI_AT_0, BOARD_AT_1, LIDAR_AT_2)
    held: Mapping[str, list[str]] = field(default_factory=dict)
    port_faults: Mapping[str, str] = field(default_factory=dict)
    camera: str | None = None
    group: GroupMembership = field(default=GroupMembership(exists=True, listed=True, in_force=True))
    time: datetime = datetime(2030, 5, 1, 12, tzinfo=UTC)
    error: float | None = 0.012
    free: int = 20_000_000_000
    versions: Mapping[str, str] = field(default_factory=dict)
    certified: Certified | None = None
    key_mode: int = 0o600
    kernel_state: Kernels = field(default=Kernels(Path("/clone/actors/__pycache__/kernels-1"), True, 0.4, 0))
    isolation: str | None = None

    def but(self, **changes: object) -> "Patient":
        """The same with something else."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def exists(self, path: str) -> bool:
        return path in self.names

    def usb_port(self, path: str) -> UsbPort | None:
        return self.names.get(path)

    def usb_ports(self) -> list[UsbPort]:
        return list(self.plugged)

    def holders(self, path: str) -> list[str]:
        return self.held.get(path, [])

    def port_fault(self, path: str, device: PortDevice) -> str | None:
        return self.port_faults.get(path)

    def camera_fault(self) -> str | None:
        return self.camera

    def membership(self, group: str) -> GroupMembership:
        assert group == "dialout"
        return self.group

    def now(self) -> datetime:
        return self.time

    def clock_error(self) -> float | None:
        return self.error

    def free_bytes(self) -> int:
        return self.free

    def version_of(self, package: str) -> str | None:
        return self.versions.get(package)

    def mode(self, path: Path) -> int:
        return self.key_mode

    def certificate(self, path: Path) -> Certified:
        if self.certified is None:
            raise ValueError("no certificate")
        return self.certified

    def kernels(self) -> Kernels:
        return self.kernel_state

    def isolation_fault(self) -> str | None:
        return self.isolation
