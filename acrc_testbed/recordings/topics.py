"""Recorded messages by key, also of a run in progress. Only files are read; no credentials are needed."""

import heapq
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from enum import Enum
from fnmatch import fnmatchcase
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from mcap.writer import MCAP0_MAGIC

from acrc_testbed.recordings.run_recordings import recordings
from actors.instant import Instant, in_seconds
from actors.messages import BOARD, CONTROL, RECEIVED, ROSTER
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.process import RunNote
from actors.runtime.recording import Direction, Entry, Note, RecordingReader, decode_note
from actors.runtime.recording.reader import open_recording
from actors.runtime.replay_bus import topic_of
from actors.topic import Message, Topic

_POLL_S: Final = 0.1
_HASH_SIZE: Final = 40
"""Recorded bytes of a message of which only the hash was kept."""
_WITHOUT_STEP: Final = frozenset({CONTROL.pattern, BOARD.pattern})
_NOT_RECORDED_BY_RECEIVERS: Final = frozenset({ROSTER.pattern, BOARD.pattern})
"""Keys whose receivers do not record."""


def _is_from_sender(key: str) -> bool:
    """Return True for keys that are read from the sender's recording, as no receiver records them."""
    return key in _NOT_RECORDED_BY_RECEIVERS or topic_of(key).is_recorded_only


class TopicError(AcrcError):
    """A key without recorded messages, or an unknown field."""


class LoggedMessage(NamedTuple):
    """One recorded message."""

    step: int
    """Step of the message; without one, as for an order, the step in which it was processed."""
    instant: Instant
    """Start of that step."""
    key: str
    direction: Direction
    sequence: int
    """Number of the message on its key, from 0."""
    payload: bytes | None
    """None: only the hash was recorded."""
    sha256: bytes
    """Hash of the message's bytes."""
    size: int
    """Size in the recording, bytes."""

    @property
    def topic(self) -> Topic[Message]:
        """Topic of the key."""
        return topic_of(self.key)

    def message(self) -> Message | None:
        """Decode the message; None: only its hash was recorded. Raises WireError for an invalid one."""
        return None if self.payload is None else decode(self.topic, self.key, self.payload)


def short_key(key: str) -> str:
    """Return a key without the common prefix, such as `r1/drive` or `truth`."""
    return key.removeprefix("swarm/up/").removeprefix("swarm/down/").removeprefix("swarm/infra/")


def matches(key: str, pattern: str) -> bool:
    """Return True if a key, in full or short, matches a pattern such as `*/drive`."""
    return fnmatchcase(key, pattern) or fnmatchcase(short_key(key), pattern)


def recording_files(target: Path) -> dict[str, Path]:
    """Return recordings by actor: those of a run's folder, or the given file."""
    if not target.is_file():
        return recordings(target)
    return {target.stem: target}


def messages(target: Path, pattern: str) -> Iterator[LoggedMessage]:
    """Yield every message on the matching keys once, in order of time.

    Messages come from the receiver's recording, as senders record only the hash of a large one. Raises
    RecordingError, and TopicError if there is no such message.
    """
    return follow(target, [pattern], lambda: True)


def follow(target: Path, patterns: Sequence[str], ended: Callable[[], bool]) -> Iterator[LoggedMessage]:
    """Yield messages as `messages` does, then new ones until `ended` returns True."""
    is_single, found = target.is_file(), False
    readers: dict[Path, GrowingRecording] = {}
    with ExitStack() as stack:
        while True:
            last = ended()
            for path in recording_files(target).values():
                if path not in readers:
                    readers[path] = stack.enter_context(GrowingRecording(path))
            for one in heapq.merge(
                *(_matching(each, patterns, is_single) for each in readers.values()), key=attrgetter("step")
            ):
                found = True
                yield one
            if last:
                break
            time.sleep(_POLL_S)
    if not found:
        raise TopicError(
            f"{target}: no messages on {', '.join(map(repr, patterns))}; "
            f"`acrc record info {target} '*'` lists the keys"
        )


def within(recorded: Iterable[LoggedMessage], begin: float, end: float | None) -> Iterator[LoggedMessage]:
    """Yield the messages from `begin` to `end`, simulated s, both included; None: to the end.

    A message of radio events also counts if one of its events is in the interval.
    """
    last = float("inf") if end is None else end
    for one in recorded:
        events = getattr(one.message(), "events", ()) if one.topic is RECEIVED else ()
        if any(begin <= in_seconds(at.instant) <= last for at in (one, *events)):
            yield one


