"""Trials on a Dask cluster: one per thread of its workers, each in a process of its own."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import msgspec
from distributed import Future, KilledWorker
from distributed import wait as wait_for

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
from actors.installation.version import software
from actors.processes.launch import scratch_folder
from actors.runtime.errors import printable
from actors.runtime.isolation import sandbox
from deploy.hosts.connection import PATIENCE_S, ClusterError, connect

_MOST_WORDS: Final = 500


class TrialTask(NamedTuple):
    """Input of a worker."""

    order: bytes
    """JSON of the trial's order."""
    commit: str
    repository: str
    """The submitter's clone: the worker maps paths in it to paths in its own clone."""
    patience_s: float


def carry_out(task: TrialTask) -> TrialOutcome:
    """Run the trial in a process of its own, or say why not."""
    here = software()
    if here != task.commit:
        return _refused(f"a worker has {here}, this is {task.commit}; their results do not compare")
    order = _moved(task)
    reason = sandbox.available() if order.isolate else None
    if reason is not None:
        return _refused(f"a worker cannot isolate robots, as the study wants: {reason}")
    with scratch_folder() as folder:
        (folder / ORDER).write_bytes(msgspec.json.encode(order))
        cause = ""
        with (folder / "trial.log").open("wb") as log:
            try:
                done = subprocess.run(
                    [sys.executable, "-P", "-m", TRIAL, str(folder)],
                    cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                    timeout=task.patience_s, check=False,
                )  # fmt: skip
                cause = f"its process ended with exit code {done.returncode} without a result"
            except subprocess.TimeoutExpired:
                cause = f"took longer than {task.patience_s:g} s"
        return outcome_in(folder, cause)


def _refused(why: str) -> TrialOutcome:
    return TrialOutcome(None, "", b"", why)


def checked(answer: object) -> TrialOutcome:
    """What a worker has answered, if it is an answer at all; its record is not looked into here."""
    if not isinstance(answer, TrialOutcome):
        return TrialOutcome(None, "a worker has answered something else", b"")
    kinds = (bytes | None, str, bytes, str)
    if not all(isinstance(part, kind) for part, kind in zip(answer, kinds, strict=True)):
        return TrialOutcome(None, "a worker has answered something else", b"")
    record, cause, said, refusal = answer
    if record is not None and len(record) > MOST_BYTES:
        return TrialOutcome(None, f"a worker has answered more than {MOST_BYTES} octets", b"")
    return TrialOutcome(
        record, printable(cause[:_MOST_WORDS]), said[-MOST_SAID:], printable(refusal[:_MOST_WORDS])
    )


def _moved(task: TrialTask) -> TrialOrder:
    """The order, its files looked for in this clone if they lie in the clone of the one who asks."""
    order = msgspec.json.decode(task.order, type=TrialOrder)
    scenario, *modules = (_here(path, task.repository) for path in (order.study.scenario, *order.modules))
    study = msgspec.structs.replace(order.study, scenario=scenario)
    return msgspec.structs.replace(order, study=study, modules=tuple(modules))


def _here(path: str, repository: str) -> str:
    if path and Path(path).is_relative_to(repository):
        return str(REPOSITORY / Path(path).relative_to(repository))
    return path


class DaskPool:
    """One trial per thread of the cluster's workers, each in a process of its own."""

    def __init__(self, commit: str, address: str, jobs: int, patience_s: float) -> None:
        """`address`: tls://HOST:PORT of the scheduler, or tcp:// of one on this computer.

        `jobs`: at once; 0: as many as there are threads.
        """
        self._commit = commit
        self._address = address
        self._jobs = jobs
        self._patience_s = patience_s
        self._submitted: set[Future[Any]] = set()
        self._slots = 1

    def __enter__(self) -> Self:
        """Raises ClusterError where there is no cluster, or none with workers."""
        self._client = connect(self._address)
        try:
            self._count()
        except ClusterError:
            self._client.close(timeout=PATIENCE_S)
            raise
        return self

    def __exit__(self, *error: object) -> None:
        for future in self._submitted:
            future.cancel()
        self._client.close(timeout=PATIENCE_S)

    @property
    def slots(self) -> int:
        """Number of trials at once; changes as workers come and go."""
        return self._jobs or max(self._slots, 1)

    def submit(self, order: TrialOrder) -> Future[Any]:
        """Submit a trial to the cluster."""
        task = TrialTask(msgspec.json.encode(order), self._commit, str(REPOSITORY), self._patience_s)
        future = self._client.submit(carry_out, task, pure=False)
        self._submitted.add(future)
        return future

    def wait(self, handles: Sequence[Future[Any]], timeout_s: float) -> dict[Future[Any], TrialOutcome]:
        """Raises ClusterError if the cluster is gone, or has other software."""
        try:
            wait_for(list(handles), timeout=timeout_s, return_when="FIRST_COMPLETED")
        except TimeoutError:
            pass
        except Exception as error:  # whatever a lost connection is to the library
            raise self._gone(error) from None
        self._count()
        done = [future for future in handles if future.done()]
        self._submitted -= set(done)
        return {future: self._answer(future) for future in done}

    def _count(self) -> None:
        """Update the number of threads."""
        try:
            self._slots = sum(self._client.nthreads().values())
        except Exception as error:
            raise self._gone(error) from None

    def _answer(self, future: Future[Any]) -> TrialOutcome:
        if future.status == "finished":
            answer = checked(future.result())
            if answer.refusal:
                raise ClusterError(f"--on {self._address}: {answer.refusal}")
            return answer
        error: Any = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker):
            return TrialOutcome(None, "every worker that ran it died", b"")
        raise self._gone(error or future.status)

    def _gone(self, error: object) -> ClusterError:
        told = str(error).splitlines()
        return ClusterError(
            f"--on {self._address}: the cluster does not answer any more ({told[0] if told else error!r});"
            " the same command goes on from what is there"
        )
