"""Carries a study out: as many trials at once as there are cores, whatever is missing of them."""

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from deploy.processes.launch import Child, Launcher, Program, launcher
from deploy.processes.signals import signals_as_interrupts
from deploy.run.kernels import compile_kernels
from experiments.campaign.store import Pending, Store
from experiments.campaign.trial_record import TrialRecord, keep

_PROGRAM: Final = "experiments.campaign.trial_program"
_LOOK_S: Final = 1.0


@dataclass(frozen=True)
class CampaignOptions:
    """How a study is carried out; of no influence on what comes out."""

    jobs: int = 0
    """Trials at once; 0: one per core."""
    patience_s: float = 3600.0
    """A trial that takes longer has failed."""


@dataclass(frozen=True)
class Progress:
    """How far a campaign is."""

    done: int
    """Trials that have ended, those of earlier calls included."""
    failed: int
    total: int
    left_s: float | None
    """What the rest will take, from what the trials of this call took; None before the first has ended."""


OnProgress = Callable[[Progress], None]


def carry_out(store: Store, options: CampaignOptions, follow: OnProgress = lambda progress: None) -> Progress:
    """Run every trial that has no record, and give how it stands then.

    Whatever ends it, from outside too, no record is lost, and the next call goes on. A trial whose process
    dies, or takes too long, is kept as a failure.
    """
    compile_kernels(quiet=True)
    with signals_as_interrupts(), launcher("forkserver") as launched:
        return _Campaign(store, options, launched, follow).run()


class _Campaign:
    def __init__(
        self, store: Store, options: CampaignOptions, launched: Launcher, follow: OnProgress
    ) -> None:
        self._store = store
        self._options = options
        self._launched = launched
        self._follow = follow
        self._waiting = store.pending()[::-1]
        self._total = sum(1 for _ in store.study.trials())
        self._before = self._total - len(self._waiting)
        self._failed = sum(record.failure is not None for record in store.records())
        self._ended = 0
        self._running: dict[int, tuple[Child, Pending, float]] = {}
        self._began = time.monotonic()

    def run(self) -> Progress:
        jobs = self._options.jobs or os.cpu_count() or 1
        self._follow(self._progress())
        while self._waiting or self._running:
            while self._waiting and len(self._running) < jobs:
                self._start(self._waiting.pop())
            self._launched.wait(_LOOK_S)
            self._look()
        return self._progress()

    def _start(self, pending: Pending) -> None:
        store = self._store
        argv = (str(store.study_file), str(pending.number), str(store.path(pending.trial)))
        store.log(pending.trial).unlink(missing_ok=True)  # of a process that was ended with the campaign
        program = Program(f"trial {pending.number}", _PROGRAM, argv, store.log(pending.trial), None)
        child = self._launched.start(program)
        self._running[child.pid] = (child, pending, time.monotonic())

    def _look(self) -> None:
        for pid, (child, pending, began) in list(self._running.items()):
            late = time.monotonic() - began > self._options.patience_s
            if child.exit_code is None and not late:
                continue
            if child.exit_code is None:
                child.send(signal.SIGKILL)
            del self._running[pid]
            self._note(child, pending)
            self._follow(self._progress())

    def _note(self, child: Child, pending: Pending) -> None:
        """Count a trial that has ended; one without a record has failed."""
        self._ended += 1
        trial, path = pending.trial, self._store.path(pending.trial)
        if path.exists():
            self._failed += self._store.record(trial).failure is not None
            return
        self._failed += 1
        if child.exit_code is None:
            cause = f"took longer than {self._options.patience_s:g} s"
        else:
            cause = f"its process ended with exit code {child.exit_code} without a result"
        keep(path, TrialRecord(trial.strategy, trial.seed, dict(trial.variant), failure=cause))

    def _progress(self) -> Progress:
        left = len(self._waiting) + len(self._running)
        each = (time.monotonic() - self._began) / self._ended if self._ended else None
        return Progress(
            self._before + self._ended, self._failed, self._total, None if each is None else each * left
        )
