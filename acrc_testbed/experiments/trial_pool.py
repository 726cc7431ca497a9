"""Execution of trials, each in a process of its own: on this computer, or on a Dask cluster."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from acrc_testbed.experiments.trial_record import (
    MOST_BYTES,
    MOST_SAID,
    ORDER,
    TRIAL,
    TrialOrder,
    TrialOutcome,
    outcome_in,
)
from actors.installation.repository import REPOSITORY
from actors.installation.version import software_version
from actors.processes.kernel_compilation import compile_kernels
from actors.processes.launcher import Launcher, Program, create_launcher, scratch_folder
from actors.processes.robot_logs import last_line
from actors.runtime.errors import printable
from actors.runtime.isolation import sandbox

if TYPE_CHECKING:
    from distributed import Client

_POLL_S: Final = 0.05
_MOST_WORDS: Final = 500


class TrialLauncher:
    """Starts the processes of trials; several threads may use it at once."""

    def __init__(self, launched: Launcher) -> None:
        self._launched = launched
        self._lock = threading.Lock()
        self.ending = threading.Event()
        """Once set, nobody waits for trials any more; their processes end with the launcher."""

    def run(self, folder: Path, patience_s: float) -> str:
        """Run the trial whose order lies in the folder; return why there may be no record of it."""
        log = folder / "trial.log"
        with self._lock:
            child = self._launched.start(Program("trial", TRIAL, (str(folder),), log, None))
        end = time.monotonic() + patience_s
        while child.exit_code is None and not self.ending.wait(_POLL_S):
            if time.monotonic() > end:
                child.send(signal.SIGKILL)
                return f"took longer than {patience_s:g} s"
            with self._lock:
                self._launched.wait(0.0)
        last = last_line(log)
        return f"its process ended with exit code {child.exit_code} without a result" + (
            f"; the last that it said: {last}" if last else ""
        )


def run_trial(order: TrialOrder, patience_s: float, launched: TrialLauncher) -> TrialOutcome:
    """Run a trial in a process of its own, in a folder that shows nothing of the campaign."""
    with scratch_folder() as folder:
        (folder / ORDER).write_bytes(msgspec.json.encode(order))
        return outcome_in(folder, launched.run(folder, patience_s))


class WorkerTask(NamedTuple):
    """Input of a worker of a cluster."""

    order: bytes
    """JSON of the trial's order."""
    commit: str
    repository: str
    """The submitter's clone: the worker maps paths in it to paths in its own clone."""
    patience_s: float


def run_on_worker(task: WorkerTask) -> TrialOutcome:
    """Run a trial on a worker, or refuse because of other software or a missing sandbox."""
    here = software_version()
    if here != task.commit:
        return _refused(f"a worker has {here}, this is {task.commit}; their results do not compare")
    order = _moved(task)
    reason = sandbox.isolation_fault() if order.isolate else None
    if reason is not None:
        return _refused(f"a worker cannot isolate robots, as the study wants: {reason}")
    with create_launcher(
        "forkserver"
    ) as launched:  # one for each trial: a worker's files may change between two
        return run_trial(order, task.patience_s, TrialLauncher(launched))


def _refused(why: str) -> TrialOutcome:
    return TrialOutcome(None, "", b"", why)


def _moved(task: WorkerTask) -> TrialOrder:
    """Return the order with the paths of the submitter's clone in this clone."""
    order = msgspec.json.decode(task.order, type=TrialOrder)
    scenario, *modules = (_here(path, task.repository) for path in (order.study.scenario, *order.modules))
    study = msgspec.structs.replace(order.study, scenario=scenario)
    return msgspec.structs.replace(order, study=study, modules=tuple(modules))


def _here(path: str, repository: str) -> str:
    if path and Path(path).is_relative_to(repository):
        return str(REPOSITORY / Path(path).relative_to(repository))
    return path


