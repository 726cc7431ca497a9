"""A pseudo-terminal for an emulated device: to a driver it is a serial port."""

import errno
import os
import select
import termios
import tty
from pathlib import Path

from actors.runtime.errors import AcrcError


class PseudoTerminal:
    """The device's end of a line, and a symbolic link to the other; use it as a context manager.

    The other end stays open, so drivers may come and go. What nobody reads is lost and counted.
    """

    def __init__(self, link: Path) -> None:
        """Put the link at `link`, in place of one that is there already. Raises AcrcError."""
        self.link = link
        self.lost = 0
        """Bytes that nobody has read."""
        self._device, self._driver = os.openpty()
        try:
            tty.setraw(self._driver, termios.TCSANOW)
            os.set_blocking(self._device, False)
            self.port = os.ttyname(self._driver)
            _place(link, self.port)
        except BaseException:
            os.close(self._device)
            os.close(self._driver)
            raise

    def fileno(self) -> int:
        """The device's end; readable when the driver has written."""
        return self._device

    def read(self, patience: float) -> bytes:
        """What the driver has written; waits up to `patience` s for it."""
        ready, _, _ = select.select([self._device], [], [], max(patience, 0.0))
        if not ready:
            return b""
        try:
            return os.read(self._device, 4096)
        except OSError as error:
            if error.errno in {errno.EAGAIN, errno.EIO}:
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Send to the driver; what does not fit into the line's buffer is lost."""
        written = 0
        try:
            if data:
                written = os.write(self._device, data)
        except BlockingIOError:
            pass
        self.lost += len(data) - written

    def close(self) -> None:
        """Take the link away, if it is still ours, and hang up."""
        if self.link.is_symlink() and str(self.link.readlink()) == self.port:
            self.link.unlink()
        os.close(self._device)
        os.close(self._driver)

    def __enter__(self) -> "PseudoTerminal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _place(link: Path, port: str) -> None:
    if link.exists() and not link.is_symlink():
        raise AcrcError(f"{link}: there is something that is no link; give a path where a link can be made")
    try:
        link.unlink(missing_ok=True)
        link.symlink_to(port)
    except OSError as error:
        raise AcrcError(
            f"{link}: no link can be made there ({error.strerror}); give a path in a directory that is yours"
        ) from None
