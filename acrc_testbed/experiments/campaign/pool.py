"""Where trials are run: one protocol for this computer and for others."""

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple, Protocol, Self

import msgspec

from acrc_testbed.experiments.campaign.store import Pending
from acrc_testbed.experiments.campaign.trial_record import (
    MOST_BYTES,
    MOST_SAID,
    ORDER,
    RECORD,
    left,
    order_of,
)
from acrc_testbed.experiments.study.study import Study
from actors.processes.launch import Child, Launcher, Program
from actors.processes.robot_logs import last_line

TRIAL: Final = "acrc_testbed.experiments.campaign.trial_program"


class EndedTrial(NamedTuple):
    """A trial, or its repetition, whose process has ended; what it has left is not checked yet."""

    pending: Pending
    took_s: float
    record: bytes | None
    """JSON, or whatever stands in its place; None: it has left none."""
    cause: str
    """Why there may be no record."""
    said: bytes = b""
    """What the process said, the end of it."""


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

    def wait(self, timeout_s: float) -> list[EndedTrial]:
        """What has ended; returns as soon as something may have, at the latest after `timeout_s`."""


class LocalPool:
    """Processes of this computer, one per core, each in a folder that says nothing of the campaign."""

    def __init__(
        self,
        study: Study,
        launched: Launcher,
        folder: Path,
        jobs: int,
        patience_s: float,
        modules: Sequence[Path] = (),
    ) -> None:
        """`jobs`: at once; 0: one per core. `patience_s`: what takes longer is ended, and has failed.

        `folder`: for what lies there while it runs. `modules`: where strategies of one's own are looked for.
        """
        self._modules = tuple(modules)
        self._study = study
        self._launched = launched
        self._folder = folder
        self._patience_s = patience_s
        self._running: dict[int, tuple[Child, Path, Pending, float]] = {}
        self.slots = jobs or os.cpu_count() or 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """The launcher ends what is left."""

    @property
    def running(self) -> list[tuple[Pending, float]]:
        """What has been started and not ended, and since when, s."""
        return [(pending, time.monotonic() - began) for _, _, pending, began in self._running.values()]

    def start(self, pending: Pending) -> None:
        """Fork a process for it."""
        folder = Path(tempfile.mkdtemp(prefix="", dir=self._folder))
        order = order_of(self._study, pending.trial, self._modules, repeated=pending.check)
        (folder / ORDER).write_bytes(msgspec.json.encode(order))
        child = self._launched.start(Program("trial", TRIAL, (str(folder),), folder / "trial.log", None))
        self._running[child.pid] = (child, folder, pending, time.monotonic())

    def wait(self, timeout_s: float) -> list[EndedTrial]:
        """What has ended; what takes too long is ended here."""
        self._launched.wait(timeout_s)
        ended = []
        for pid, (child, folder, pending, began) in list(self._running.items()):
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
            record, said = left(folder / RECORD, MOST_BYTES), left(folder / "trial.log", MOST_SAID, end=True)
            ended.append(EndedTrial(pending, took_s, record, cause, said or b""))
            shutil.rmtree(folder, ignore_errors=True)
        return ended
