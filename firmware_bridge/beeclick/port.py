"""The serial port of a board, read and written without waiting."""

import os
import select
from contextlib import suppress
from typing import Final

from firmware_bridge.serial_port import BOARD, SerialPort

_CHUNK: Final = 4096
"""The most bytes of one reading: 44 ms of the line."""


class BoardPort(SerialPort):
    """An open port to a board, 921 600 baud, DTR and RTS off; a terminal that is no serial port will do, too.

    Whoever waits for several things at once waits for `fileno()` to be readable.
    """

    def __init__(self, path: str) -> None:
        """Open `path`, for us alone. Raises PortError, with what would help."""
        super().__init__(path, BOARD, patience=0.0)
        self.set_dtr(False)
        with suppress(OSError):  # a pseudo-terminal has no such line
            self._port.rts = False
        self._pending = b""
        os.set_blocking(self.fileno(), False)

    @property
    def is_idle(self) -> bool:
        """True if all that was written is with the system: only then `Link.due` is to be asked for more."""
        return not self._pending

    def read(self) -> bytes:
        """What has come, at most 4096 bytes; nothing if nothing has. Raises PortError when unplugged."""
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
        """Send, as far as the system takes it; call again, also with nothing, until `is_idle`.

        Raises PortError when unplugged.
        """
        self._pending += data
        try:
            while self._pending:
                self._pending = self._pending[os.write(self.fileno(), self._pending) :]
        except BlockingIOError:
            return
        except (OSError, ValueError, TypeError) as error:
            raise self._gone(error) from None
