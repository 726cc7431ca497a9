"""Execution of trials in separate processes, on this computer or a Dask cluster."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from acrc_testbed.experiments.trial_record import (
    MAX_BYTES,
    MAX_OUTPUT,
    ORDER_FILE,
    TRIAL_MODULE,
    TrialOrder,
    TrialOutcome,
    read_outcome,
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
_MAX_MESSAGE: Final = 500


class TrialLauncher:
    """Launcher of trial processes; thread-safe."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self._lock = threading.Lock()
        self.closing = threading.Event()
        """Once set, waiting for trials stops; their processes exit with the launcher."""

    def run(self, folder: Path, patience_s: float) -> str:
        """Run the trial of the order in the folder; return the reason if there is no record."""
        log = folder / "trial.log"
        with self._lock:
            process = self._launcher.start(Program("trial", TRIAL_MODULE, (str(folder),), log, None))
        end = time.monotonic() + patience_s
        while process.exit_code is None and not self.closing.wait(_POLL_S):
            if time.monotonic() > end:
                process.send(signal.SIGKILL)
                return f"timeout after {patience_s:g} s"
            with self._lock:
                self._launcher.wait(0.0)
        last = last_line(log)
        return f"its process exited with code {process.exit_code} without a result" + (
            f"; last output: {last}" if last else ""
        )


def run_trial(order: TrialOrder, patience_s: float, launcher: TrialLauncher) -> TrialOutcome:
    """Run a trial in a separate process and a scratch folder without data of the campaign."""
    with scratch_folder() as folder:
        (folder / ORDER_FILE).write_bytes(msgspec.json.encode(order))
        return read_outcome(folder, launcher.run(folder, patience_s))


class WorkerTask(NamedTuple):
    """Task for a worker of a cluster."""

    order: bytes
    """Trial's order as JSON."""
    commit: str
    repository: str
    """Path of the submitter's clone; the worker maps it to its own clone."""
    patience_s: float


def run_on_worker(task: WorkerTask) -> TrialOutcome:
    """Run a trial on a worker; refuse with other software or without a sandbox."""
    here = software_version()
    if here != task.commit:
        return _refused(f"a worker has commit {here}, the campaign {task.commit}; results are not comparable")
    order = _with_local_paths(task)
    reason = sandbox.isolation_fault() if order.isolate else None
    if reason is not None:
        return _refused(f"a worker cannot isolate robots, as the study requires: {reason}")
    with create_launcher("forkserver") as launcher:  # one per trial: the worker's files may change
        return run_trial(order, task.patience_s, TrialLauncher(launcher))


def _refused(why: str) -> TrialOutcome:
    return TrialOutcome(None, "", b"", why)


def _with_local_paths(task: WorkerTask) -> TrialOrder:
    """Return the order with paths mapped to this clone."""
    order = msgspec.json.decode(task.order, type=TrialOrder)

    def local(path: str) -> str:
        if path and Path(path).is_relative_to(task.repository):
            return str(REPOSITORY / Path(path).relative_to(task.repository))
        return path

    names = ("modules", "metric_modules", "task_modules")
    folders = {name: tuple(map(local, getattr(order, name))) for name in names}
    study = msgspec.structs.replace(order.study, scenario=local(order.study.scenario))
    return msgspec.structs.replace(order, study=study, **folders)


def validated_answer(answer: object) -> TrialOutcome:
    """Return a worker's answer with limited sizes; its record is validated later."""
    kinds = (bytes | None, str, bytes, str)
    if not isinstance(answer, TrialOutcome) or not all(map(isinstance, answer, kinds)):
        return TrialOutcome(None, "invalid answer of a worker", b"")
    record, cause, output, refusal = answer
    if record is not None and len(record) > MAX_BYTES:
        return TrialOutcome(None, f"answer of a worker exceeds {MAX_BYTES} octets", b"")
    return TrialOutcome(
        record, printable(cause[:_MAX_MESSAGE]), output[-MAX_OUTPUT:], printable(refusal[:_MAX_MESSAGE])
    )


@dataclass(frozen=True)
class LocalPool:
    """Pool of forked trial processes on this computer."""

    executor: Executor
    slots: int
    patience_s: float
    launcher: TrialLauncher

    def submit(self, order: TrialOrder) -> "Future[TrialOutcome]":
        """Submit a trial."""
        return self.executor.submit(run_trial, order, self.patience_s, self.launcher)

    def outcome(self, future: "Future[TrialOutcome]") -> TrialOutcome:
        """Return the outcome of an ended trial."""
        return future.result()


@dataclass(frozen=True)
class DaskPool:
    """Pool of the worker threads of a cluster."""

    client: "Client"
    executor: Executor
    address: str
    jobs: int
    commit: str
    patience_s: float

    @property
    def slots(self) -> int:
        """Number of concurrent trials; follows the number of workers. Raises ClusterError."""
        try:
            threads = sum(self.client.nthreads().values())
        except Exception as error:  # a lost connection may raise anything
            raise self._lost(error) from None
        return self.jobs or max(threads, 1)

    def submit(self, order: TrialOrder) -> "Future[TrialOutcome]":
        """Submit a trial."""
        task = WorkerTask(msgspec.json.encode(order), self.commit, str(REPOSITORY), self.patience_s)
        return self.executor.submit(run_on_worker, task)

    def outcome(self, future: "Future[TrialOutcome]") -> TrialOutcome:
        """Return the outcome of an ended trial. Raises ClusterError for a lost or unsuitable cluster."""
        from distributed import KilledWorker

        from deploy.hosts.connection import ClusterError

        try:
            answer = validated_answer(future.result())
        except KilledWorker:
            return TrialOutcome(None, "every worker that ran it crashed", b"")
        except (Exception, CancelledError) as error:  # a lost connection may raise anything
            raise self._lost(error) from None
        if answer.refusal:
            raise ClusterError(f"--on {self.address}: {answer.refusal}")
        return answer

    def close(self) -> None:
        """Cancel unfinished trials."""
        self.executor.shutdown(wait=False)

    def _lost(self, error: BaseException) -> Exception:
        from deploy.hosts.connection import ClusterError

        lines = str(error).splitlines()
        return ClusterError(
            f"--on {self.address}: lost connection to the cluster ({lines[0] if lines else error!r});"
            " repeat the command to resume"
        )


Pool = LocalPool | DaskPool


@contextmanager
def trial_pool(jobs: int, patience_s: float, on: str | None, commit: str) -> Iterator[Pool]:
    """Open a pool of `jobs` concurrent trials (0: one per core); cancel unfinished trials at exit.

    `patience_s`: timeout of a trial. `on`: address of a cluster's scheduler, tls://HOST:PORT, or tcp:// on
    this computer; None: no cluster. Raises ClusterError.
    """
    if on is not None:
        from deploy.hosts.connection import TIMEOUT_S, connect

        client = connect(on)
        pool = DaskPool(client, client.get_executor(pure=False), on, jobs, commit, patience_s)
        try:
            yield pool
        finally:
            pool.close()
            client.close(timeout=TIMEOUT_S)
        return
    compile_kernels(quiet=True)
    with create_launcher("forkserver") as launcher:
        shared = TrialLauncher(launcher)
        slots = jobs or os.cpu_count() or 1
        executor = ThreadPoolExecutor(slots)
        try:
            yield LocalPool(executor, slots, patience_s, shared)
        finally:
            shared.closing.set()
            executor.shutdown(cancel_futures=True)
