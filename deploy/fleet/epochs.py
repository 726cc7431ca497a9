"""Counts a robot's epochs, the starts of its program, in a file of the clone: they never go back.

Versions on the air, terms of places and tags of frames are built on them. The file holds the last few epochs,
the newest first, each on a line with its checksum, and is replaced as a whole; what is left of a damaged
one still counts.
"""

import fcntl
import os
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import takewhile
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
_KEPT: Final = 4
"""Lines of the file: the newest epochs."""
_LONGEST: Final = 4096
"""Bytes of the file that are looked at; it has a twentieth of that unless somebody else has written it."""
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
    """Of a recording's first record; earlier versions had the set-up as a text. Their starts count, too."""

    setup: msgspec.Raw = msgspec.Raw()
    scenario: str = ""


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
                epoch, lines = self._next()
                self._write([_line(epoch), *lines][:_KEPT])
        except OSError as error:
            raise AcrcError(
                f"{self.file}: the starts of {self.robot} cannot be counted there ({error.strerror}); "
                "it must be a file that can be written, for without it the others would not hear the robot"
            ) from None
        return epoch

    def _next(self) -> tuple[int, list[bytes]]:
        """The next epoch, and the lines to keep behind its own: each is one less than the one before."""
        if not self.file.exists():
            return _checked(self._recorded() + 1, self.file), []
        with self.file.open("rb") as file:
            lines = file.read(_LONGEST).split(b"\n")
        whole = list(takewhile(lambda line: _epoch(line) is not None, lines))
        known = [epoch for line in lines if (epoch := _epoch(line)) is not None]
        if whole:
            return _checked(max(known) + 1, self.file), whole
        if known:  # at most the others have come after it
            return _checked(max(known) + _KEPT, self.file), []
        epoch = self._by_clock()
        self.say(
            f"{self.file} was damaged: it holds no epoch that can be read; "
            f"{self.robot} goes on with {epoch}, by the clock"
        )
        return epoch, []

    def _by_clock(self) -> int:
        now = int(self.clock())
        if now < _CLOCK_IS_SET:
            today = time.strftime("%Y-%m-%d", time.gmtime(now))
            raise AcrcError(
                f"{self.file}: holds no epoch that can be read, and the clock, at {today}, was never set, "
                f"so that nobody can tell how often {self.robot} has been started; set the clock, "
                "then start it again"
            )
        return _checked(max(now - _ZERO, self._recorded() + 1), self.file)

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

    def _write(self, lines: list[bytes]) -> None:
        """Replace the file; after a loss of power it is the old one or the new one."""
        fresh = self.file.with_suffix(".new")
        with fresh.open("wb") as out:
            out.write(b"".join(line + b"\n" for line in lines))
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
    return b"%b %08x" % (number, zlib.crc32(number))


def _epoch(line: bytes) -> int | None:
    """The epoch of a line; None if the line is damaged."""
    number, _, _ = line.partition(b" ")
    if not 0 < len(number) <= len(str(LAST_EPOCH)) or not number.isdigit():
        return None
    return int(number) if line == _line(int(number)) else None


def _checked(epoch: int, file: Path) -> int:
    if epoch > LAST_EPOCH:
        raise AcrcError(f"{file}: the next epoch would be {epoch}; there are {LAST_EPOCH} at most")
    return epoch


def _begun(path: Path) -> _Begun | None:
    """What a recording begins with; None if that is nothing of a robot's."""
    try:
        first = next(read_recording(path), None)
        if not isinstance(first, Note) or first.name != "run":
            return None
        run = msgspec.json.decode(first.json, type=_Run)
        return msgspec.json.decode(bytes(run.setup) or run.scenario, type=_Begun)
    except (RecordingError, OSError, ValueError):
        return None
