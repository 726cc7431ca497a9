"""Serial ports, and a sentence for each way in which opening one fails."""

import errno
import importlib
import os
import select
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from actors.runtime.errors import AcrcError

_CHUNK: Final = 4096
"""The most bytes of one reading."""


class PortError(AcrcError):
    """A serial port that cannot be opened, or has gone."""


class UsbChip(NamedTuple):
    """What makes a serial port of a USB plug; four hexadecimal digits each, as the kernel gives them."""

    vendor: str
    product: str


FTDI: Final = UsbChip("0403", "6001")
CP2102: Final = UsbChip("10c4", "ea60")


@dataclass(frozen=True)
class PortDevice:
    """What hangs on a port, for sentences and udev rules."""

    name: str
    """As in "the Kobuki"."""
    symlink: str
    """The name that a udev rule gives its port."""
    baud: int
    chip: UsbChip
    lines_off: tuple[str, ...] = ()
    """Control lines that are switched off when the port is opened."""


KOBUKI: Final = PortDevice("Kobuki", "/dev/kobuki", 115_200, FTDI)
BOARD: Final = PortDevice("BEE-click board", "/dev/beeclick", 921_600, FTDI, ("dtr", "rts"))
"""The chip is that of the USB UART of the board that it sits on."""
RPLIDAR: Final = PortDevice("RPLIDAR", "/dev/rplidar", 115_200, CP2102, ("dtr",))
"""On the adapter of an A1 the motor turns while DTR is off."""


class SerialPort:
    """An open port, 8 data bits, no parity, 1 stop bit; a terminal that is no serial port will do, too.

    Reading never waits: wait for `fileno()` to be readable. Use it as a context manager.
    """

    def __init__(self, path: str, device: PortDevice) -> None:
        """Open `path`, for this process alone. Raises PortError."""
        self.path = path
        self._device = device
        self._port = _open(path, device)
        # Else USB adapters of FTDI keep bytes back for 16 ms; a terminal without that mode has no need of it.
        with suppress(ValueError, OSError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)
        for line in device.lines_off:
            with suppress(OSError):  # a pseudo-terminal has no such line
                setattr(self._port, line, False)

    def read(self) -> bytes:
        """Return what has come, at most 4096 bytes. Raises PortError when unplugged."""
        try:
            if not select.select([self.fileno()], [], [], 0.0)[0]:
                return b""
            data = os.read(self.fileno(), _CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, TypeError) as error:
            raise self._gone(error) from None
        if not data:  # readable, and yet nothing: hung up
            raise self._gone(EOFError("end of file"))
        return data

    def write(self, data: bytes) -> None:
        """Send. Raises PortError when unplugged."""
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:  # TypeError: pyserial's own, if the port is closed meanwhile
            raise self._gone(error) from None

    def fileno(self) -> int:
        """The file descriptor, to wait for."""
        number: int = self._port.fileno()
        return number

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _gone(self, error: Exception) -> PortError:
        return PortError(
            f"{self.path}: the {self._device.name} has gone while in use ({_reason(error)}); "
            "plug its USB cable in again"
        )


def _open(path: str, device: PortDevice) -> Any:
    try:
        serial = importlib.import_module("serial")
    except ModuleNotFoundError:
        raise PortError(
            f"{path}: the {device.name} cannot be reached without the Python package pyserial; "
            "install the extra hardware: pip install 'acrc-testbed[hardware]'"
        ) from None
    try:
        return serial.Serial(path, device.baud, timeout=0.0, write_timeout=1.0, exclusive=True)
    except (OSError, ValueError) as error:
        raise PortError(f"{path}: {_why(path, device, error)}") from None


def _why(path: str, device: PortDevice, error: Exception) -> str:
    """What is wrong, and what would help."""
    number = getattr(error, "errno", None)
    if number in {errno.ENOENT, errno.ENXIO, errno.ENODEV}:
        if path == device.symlink:
            return (
                f"there is no such port; plug in the {device.name} and switch it on, and if it has another "
                "name, as without a udev rule, give that, e.g. /dev/ttyUSB0"
            )
        return f"there is no such port; plug in the {device.name} and switch it on, or give its right port"
    if number in {errno.EACCES, errno.EPERM}:
        return (
            "this user may not open it; join its group with `sudo usermod -aG dialout $USER` and log in "
            "again, or give the port to everyone by a udev rule"
        )
    if number in {errno.EBUSY, errno.EAGAIN}:
        return f"another program has the port open; end it, as only one can talk to the {device.name}"
    if number in {errno.ENOTTY, errno.EISDIR, errno.EINVAL} or (number is None and Path(path).exists()):
        return f"this is no serial port; the {device.name} should be at {device.symlink} or e.g. /dev/ttyUSB0"
    return f"the port cannot be opened ({_reason(error)}); plug in the {device.name} again"


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    return errno.errorcode.get(number, str(number)) if number is not None else str(error)


class BoardPort(SerialPort):
    """An open port to a board, whose writing does not wait either."""

    def __init__(self, path: str) -> None:
        """Open `path`, for this process alone. Raises PortError."""
        super().__init__(path, BOARD)
        self._pending = b""
        os.set_blocking(self.fileno(), False)

    @property
    def is_idle(self) -> bool:
        """True if all that was written is with the system: only then `Link.due` is to be asked for more."""
        return not self._pending

    def write(self, data: bytes) -> None:
        """Send, as far as the system takes it; call again, also with nothing, until `is_idle`."""
        self._pending += data
        try:
            while self._pending:
                self._pending = self._pending[os.write(self.fileno(), self._pending) :]
        except BlockingIOError:
            return
        except (OSError, ValueError, TypeError) as error:
            raise self._gone(error) from None