def checked(answer: object) -> TrialOutcome:
    """Return a worker's answer, bounded; its record is checked where it is read."""
    kinds = (bytes | None, str, bytes, str)
    if not isinstance(answer, TrialOutcome) or not all(map(isinstance, answer, kinds)):
        return TrialOutcome(None, "a worker has answered something else", b"")
    record, cause, said, refusal = answer
    if record is not None and len(record) > MOST_BYTES:
        return TrialOutcome(None, f"a worker has answered more than {MOST_BYTES} octets", b"")
    return TrialOutcome(
        record, printable(cause[:_MOST_WORDS]), said[-MOST_SAID:], printable(refusal[:_MOST_WORDS])
    )


class LocalPool:
    """Trials in forked processes of this computer."""

    def __init__(self, executor: Executor, jobs: int, patience_s: float, launched: TrialLauncher) -> None:
        self._executor = executor
        self._patience_s = patience_s
        self._launched = launched
        self.slots = jobs

    def submit(self, order: TrialOrder) -> "Future[TrialOutcome]":
        """Submit a trial."""
        return self._executor.submit(run_trial, order, self._patience_s, self._launched)

    def outcome(self, future: "Future[TrialOutcome]") -> TrialOutcome:
        """Return the outcome of a trial that has ended."""
        return future.result()


class DaskPool:
    """Trials on the threads of a cluster's workers."""

    def __init__(self, client: "Client", address: str, jobs: int, commit: str, patience_s: float) -> None:
        self._client = client
        self._executor: Executor = client.get_executor(pure=False)
        self._address = address
        self._jobs = jobs
        self._commit = commit
        self._patience_s = patience_s

    @property
    def slots(self) -> int:
        """Number of trials at once; changes as workers come and go. Raises ClusterError."""
        try:
            threads = sum(self._client.nthreads().values())
        except Exception as error:  # any error of a lost connection
            raise self._lost(error) from None
        return self._jobs or max(threads, 1)

    def submit(self, order: TrialOrder) -> "Future[TrialOutcome]":
        """Submit a trial."""
        task = WorkerTask(msgspec.json.encode(order), self._commit, str(REPOSITORY), self._patience_s)
        return self._executor.submit(run_on_worker, task)

    def outcome(self, future: "Future[TrialOutcome]") -> TrialOutcome:
        """Return the outcome of a trial that has ended. Raises ClusterError for a lost or unfit cluster."""
        from distributed import KilledWorker

        from deploy.hosts.connection import ClusterError

        try:
            answer = checked(future.result())
        except KilledWorker:
            return TrialOutcome(None, "every worker that ran it died", b"")
        except (Exception, CancelledError) as error:  # any error of a lost connection
            raise self._lost(error) from None
        if answer.refusal:
            raise ClusterError(f"--on {self._address}: {answer.refusal}")
        return answer

    def close(self) -> None:
        """Cancel the trials that have not ended."""
        self._executor.shutdown(wait=False)

    def _lost(self, error: BaseException) -> Exception:
        from deploy.hosts.connection import ClusterError

        told = str(error).splitlines()
        return ClusterError(
            f"--on {self._address}: the cluster does not answer any more ({told[0] if told else error!r});"
            " the same command goes on from what is there"
        )


Pool = LocalPool | DaskPool


@contextmanager
def trial_pool(jobs: int, patience_s: float, on: str | None, commit: str) -> Iterator[Pool]:
    """Open a pool of so many trials at once; 0: one per core. Whatever still runs at the end is cancelled.

    `patience_s`: the longest that a trial may take. `on`: address of a cluster's scheduler, tls://HOST:PORT,
    or tcp:// of one on this computer; None: this computer. Raises ClusterError.
    """
    if on is not None:
        from deploy.hosts.connection import PATIENCE_S, connect

        client = connect(on)
        pool = DaskPool(client, on, jobs, commit, patience_s)
        try:
            yield pool
        finally:
            pool.close()
            client.close(timeout=PATIENCE_S)
        return
    compile_kernels(quiet=True)
    with create_launcher("forkserver") as launched:
        shared = TrialLauncher(launched)
        slots = jobs or os.cpu_count() or 1
        executor = ThreadPoolExecutor(slots)
        try:
            yield LocalPool(executor, slots, patience_s, shared)
        finally:
            shared.ending.set()
            executor.shutdown(cancel_futures=True)
