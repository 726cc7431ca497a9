"""Background disk writes, for processes that must not wait for a slow, full or failed disk."""

import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime.linux import reserve_log_space
from actors.runtime.recording import Recorder, UnwritableError

_LOG: Final = 2
"""Descriptor of standard error, which is the process's log."""
_CLOSE_TIMEOUT_S: Final = 5.0
"""Timeout for the last writes to a slow disk; own choice, as long as a process may take to exit."""


class BackgroundWorker:
    """Thread that executes tasks in order.

    Tasks are dropped and counted while `LIMIT` tasks wait, and after an OSError.
    """

    LIMIT: Final = 20_000
    """Most waiting tasks: some minutes of a base's messages."""

    def __init__(self) -> None:
        self.dropped = 0
        self.error: OSError | None = None
        """First error."""
        self._tasks: deque[Callable[[], object]] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def submit(self, task: Callable[[], object]) -> None:
        """Queue a task; never block."""
        with self._changed:
            if self._closed or self.error is not None or len(self._tasks) >= self.LIMIT:
                self.dropped += 1
                return
            self._tasks.append(task)
            self._changed.notify()

    def close(self, patience_s: float = _CLOSE_TIMEOUT_S) -> bool:
        """Finish the waiting tasks within a timeout and stop; return whether all tasks were executed."""
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


class LossyRecorder(Recorder):
    """A recorder that never fails its process: on a disk error, it drops, counts and reports records.

    It records nothing after the first loss.
    """

    def __init__(self, path: Path, step_us: int, descriptor: int | None = None) -> None:
        """As in Recorder."""
        super().__init__(path, step_us, descriptor)
        self.lost = 0
        """Number of records lost."""
        self._unflushed = 0
        """Records since the last flush, not yet sealed."""
        self._disk_error: UnwritableError | None = None

    def __exit__(self, *error: object) -> None:
        self._attempt(partial(super().__exit__, *error), 0)
        if self._disk_error is not None:
            write_stderr(f"{self._disk_error}; {self.lost} records lost\n")

    def note(self, name: str, content: msgspec.Struct) -> None:
        """As in Recorder."""
        self._execute(partial(super().note, name, content), 1)

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """As in Recorder."""
        self._execute(partial(super().received, key, step, sequence, payload), 1)

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """As in Recorder."""
        self._execute(partial(super().sent, key, step, sequence, payload, sha256), 1)

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """As in Recorder."""
        self._execute(partial(super().computed, key, step, sequence, payload), 1)

    def flush(self) -> None:
        """As in Recorder; reserves log space for the report of a full disk."""
        self._execute(self._flush, 0)

    def _flush(self) -> None:
        reserve_log_space(_LOG)
        super().flush()
        self._unflushed = 0

    def _execute(self, task: Callable[[], object], records: int) -> None:
        self._attempt(task, records)

    def _attempt(self, task: Callable[[], object], records: int) -> None:
        if self._disk_error is not None:
            self.lost += records
            return
        self._unflushed += records
        try:
            task()
        except UnwritableError as error:
            self._disk_error, self.lost = error, self._unflushed
            write_stderr(f"{error}; all further records are lost\n")


class BackgroundRecorder(LossyRecorder):
    """A sparing recorder whose process does not wait for the disk.

    The last records may be missing if the process is killed.
    """

    def __init__(self, path: Path, step_us: int) -> None:
        super().__init__(path, step_us)
        self._background = BackgroundWorker()

    @property
    def dropped(self) -> int:
        """Number of records lost."""
        return self._background.dropped + self.lost

    def __exit__(self, *error: object) -> None:
        if self._background.close():
            super().__exit__(*error)
        else:
            write_stderr(f"{self.path}: disk too slow; {self.dropped} records lost\n")

    def _execute(self, task: Callable[[], object], records: int) -> None:
        self._background.submit(partial(self._attempt, task, records))


class BackgroundLog:
    """A log for a loop that must not wait for it."""

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write
        self._background = BackgroundWorker()

    def say(self, line: str) -> None:
        """Queue one line."""
        self._background.submit(partial(self._write, f"{line}\n"))

    def close(self) -> None:
        """Write the queued lines, within 1 s."""
        self._background.close(1.0)


def write_stderr(text: str) -> None:
    """Write text to standard error immediately; it is lost if the log's disk is full."""
    with suppress(OSError):
        sys.stderr.write(text)
        sys.stderr.flush()
