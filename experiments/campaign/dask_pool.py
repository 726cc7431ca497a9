"""Trials on a Dask cluster: what a worker that dies had begun is begun again on another."""

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Self

import msgspec
from distributed import Client, Future, KilledWorker
from distributed import wait as wait_for

from actors.runtime import regular_file
from deploy.repository import REPOSITORY
from experiments.campaign import remote
from experiments.campaign.cluster_address import ClusterError, tcp
from experiments.campaign.pool import Ended
from experiments.campaign.store import Pending, Store
from experiments.campaign.trial_record import keep_bytes

_PATIENCE_S: Final = 10.0


class DaskPool:
    """One trial per thread of the cluster's workers, each in a process of its own."""

    def __init__(
        self, store: Store, address: str, jobs: int, patience_s: float, modules: Sequence[Path] = ()
    ) -> None:
        """`address`: dask://HOST:PORT of the scheduler. `jobs`: at once; 0: as many as there are threads."""
        self._store = store
        self._modules = tuple(map(str, modules))
        self._address = address
        self._jobs = jobs
        self._patience_s = patience_s
        self._running: dict[Future[Any], tuple[Pending, float]] = {}
        self._slots = 1

    def __enter__(self) -> Self:
        """Raises ClusterError where there is no cluster, or none with workers."""
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it says there is raised as well
        try:
            self._client = Client(tcp(self._address), timeout=_PATIENCE_S)
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise ClusterError(f"--on {self._address}: no Dask scheduler answers there: {reason}") from None
        self._count()
        if not self._slots:
            self._client.close()
            raise ClusterError(
                f"--on {self._address}: has no workers; must have one at least, such as by "
                f".venv/bin/python -m distributed.cli.dask_worker {tcp(self._address)} --nthreads 1"
            )
        return self

    def __exit__(self, *error: object) -> None:
        for future in self._running:
            future.cancel()
        self._client.close(timeout=_PATIENCE_S)

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
        store, trial = self._store, pending.trial
        order = remote.Order(
            msgspec.json.encode(store.study),
            pending.number,
            store.path(trial).read_bytes() if pending.check else None,
            store.commit,
            str(REPOSITORY),
            self._patience_s,
            self._modules,
        )
        future = self._client.submit(remote.carry_out, order, pure=False)
        self._running[future] = (pending, time.monotonic())

    def wait(self, timeout_s: float) -> list[Ended]:
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

    def _ended(self, future: Future[Any]) -> Ended:
        pending, began = self._running.pop(future)
        trial, check = pending.trial, pending.check
        answer = self._answer(future)
        regular_file.write(self._store.log(trial, check=check), answer.said)
        if answer.record is not None:
            path = self._store.check_path(trial) if check else self._store.path(trial)
            keep_bytes(path, answer.record)
        return Ended(pending, time.monotonic() - began, answer.cause)

    def _answer(self, future: Future[Any]) -> remote.Answer:
        if future.status == "finished":
            found: remote.Answer = future.result()
            return found
        error: Any = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker):
            return remote.Answer(None, "every worker that ran it died", b"")
        if isinstance(error, remote.OtherSoftwareError):
            raise ClusterError(f"--on {self._address}: {error}")
        raise self._gone(error or future.status)

    def _gone(self, error: object) -> ClusterError:
        told = str(error).splitlines()
        return ClusterError(
            f"--on {self._address}: the cluster does not answer any more ({told[0] if told else error!r});"
            " the same command goes on from what is there"
        )
