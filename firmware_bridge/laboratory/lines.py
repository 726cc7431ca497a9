"""The lines between a laboratory's devices and their hosts: pseudo-terminals that come and go."""

from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from numpy.random import Generator

from actors.runtime.errors import AcrcError
from firmware_bridge.beeclick.emulation.line import CLEAN, Disturbance
from firmware_bridge.laboratory.laboratory import Jack
from firmware_bridge.pseudo_terminal import PseudoTerminal


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
