"""Where trials are run: one protocol for this computer and for others."""

import os
import signal
import time
from typing import Final, NamedTuple, Protocol, Self

from deploy.processes.launch import Child, Launcher, Program
from deploy.processes.log_end import last_line
from experiments.campaign.store import Pending, Store

_TRIAL: Final = "experiments.campaign.trial_program"
_CHECK: Final = "experiments.campaign.check_program"


class Ended(NamedTuple):
    """A trial, or its repetition, whose process has ended; with a record in the store unless it died."""

    pending: Pending
    took_s: float
    cause: str
    """Why there may be no record."""


class Pool(Protocol):
    """Runs trials, each in a process of its own. A context manager that leaves none behind."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...

    @property
    def slots(self) -> int:
        """How many can run at once; may change."""

    @property
    def running(self) -> list[tuple[Pending, float]]:
        """What has been started and not ended, and since when, s."""

    def start(self, pending: Pending) -> None:
        """Have it run."""

    def wait(self, timeout_s: float) -> list[Ended]:
        """What has ended; returns as soon as something may have, at the latest after `timeout_s`."""


class LocalPool:
    """Processes of this computer, one per core."""

    def __init__(self, store: Store, launched: Launcher, jobs: int, patience_s: float) -> None:
        """`jobs`: at once; 0: one per core. `patience_s`: what takes longer is ended, and has failed."""
        self._store = store
        self._launched = launched
        self._patience_s = patience_s
        self._running: dict[int, tuple[Child, Pending, float]] = {}
        self.slots = jobs or os.cpu_count() or 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """The launcher ends what is left."""

    @property
    def running(self) -> list[tuple[Pending, float]]:
        """What has been started and not ended, and since when, s."""
        return [(pending, time.monotonic() - began) for _, pending, began in self._running.values()]

    def start(self, pending: Pending) -> None:
        """Fork a process for it."""
        store, trial, check = self._store, pending.trial, pending.check
        log = store.log(trial, check=check)
        log.unlink(missing_ok=True)  # of a process that was ended with the campaign
        words = (str(store.study_file), str(pending.number), str(store.path(trial)))
        argv = (*words, str(store.check_path(trial))) if check else words
        name = f"{'check' if check else 'trial'} {pending.number}"
        child = self._launched.start(Program(name, _CHECK if check else _TRIAL, argv, log, None))
        self._running[child.pid] = (child, pending, time.monotonic())

    def wait(self, timeout_s: float) -> list[Ended]:
        """What has ended; what takes too long is ended here."""
        self._launched.wait(timeout_s)
        ended = []
        for pid, (child, pending, began) in list(self._running.items()):
            took_s = time.monotonic() - began
            if child.exit_code is None and took_s <= self._patience_s:
                continue
            last = last_line(child.program.log)
            cause = f"its process ended with exit code {child.exit_code} without a result" + (
                f"; the last that it said: {last}" if last else ""
            )
            if child.exit_code is None:
                cause = f"took longer than {self._patience_s:g} s"
                child.send(signal.SIGKILL)
            del self._running[pid]
            ended.append(Ended(pending, took_s, cause))
        return ended
