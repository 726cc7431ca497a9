"""The serial ports of this computer that are USB devices, as the kernel shows them in /sys."""

from pathlib import Path
from typing import NamedTuple

from firmware_bridge.serial_port import BOARD, KOBUKI, PortDevice

_TERMINALS = Path("/sys/class/tty")
_KEYS = ("idVendor", "idProduct", "serial")


class UsbPort(NamedTuple):
    """A serial port that is a USB device."""

    path: str
    """The kernel's name, such as /dev/ttyUSB0."""
    vendor: str
    """Four hexadecimal digits."""
    product: str
    serial: str
    """Empty if it has none."""
    socket: str = ""
    """Where it is plugged in, such as 1-1.3: bus, and port of each hub on the way."""


def usb_port(path: str) -> UsbPort | None:
    """The port of that name, links followed; None if it is no USB device, or there is none."""
    name = Path(path).resolve().name
    folder = (_TERMINALS / name / "device").resolve()
    for parent in (folder, *folder.parents):
        if (parent / "idVendor").is_file():
            vendor, product, serial = (_attribute(parent, key) for key in _KEYS)
            return UsbPort(f"/dev/{name}", vendor, product, serial, parent.name)
    return None


def usb_ports() -> list[UsbPort]:
    """All of them, by name."""
    names = sorted(path.name for path in _TERMINALS.iterdir()) if _TERMINALS.is_dir() else []
    found = (usb_port(f"/dev/{name}") for name in names)
    return [port for port in found if port is not None]


def is_kobuki(port: UsbPort) -> bool:
    """True for the chip in a Kobuki, which says so in its serial number."""
    return port.serial.startswith("kobuki")


def may_be(device: PortDevice, port: UsbPort) -> bool:
    """True if the device could be behind the port, by its chip."""
    if (port.vendor, port.product) != device.chip:
        return False
    return device not in {KOBUKI, BOARD} or is_kobuki(port) is (device is KOBUKI)


def _attribute(device: Path, key: str) -> str:
    try:
        return (device / key).read_text().strip()
    except OSError:
        return ""
