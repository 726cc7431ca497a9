"""An emulated Kobuki on a pseudo-terminal, that lives in wall time in a thread."""

import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from actors.instant import Instant
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.kobuki.base import EmulatedKobuki
from tests.kobuki.room import Room, Unicycle


class KobukiLine:
    """Use it as a context manager; `base.faults` may be set at any time."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.body = Unicycle(room=Room(40.0, 40.0))
        self.base = EmulatedKobuki(self.body, np.random.default_rng(1))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._line = PseudoTerminal(self.link)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._line.close()

    @property
    def speed(self) -> float:
        """Of the body, m/s."""
        return self.body.truth().v

    def standing_after(self, patience_s: float) -> float:
        """How long it took from now until it stood, s; AssertionError if that is longer."""
        begun = time.monotonic()
        while self.speed:
            assert time.monotonic() - begun < patience_s, f"still at {self.speed} m/s after {patience_s} s"
            time.sleep(0.002)
        return time.monotonic() - begun

    def _run(self) -> None:
        begun = time.monotonic()
        while not self._ended.is_set():
            data = self._line.read(0.002)
            now = Instant(round(1e6 * (time.monotonic() - begun)))
            self.base.take(now, data)
            self._line.write(self.base.run(now))
