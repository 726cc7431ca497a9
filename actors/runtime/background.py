"""Writing to a disk that may be slow, full or dead, for a process that must not wait for it."""

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Final

import msgspec

from actors.runtime.linux import keep_room
from actors.runtime.recording import Recorder, UnwritableError

_LOG: Final = 2
"""Descriptor of standard error, which leads to the process's log."""
_FAREWELL_S: Final = 5.0
"""Time for a slow disk at the end; own choice, as long as a process may take to end."""


class Background:
    """Executes tasks one after the other in a thread.

    Tasks are dropped and counted while `LIMIT` wait, and after an OSError.
    """

    LIMIT: Final = 20_000
    """Some minutes of a base's messages."""

    def __init__(self) -> None:
        self.dropped = 0
        self.error: OSError | None = None
        """The first one."""
        self._tasks: deque[Callable[[], object]] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def do(self, task: Callable[[], object]) -> None:
        """Execute a task later; never waits."""
        with self._changed:
            if self._closed or self.error is not None or len(self._tasks) >= self.LIMIT:
                self.dropped += 1
                return
            self._tasks.append(task)
            self._changed.notify()

    def close(self, patience_s: float = _FAREWELL_S) -> bool:
        """Take no more tasks, and wait for the rest so long; True if all were executed."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(patience_s)
        return not self._thread.is_alive() and self.dropped == 0 and self.error is None

    def _run(self) -> None:
        while (task := self._next()) is not None:
            try:
                task()
            except OSError as error:
                with self._changed:
                    self.error = error
                    self.dropped += 1 + len(self._tasks)
                    self._tasks.clear()

    def _next(self) -> Callable[[], object] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._tasks or self._closed)
            return self._tasks.popleft() if self._tasks else None


class SparingRecorder(Recorder):
    """A recorder that never fails its process: what the disk does not take is lost, counted, and reported.

    Nothing is recorded after the first loss.
    """

    def __init__(self, path: Path, step_us: int, descriptor: int | None = None) -> None:
        """As in Recorder."""
        super().__init__(path, step_us, descriptor)
        self.lost = 0
        """Records so far."""
        self._unflushed = 0
        """Records since the last flush, which no seal covers yet."""
        self._full: UnwritableError | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._attempt(partial(super().__exit__, kind, error, trace), 0)
        if self._full is not None:
            to_stderr(f"{self._full}; {self.lost} records are missing\n")

    def note(self, name: str, content: msgspec.Struct) -> None:
        """As in Recorder."""
        self._do(partial(super().note, name, content), 1)

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """As in Recorder."""
        self._do(partial(super().received, key, step, sequence, payload), 1)

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """As in Recorder."""
        self._do(partial(super().sent, key, step, sequence, payload, sha256), 1)

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """As in Recorder."""
        self._do(partial(super().computed, key, step, sequence, payload), 1)

    def flush(self) -> None:
        """As in Recorder; keeps room in the log for the report of a full disk, as long as there is some."""
        self._do(self._flush, 0)

    def _flush(self) -> None:
        keep_room(_LOG)
        super().flush()
        self._unflushed = 0

    def _do(self, task: Callable[[], object], records: int) -> None:
        self._attempt(task, records)

    def _attempt(self, task: Callable[[], object], records: int) -> None:
        if self._full is not None:
            self.lost += records
            return
        self._unflushed += records
        try:
            task()
        except UnwritableError as error:
            self._full, self.lost = error, self._unflushed
            to_stderr(f"{error}; records are lost from here on\n")


class BackgroundRecorder(SparingRecorder):
    """A sparing recorder whose disk cannot hold up the process either.

    The last records may be missing after the death of the process.
    """

    def __init__(self, path: Path, step_us: int) -> None:
        super().__init__(path, step_us)
        self._background = Background()

    @property
    def dropped(self) -> int:
        """Records lost so far."""
        return self._background.dropped + self.lost

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._background.close():
            super().__exit__(kind, error, trace)
        else:
            to_stderr(f"{self.path}: the disk is too slow; {self.dropped} records are missing\n")

    def _do(self, task: Callable[[], object], records: int) -> None:
        self._background.do(partial(self._attempt, task, records))


class Log:
    """Lines for a log, from a loop that must not wait for it."""

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write
        self._background = Background()

    def say(self, line: str) -> None:
        """Write one line, later."""
        self._background.do(partial(self._write, f"{line}\n"))

    def close(self) -> None:
        """Wait a moment for the rest."""
        self._background.close(1.0)


def to_stderr(text: str) -> None:
    """Write text to standard error, at once; where that is a log on a full disk, it is lost."""
    with suppress(OSError):
        sys.stderr.write(text)
        sys.stderr.flush()
