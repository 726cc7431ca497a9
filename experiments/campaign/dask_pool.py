"""Trials on a Dask cluster: what a worker that dies had begun is begun again on another."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import msgspec
from distributed import Future, KilledWorker
from distributed import wait as wait_for

from actors.installation.repository import REPOSITORY
from deploy.clusters.connection import PATIENCE_S, ClusterError, connect
from experiments.campaign import remote
from experiments.campaign.pool import EndedTrial
from experiments.campaign.store import Pending, Store
from experiments.campaign.trial_order import order_of


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
        errand = remote.Errand(msgspec.json.encode(order), store.commit, str(REPOSITORY), self._patience_s)
        future = self._client.submit(remote.carry_out, errand, pure=False)
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

    def _answer(self, future: Future[Any]) -> remote.RemoteOutcome:
        if future.status == "finished":
            answer = remote.checked(future.result())
            if answer.refusal:
                raise ClusterError(f"--on {self._address}: {answer.refusal}")
            return answer
        error: Any = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker):
            return remote.RemoteOutcome(None, "every worker that ran it died", b"")
        raise self._gone(error or future.status)

    def _gone(self, error: object) -> ClusterError:
        told = str(error).splitlines()
        return ClusterError(
            f"--on {self._address}: the cluster does not answer any more ({told[0] if told else error!r});"
            " the same command goes on from what is there"
        )
