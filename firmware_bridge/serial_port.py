"""Serial ports, with an error message for each cause of failure, and reports of failures."""

import errno
import importlib
import os
import select
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from actors.runtime.errors import AcrcError

_CHUNK: Final = 4096
"""Maximum bytes per read."""


Say = Callable[[str], None]
"""Writes a log line; does not block on the disk."""


def changed_only(say: Say) -> Say:
    """Return a function that passes on sentences that differ from the previous one, and no empty one."""
    last = ""

    def report(sentence: str) -> None:
        nonlocal last
        if sentence and sentence != last:
            say(sentence)
        last = sentence

    return report


class PortError(AcrcError):
    """Failure to open a serial port, or its loss."""


class UsbChip(NamedTuple):
    """Vendor and product ID of a USB-serial chip, four hexadecimal digits each."""

    vendor: str
    product: str


FTDI: Final = UsbChip("0403", "6001")
CP2102: Final = UsbChip("10c4", "ea60")


@dataclass(frozen=True)
class PortDevice:
    """A device with a serial port, for error messages and udev rules."""

    name: str
    """Name in messages, such as "Kobuki"."""
    symlink: str
    """Port name assigned by the udev rule."""
    baud: int
    chip: UsbChip
    lines_off: tuple[str, ...] = ()
    """Control lines switched off when the port is opened."""


KOBUKI: Final = PortDevice("Kobuki", "/dev/kobuki", 115_200, FTDI)
BOARD: Final = PortDevice("BEE-click board", "/dev/beeclick", 921_600, FTDI, ("dtr", "rts"))
"""The chip is the USB UART of the carrier board."""
RPLIDAR: Final = PortDevice("RPLIDAR", "/dev/rplidar", 115_200, CP2102, ("dtr",))
"""On the adapter of an A1, the motor runs while DTR is off."""


class SerialPort:
    """An open port (8 data bits, no parity, 1 stop bit) or other terminal.

    Reads do not block: wait for `fileno()` to be readable.
    """

    def __init__(self, path: str, device: PortDevice) -> None:
        """Open `path` exclusively. Raises PortError."""
        self.path = path
        self._device = device
        self._port = _open(path, device)
        # FTDI adapters buffer bytes for 16 ms otherwise; other terminals do not support the mode.
        with suppress(ValueError, OSError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)
        for line in device.lines_off:
            with suppress(OSError):  # not supported by pseudo-terminals
                setattr(self._port, line, False)

    def read(self) -> bytes:
        """Return received bytes, at most 4096. Raises PortError when unplugged."""
        try:
            if not select.select([self.fileno()], [], [], 0.0)[0]:
                return b""
            data = os.read(self.fileno(), _CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, TypeError) as error:
            raise self._gone(error) from None
        if not data:  # readable without data: hangup
            raise self._gone(EOFError("end of file"))
        return data

    def write(self, data: bytes) -> None:
        """Write bytes. Raises PortError when unplugged."""
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:  # TypeError: from pyserial, if the port was closed
            raise self._gone(error) from None

    def fileno(self) -> int:
        """Return the file descriptor."""
        return int(self._port.fileno())

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _gone(self, error: Exception) -> PortError:
        return PortError(
            f"{self.path}: connection to the {self._device.name} lost ({_reason(error)}); check its USB cable"
        )


def _open(path: str, device: PortDevice) -> Any:
    try:
        serial = importlib.import_module("serial")
    except ModuleNotFoundError:
        raise PortError(
            f"{path}: the {device.name} needs the Python package pyserial; "
            "install it with pip install 'acrc-testbed[hardware]'"
        ) from None
    try:
        return serial.Serial(path, device.baud, timeout=0.0, write_timeout=1.0, exclusive=True)
    except (OSError, ValueError) as error:
        raise PortError(f"{path}: {_why(path, device, error)}") from None


def _why(path: str, device: PortDevice, error: Exception) -> str:
    """Return cause and remedy of a failure to open a port."""
    number = getattr(error, "errno", None)
    if number in {errno.ENOENT, errno.ENXIO, errno.ENODEV}:
        if path == device.symlink:
            return (
                f"no such port; plug in the {device.name} and switch it on, or, without a udev rule, give "
                "its kernel name, e.g. /dev/ttyUSB0"
            )
        return f"no such port; plug in the {device.name} and switch it on, or give the correct port"
    if number in {errno.EACCES, errno.EPERM}:
        return (
            "permission denied; join the port's group with `sudo usermod -aG dialout $USER` and log in "
            "again, or allow access by a udev rule"
        )
    if number in {errno.EBUSY, errno.EAGAIN}:
        return f"in use by another program; stop it, as the {device.name} allows only one connection"
    if number in {errno.ENOTTY, errno.EISDIR, errno.EINVAL} or (number is None and Path(path).exists()):
        return f"not a serial port; give the port of the {device.name}: {device.symlink} or e.g. /dev/ttyUSB0"
    return f"the port cannot be opened ({_reason(error)}); replug the {device.name}"


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    return errno.errorcode.get(number, str(number)) if number is not None else str(error)


class BoardPort(SerialPort):
    """An open port to a board, with non-blocking writes."""

    def __init__(self, path: str) -> None:
        """Open `path` exclusively. Raises PortError."""
        super().__init__(path, BOARD)
        self._pending = b""
        os.set_blocking(self.fileno(), False)

    @property
    def is_idle(self) -> bool:
        """True if all bytes have been written; only then call `BoardLink.due`."""
        return not self._pending

    def write(self, data: bytes) -> None:
        """Write without blocking; call again, also with no bytes, until `is_idle`."""
        self._pending += data
        try:
            while self._pending:
                self._pending = self._pending[os.write(self.fileno(), self._pending) :]
        except BlockingIOError:
            return
        except (OSError, ValueError, TypeError) as error:
            raise self._gone(error) from None
