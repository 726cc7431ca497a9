"""The keys of a run as recorded: which there are, and every message on each, also while the run goes on.

Only files are read, which is why nobody needs credentials of the mesh.
"""

import heapq
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from enum import Enum
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final, NamedTuple, Self

from mcap.writer import MCAP0_MAGIC

from acrc_testbed.recordings.run_recordings import recordings
from actors.instant import Instant, in_seconds
from actors.messages import BOARD, CONTROL, ROSTER
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.process import RunNote
from actors.runtime.recording import Direction, Entry, Note, Reading, decoded
from actors.runtime.recording.reading import opened
from actors.runtime.replay_bus import topic_of
from actors.topic import Message, Topic

_POLL_S: Final = 0.1
_HASH: Final = 40
"""Bytes of a message of which only the hash was kept."""
_WITHOUT_STEP: Final = frozenset({CONTROL.pattern, BOARD.pattern})
_UNTAKEN: Final = frozenset({ROSTER.pattern, BOARD.pattern})
"""Keys whose receivers record nothing."""


def _is_from_sender(key: str) -> bool:
    """Return True for keys whose messages are taken from the sender's recording, as no receiver has them."""
    return key in _UNTAKEN or topic_of(key).is_recorded_only


class TopicError(AcrcError):
    """A key that nothing was recorded on, or a field that its messages have not."""


class Recorded(NamedTuple):
    """One message as a recording has it."""

    step: int
    """The message's own; of what has none, such as an order, that in which it was taken."""
    instant: Instant
    """When that step began."""
    key: str
    direction: Direction
    sequence: int
    """Counts the messages of the key in its recording."""
    payload: bytes | None
    """None where only its hash was kept."""
    sha256: bytes
    """Of the message's bytes."""
    size: int
    """Bytes in the recording."""

    @property
    def topic(self) -> Topic[Message]:
        """The family of its key."""
        return topic_of(self.key)

    def message(self) -> Message | None:
        """What it says; None where only its hash was kept. Raises WireError for what is no such message."""
        return None if self.payload is None else decode(self.topic, self.key, self.payload)


def short(key: str) -> str:
    """A key without what all have in common: `r1/drive`, `truth`."""
    return key.removeprefix("swarm/up/").removeprefix("swarm/down/").removeprefix("swarm/infra/")


def fits(key: str, wanted: str) -> bool:
    """True if a key is the wanted one, in full or in short; `*` stands for any part: `*/drive`."""
    return fnmatchcase(key, wanted) or fnmatchcase(short(key), wanted)


def files(target: Path) -> dict[str, Path]:
    """The recordings by actor: of a run's folder, also of one that is going on, or the one that is named."""
    if not target.is_file():
        return recordings(target)
    return {target.stem: target}


def messages(target: Path, wanted: str) -> Iterator[Recorded]:
    """Every message on the keys that fit, once each, in the order of the instants.

    As its receiver has it: who sends a large one keeps its hash only. Raises RecordingError, and TopicError
    where nothing was recorded on such a key.
    """
    return follow(target, [wanted], lambda: True)


def follow(target: Path, wanted: Sequence[str], ended: Callable[[], bool]) -> Iterator[Recorded]:
    """The same, and then what is added, until `ended` says that nothing more will be."""
    alone, found = target.is_file(), False
    readers: dict[Path, Growing] = {}
    with ExitStack() as stack:
        while True:
            last = ended()
            for path in files(target).values():
                if path not in readers:
                    readers[path] = stack.enter_context(Growing(path))
            for one in heapq.merge(*(_of(each, wanted, alone) for each in readers.values()), key=_order):
                found = True
                yield one
            if last:
                break
            time.sleep(_POLL_S)
    if not found:
        raise TopicError(
            f"{target}: nothing was recorded on {', '.join(map(repr, wanted))}; it should be a key that "
            f"`acrc record info {target} '*'` shows"
        )


def within(recorded: Iterable[Recorded], begin: float, end: float | None) -> Iterator[Recorded]:
    """Those of them between two simulated seconds, both included; None: to the end."""
    for one in recorded:
        if begin <= in_seconds(one.instant) and (end is None or in_seconds(one.instant) <= end):
            yield one


def has_ended(target: Path) -> bool:
    """True once nothing will be added: there is the run's result, or all recordings were closed."""
    if (target / "run.json").is_file():
        return True
    return all(is_closed(path) for path in files(target).values())


