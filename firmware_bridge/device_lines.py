"""Serial lines of emulated devices: pseudo-terminals that can be unplugged and can corrupt bytes."""

import errno
import os
import select
import termios
import tty
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.random import Generator

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


@dataclass(frozen=True)
class Disturbance:
    """Per byte, the probability that something happens to it."""

    change: float = 0.0
    """Another byte comes in its place."""
    drop: float = 0.0
    """It is missing."""
    insert: float = 0.0
    """A byte comes in front of it."""

    def apply(self, data: bytes, rng: np.random.Generator) -> bytes:
        """What comes of `data`."""
        if not data or not (self.change or self.drop or self.insert):
            return data
        chances = rng.random(len(data))
        noise = rng.integers(0, 256, len(data))
        out = bytearray()
        for byte, chance, other in zip(data, chances.tolist(), noise.tolist(), strict=True):
            if chance < self.change:
                out.append(other)
            elif chance < self.change + self.drop:
                continue
            elif chance < self.change + self.drop + self.insert:
                out += bytes((other, byte))
            else:
                out.append(byte)
        return bytes(out)


CLEAN = Disturbance()
"""A line as it should be."""


BASE: Final = "base"
RADIO: Final = "radio"
RANGE: Final = "range"
DEVICES: Final = (BASE, RADIO, RANGE)


class Jack(NamedTuple):
    """Where a device is plugged in."""

    robot: str
    device: str
    """One of DEVICES."""


class Lines:
    """A line for each jack, at FOLDER/<robot>/<device>; a context manager that leaves nothing behind.

    An unplugged line has no path, and its host sees it hang up; its device goes on, as on a battery.
    """

    def __init__(self, folder: Path, jacks: Iterable[Jack], generator: Generator) -> None:
        """`generator`: for what happens to bytes on a scrambled line."""
        self.jacks = tuple(jacks)
        self._folder = folder
        self._generator = generator
        self._disturbance = dict.fromkeys(self.jacks, CLEAN)
        self._plugged: dict[Jack, PseudoTerminal] = {}
        self._made: list[Path] = []
        self._unread: Counter[Jack] = Counter()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self.close)
            self._make(self._folder)
            for jack in self.jacks:
                self._make(self.path(jack).parent)
                self.plug(jack)
            stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def descriptors(self) -> dict[int, Jack]:
        """What to wait for."""
        return {line.fileno(): jack for jack, line in self._plugged.items()}

    def path(self, jack: Jack) -> Path:
        """Where a host opens it, while it is plugged in."""
        return self._folder / jack.robot / jack.device

    def read(self, jack: Jack) -> bytes:
        """What a host has written, if anything."""
        line = self._plugged.get(jack)
        if line is None:
            return b""
        return self._disturbance[jack].apply(line.read(0.0), self._generator)

    def send(self, jack: Jack, data: bytes) -> None:
        """Send to a host; never waits."""
        line = self._plugged.get(jack)
        if data and line is not None:
            line.write(self._disturbance[jack].apply(data, self._generator))

    def unread(self, jack: Jack) -> int:
        """Bytes so far that no host has read in time."""
        line = self._plugged.get(jack)
        return self._unread[jack] + (line.lost if line is not None else 0)

    def is_plugged(self, jack: Jack) -> bool:
        """True if a host can open it."""
        return jack in self._plugged

    def plug(self, jack: Jack) -> None:
        """Put the cable in. Raises AcrcError."""
        self._plugged[jack] = PseudoTerminal(self.path(jack))

    def unplug(self, jack: Jack) -> None:
        """Pull the cable."""
        line = self._plugged.pop(jack)
        self._unread[jack] += line.lost
        line.close()

    def scramble(self, jack: Jack, share: float) -> None:
        """From now on replace, lose or double so many of the bytes, in both directions."""
        self._disturbance[jack] = Disturbance(share / 3, share / 3, share / 3)

    def close(self) -> None:
        """Hang up everywhere, and take away links, and folders that were not there."""
        for jack in list(self._plugged):
            self.unplug(jack)
        while self._made:
            with suppress(OSError):  # somebody else has put something there
                self._made.pop().rmdir()

    def _make(self, folder: Path) -> None:
        if folder.is_dir():
            return
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise AcrcError(
                f"{folder}: no folder for links can be made there ({error.strerror}); "
                "give one in a directory that is yours"
            ) from None
        self._made.append(folder)
