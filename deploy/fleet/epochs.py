"""Counts a robot's epochs, the starts of its program, in a file of the clone: they never go back.

Versions on the air, terms of places and tags of frames are built on them. The file holds the newest epoch
with its checksum and is replaced as a whole. If it is damaged, the count goes on by the clock, which is
ahead of it.
"""

import fcntl
import os
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Note, RecordingError, read_recording

STATE: Final = REPOSITORY / ".state"
"""Folder of the counters: one for a computer, whatever folders its runs are in."""
LAST_EPOCH: Final = 2**31 - 1
"""More have no room in the tags of frames (actors.robot.behaviour.node_host); with a start a second that
takes 68 years."""
_LONGEST: Final = 64
"""Bytes of the file that are read."""
_ZERO: Final = 1_577_836_800
"""2020-01-01 in Unix time, s: what epochs by the clock are counted from. Starts take longer than a second, so
that the clock is ahead of every counter."""
_CLOCK_IS_SET: Final = 1_767_225_600
"""2026-01-01: a clock that is behind it was never set."""


class _Begun(msgspec.Struct):
    """What a robot's first record says of it, as far as it is needed here."""

    id: str
    epoch: int


class _Run(msgspec.Struct, frozen=True):
    setup: _Begun


@dataclass(frozen=True)
class EpochCounter:
    """The epochs of one robot on this computer."""

    robot: str
    runs: Path
    """Folder of folders with recordings of earlier runs: asked where the counter itself does not know."""
    say: Callable[[str], None]
    """Is told, in a sentence, of a counter that was damaged."""
    state: Path = STATE
    clock: Callable[[], float] = field(default=time.time)
    """Unix time, s."""

    @property
    def file(self) -> Path:
        """Where the count stands."""
        return self.state / f"{self.robot}.epochs"

    def claim(self) -> int:
        """An epoch later than all before, which nobody gets again. Raises AcrcError."""
        try:
            with self._alone():
                epoch = self._next()
                if epoch > LAST_EPOCH:
                    raise AcrcError(
                        f"{self.file}: the next epoch would be {epoch}; there are {LAST_EPOCH} at most"
                    )
                self._write(epoch)
        except OSError as error:
            raise AcrcError(
                f"{self.file}: the starts of {self.robot} cannot be counted there ({error.strerror}); "
                "it must be a file that can be written, for without it the others would not hear the robot"
            ) from None
        return epoch

    def _next(self) -> int:
        if not self.file.exists():
            return self._recorded() + 1
        with self.file.open("rb") as file:
            line = file.read(_LONGEST)
        number, _, _ = line.partition(b" ")
        if number.isdigit() and line == _line(int(number)):
            return int(number) + 1
        epoch = self._by_clock()
        self.say(
            f"{self.file} was damaged: it holds no epoch that can be read; "
            f"{self.robot} goes on with {epoch}, by the clock"
        )
        return epoch

    def _by_clock(self) -> int:
        now = int(self.clock())
        if now < _CLOCK_IS_SET:
            today = time.strftime("%Y-%m-%d", time.gmtime(now))
            raise AcrcError(
                f"{self.file}: holds no epoch that can be read, and the clock, at {today}, was never set, "
                f"so that nobody can tell how often {self.robot} has been started; set the clock, "
                "then start it again"
            )
        return max(now - _ZERO, self._recorded() + 1)

    def _recorded(self) -> int:
        """The latest epoch of the robot's recordings; -1: there is none."""
        found = (_begun(path) for path in self.runs.glob(f"*/{self.robot}/*.mcap"))
        return max((one.epoch for one in found if one and one.id == self.robot), default=-1)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No other process counts meanwhile."""
        self.state.mkdir(parents=True, exist_ok=True)
        with (self.state / f"{self.robot}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _write(self, epoch: int) -> None:
        """Replace the file; after a loss of power it is the old one or the new one."""
        fresh = self.file.with_suffix(".new")
        with fresh.open("wb") as out:
            out.write(_line(epoch))
            out.flush()
            os.fsync(out.fileno())
        fresh.replace(self.file)
        folder = os.open(self.state, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _line(epoch: int) -> bytes:
    number = b"%d" % epoch
    return b"%b %08x\n" % (number, zlib.crc32(number))


def _begun(path: Path) -> _Begun | None:
    """Return what a recording's first record says; None if it is not a robot's."""
    try:
        first = next(read_recording(path), None)
        if isinstance(first, Note) and first.name == "run":
            return msgspec.json.decode(first.json, type=_Run).setup
    except (RecordingError, OSError, ValueError):
        pass
    return None