class Growing:
    """A recording that may be written to meanwhile; a context manager that closes the file."""

    def __init__(self, path: Path) -> None:
        self.reading = Reading(path)
        self._stream = opened(path)
        self.run: RunNote | None = None
        """What the process was started with; None: it has not been read yet."""
        self._step = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def poll(self) -> Iterator[Recorded]:
        """What has been sealed since the last call; to be read to its end. Raises RecordingError."""
        for item in self.reading.more(self._stream):
            if isinstance(item, Note):
                if item.name == "run":
                    self.run = decoded(self.reading.path, "run", item.json, RunNote)
            else:
                yield self._recorded(item)

    def _recorded(self, entry: Entry) -> Recorded:
        step = entry.step
        if entry.key in _WITHOUT_STEP:
            step = self._step + 1  # it was taken at the boundary
        elif not entry.key.endswith("/ready"):
            self._step = max(step, self._step)
        size = _HASH if entry.payload is None else len(entry.payload)
        instant = Instant(step * (0 if self.run is None else self.run.step_us))
        return Recorded(
            step=step,
            instant=instant,
            key=entry.key,
            direction=entry.direction,
            sequence=entry.sequence,
            payload=entry.payload,
            sha256=entry.sha256,
            size=size,
        )


def _of(growing: Growing, wanted: Sequence[str], alone: bool) -> Iterator[Recorded]:
    """What counts of one file: all where there is no other, else what came in, or what nobody takes down."""
    for one in growing.poll():
        if any(fits(one.key, name) for name in wanted) and (
            alone or (one.direction == "out") == _is_from_sender(one.key)
        ):
            yield one


def _order(one: Recorded) -> int:
    return one.step


def is_closed(path: Path) -> bool:
    """True if the process that wrote a recording has ended in order."""
    with opened(path) as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC


class Standing(Enum):
    """How a run stands."""

    ENDED = "ended"
    """World and radio have closed their recordings, or there is a result."""
    GOING_ON = "going on"
    DIED = "died"
    """They have not, and nobody writes to them any more."""


def standing(out: Path) -> Standing:
    """How the run in a folder stands. RecordingError if there is no recording in it.

    On systems other than Linux, and of somebody else's processes, nobody can be seen to write: then a run
    that has not ended is held to go on.
    """
    files = recordings(out)
    conducting = [path for actor, path in files.items() if actor in ("world", "radio")]
    if (out / "run.json").is_file() or not conducting or all(is_closed(path) for path in conducting):
        return Standing.ENDED
    return Standing.GOING_ON if _written(conducting) else Standing.DIED


def so_far(out: Path, end: float) -> str:
    """Until when a run without a result is known, s, and why no further: a title, or the end of one."""
    return f"up to {end:g} s: it is going on" if goes_on(out) else f"cut off after {end:g} s"


def goes_on(out: Path) -> bool:
    """Whether a run of which no result was read goes on, or has gone on until just now: it has one since."""
    return standing(out) is Standing.GOING_ON or (out / "run.json").is_file()


def drawn_until(out: Path, end: float) -> str:
    """What is said while a run without a result is drawn, until a second."""
    how = "is going on" if goes_on(out) else "has died without a result"
    return f"the run {how}: it is drawn as far as it was recorded, up to {end:g} s"


def _written(files: list[Path]) -> bool:
    """True if a process of this user has one of the files open, or that cannot be told."""
    if sys.platform != "linux" or files[0].stat().st_uid != os.getuid():
        return True
    wanted = {(there.st_dev, there.st_ino) for there in (path.stat() for path in files)}
    return any(_has_open(process, wanted) for process in Path("/proc").glob("[0-9]*/fd"))


def _has_open(descriptors: Path, wanted: set[tuple[int, int]]) -> bool:
    if descriptors.parent.name == str(os.getpid()):
        return False  # it reads
    try:
        for link in descriptors.iterdir():
            there = link.stat()
            if (there.st_dev, there.st_ino) in wanted and _writes(descriptors.parent / "fdinfo" / link.name):
                return True
    except OSError:  # it has ended, or is somebody else's
        return False
    return False


def _writes(info: Path) -> bool:
    """By the flags with which the file was opened (proc_pid_fdinfo(5))."""
    flags = next(line for line in info.read_text().splitlines() if line.startswith("flags:"))
    return bool(int(flags.split()[1], 8) & os.O_ACCMODE)
