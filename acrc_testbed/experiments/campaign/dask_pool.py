"""Trials on a Dask cluster: one per thread of its workers, each in a process of its own."""

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import msgspec
from distributed import Future, KilledWorker
from distributed import wait as wait_for

from acrc_testbed.experiments.campaign.store import TRIAL, EndedTrial, Pending, Store
from acrc_testbed.experiments.campaign.trial_record import (
    MOST_BYTES,
    MOST_SAID,
    ORDER,
    RECORD,
    TrialOrder,
    left,
    order_of,
)
from actors.installation.repository import REPOSITORY
from actors.installation.version import software
from actors.processes.launch import scratch_folder
from actors.runtime.errors import printable
from actors.runtime.isolation import sandbox
from deploy.clusters.connection import PATIENCE_S, ClusterError, connect

_MOST_WORDS: Final = 500


class Errand(NamedTuple):
    """Everything that a worker need know."""

    order: bytes
    """JSON of the trial's order."""
    commit: str
    repository: str
    """Where the one who asks has this software: paths in it are meant in the worker's own."""
    patience_s: float


class RemoteOutcome(NamedTuple):
    """What came of it."""

    record: bytes | None
    """JSON of the trial's record, or of its repetition's."""
    cause: str
    """Why there is none."""
    said: bytes
    """What the process said."""
    refusal: str = ""
    """Why this worker runs no trial of the campaign; empty if it does."""


def carry_out(errand: Errand) -> RemoteOutcome:
    """Run the trial in a process of its own, or say why not."""
    here = software()
    if here != errand.commit:
        return _refused(f"a worker has {here}, this is {errand.commit}; their results do not compare")
    order = _moved(errand)
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
                    timeout=errand.patience_s, check=False,
                )  # fmt: skip
                cause = f"its process ended with exit code {done.returncode} without a result"
            except subprocess.TimeoutExpired:
                cause = f"took longer than {errand.patience_s:g} s"
        record, said = left(folder / RECORD, MOST_BYTES), left(folder / "trial.log", MOST_SAID, end=True)
        return RemoteOutcome(record, cause, said or b"")


def _refused(why: str) -> RemoteOutcome:
    return RemoteOutcome(None, "", b"", why)


def checked(answer: object) -> RemoteOutcome:
    """What a worker has answered, if it is an answer at all; its record is not looked into here."""
    if not isinstance(answer, RemoteOutcome):
        return RemoteOutcome(None, "a worker has answered something else", b"")
    kinds = (bytes | None, str, bytes, str)
    if not all(isinstance(part, kind) for part, kind in zip(answer, kinds, strict=True)):
        return RemoteOutcome(None, "a worker has answered something else", b"")
    record, cause, said, refusal = answer
    if record is not None and len(record) > MOST_BYTES:
        return RemoteOutcome(None, f"a worker has answered more than {MOST_BYTES} octets", b"")
    return RemoteOutcome(
        record, printable(cause[:_MOST_WORDS]), said[-MOST_SAID:], printable(refusal[:_MOST_WORDS])
    )


def _moved(errand: Errand) -> TrialOrder:
    """The order, its files looked for in this clone if they lie in the clone of the one who asks."""
    order = msgspec.json.decode(errand.order, type=TrialOrder)
    scenario, *modules = (_here(path, errand.repository) for path in (order.study.scenario, *order.modules))
    study = msgspec.structs.replace(order.study, scenario=scenario)
    return msgspec.structs.replace(order, study=study, modules=tuple(modules))


def _here(path: str, repository: str) -> str:
    if path and Path(path).is_relative_to(repository):
        return str(REPOSITORY / Path(path).relative_to(repository))
    return path


class DaskPool:
    """One trial per thread of the cluster's workers, each in a process of its own."""

    def __init__(
        self, store: Store, address: str, jobs: int, patience_s: float, modules: Sequence[Path] = ()
    ) -> None:
        """`address`: tls://HOST:PORT of the scheduler, or tcp:// of one on this computer.

        `jobs`: at once; 0: as many as there are threads. `modules`: folders with strategies of one's own.
        """
        self._modules = tuple(modules)
        self._store = store
        self._address = address
        self._jobs = jobs
        self._patience_s = patience_s
        self._running: dict[Future[Any], tuple[Pending, float]] = {}
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
        for future in self._running:
            future.cancel()
        self._client.close(timeout=PATIENCE_S)

    @property
    def slots(self) -> int:
        """How many can run at once; changes as workers come and go."""
        return self._jobs or max(self._slots, 1)

    @property
    def running(self) -> list[tuple[Pending, float]]:
        """What has been started and not ended, and since when, s."""
        return [(pending, time.monotonic() - began) for pending, began in self._running.values()]

    def start(self, pending: Pending) -> None:
        """Hand it to the cluster."""
        store = self._store
        order = order_of(store.study, pending.trial, self._modules, repeated=pending.check)
        errand = Errand(msgspec.json.encode(order), store.commit, str(REPOSITORY), self._patience_s)
        future = self._client.submit(carry_out, errand, pure=False)
        self._running[future] = (pending, time.monotonic())

    def wait(self, timeout_s: float) -> list[EndedTrial]:
        """What has ended. Raises ClusterError if the cluster is gone, or has other software."""
        try:
            wait_for(list(self._running), timeout=timeout_s, return_when="FIRST_COMPLETED")
        except TimeoutError:
            pass
        except Exception as error:  # whatever a lost connection is to the library
            raise self._gone(error) from None
        self._count()
        return [self._ended(future) for future in list(self._running) if future.done()]

    def _count(self) -> None:
        """Take in how many threads there are."""
        try:
            self._slots = sum(self._client.nthreads().values())
        except Exception as error:
            raise self._gone(error) from None

    def _ended(self, future: Future[Any]) -> EndedTrial:
        pending, began = self._running.pop(future)
        answer = self._answer(future)
        return EndedTrial(pending, time.monotonic() - began, answer.record, answer.cause, answer.said)

    def _answer(self, future: Future[Any]) -> RemoteOutcome:
        if future.status == "finished":
            answer = checked(future.result())
            if answer.refusal:
                raise ClusterError(f"--on {self._address}: {answer.refusal}")
            return answer
        error: Any = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker):
            return RemoteOutcome(None, "every worker that ran it died", b"")
        raise self._gone(error or future.status)

    def _gone(self, error: object) -> ClusterError:
        told = str(error).splitlines()
        return ClusterError(
            f"--on {self._address}: the cluster does not answer any more ({told[0] if told else error!r});"
            " the same command goes on from what is there"
        )