def has_ended(target: Path) -> bool:
    """Return True if the run has a result, or all recordings were closed."""
    if (target / "run.json").is_file():
        return True
    return all(is_closed(path) for path in recording_files(target).values())


class GrowingRecording:
    """A recording that may still be written; a context manager that closes the file."""

    def __init__(self, path: Path, **options: Any) -> None:
        """`options`: of the RecordingReader."""
        self.reading = RecordingReader(path, **options)
        self._stream = open_recording(path)
        self.run: RunNote | None = None
        """First record of the process; None: not read yet."""
        self._step = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def poll(self) -> Iterator[LoggedMessage]:
        """Yield the messages completed since the last call; read it to the end. Raises RecordingError."""
        for item in self.reading.read_new(self._stream):
            if isinstance(item, Note):
                if item.name == "run":
                    self.run = decode_note(self.reading.path, "run", item.json, RunNote)
            else:
                yield self._recorded(item)

    def _recorded(self, entry: Entry) -> LoggedMessage:
        step = entry.step
        if entry.key in _WITHOUT_STEP:
            step = self._step + 1  # processed at the start of the next step
        elif not entry.key.endswith("/ready"):
            self._step = max(step, self._step)
        size = _HASH_SIZE if entry.payload is None else len(entry.payload)
        instant = Instant(step * (0 if self.run is None else self.run.step_us))
        return LoggedMessage(
            step=step,
            instant=instant,
            key=entry.key,
            direction=entry.direction,
            sequence=entry.sequence,
            payload=entry.payload,
            sha256=entry.sha256,
            size=size,
        )


def _matching(growing: GrowingRecording, patterns: Sequence[str], is_single: bool) -> Iterator[LoggedMessage]:
    """Yield the matching messages of one file: all if `is_single`, else those that it records for the run."""
    for one in growing.poll():
        if any(matches(one.key, name) for name in patterns) and (
            is_single or (one.direction == "out") == _is_from_sender(one.key)
        ):
            yield one


def is_closed(path: Path) -> bool:
    """Return True if the process that wrote a recording closed it."""
    with open_recording(path) as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC


class RunState(Enum):
    """State of a run."""

    ENDED = "ended"
    """World and radio closed their recordings, or the run has a result."""
    RUNNING = "going on"
    DIED = "died"
    """The run has no result, and no process writes to its recordings."""


def run_state(out: Path) -> RunState:
    """Return the state of the run in a folder. Raises RecordingError without a recording.

    Writing processes are detected on Linux only, and only those of this user; otherwise a run that has not
    ended counts as running.
    """
    files = recordings(out)
    conducting = [path for actor, path in files.items() if actor in ("world", "radio")]
    if (out / "run.json").is_file() or not conducting or all(is_closed(path) for path in conducting):
        return RunState.ENDED
    return RunState.RUNNING if _is_written(conducting) else RunState.DIED


def recorded_span(out: Path, end: float) -> str:
    """Describe the recorded part of a run without a result, as the end of a title."""
    return f"up to {end:g} s, still running" if is_running(out) else f"cut off after {end:g} s"


def is_running(out: Path) -> bool:
    """Return True if a run is running, or has got its result since its data were read."""
    return run_state(out) is RunState.RUNNING or (out / "run.json").is_file()


def partial_run_sentence(out: Path, end: float) -> str:
    """Return a notice that a run without a result is drawn up to `end`, s."""
    how = "is still running" if is_running(out) else "was cut off"
    return f"the run {how}; drawn up to {end:g} s"


def _is_written(paths: list[Path]) -> bool:
    """Return True if a process of this user has one of the files open, or if that is unknown."""
    if sys.platform != "linux" or paths[0].stat().st_uid != os.getuid():
        return True
    inodes = {(there.st_dev, there.st_ino) for there in (path.stat() for path in paths)}
    return any(_has_open(process, inodes) for process in Path("/proc").glob("[0-9]*/fd"))


def _has_open(descriptors: Path, inodes: set[tuple[int, int]]) -> bool:
    if descriptors.parent.name == str(os.getpid()):
        return False  # this process only reads
    try:
        for link in descriptors.iterdir():
            there = link.stat()
            if (there.st_dev, there.st_ino) in inodes and _is_writable(
                descriptors.parent / "fdinfo" / link.name
            ):
                return True
    except OSError:  # exited, or of another user
        return False
    return False


def _is_writable(info: Path) -> bool:
    """Return True if a file was opened for writing (proc_pid_fdinfo(5))."""
    flags = next(line for line in info.read_text().splitlines() if line.startswith("flags:"))
    return bool(int(flags.split()[1], 8) & os.O_ACCMODE)
