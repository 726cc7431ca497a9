"""A Dask cluster as whoever starts a run or a campaign sees it: who is there, and whether that is safe."""

import logging
import sys
from typing import Any, Final

from distributed import CancelledError, Client, Future, wait

from deploy.clusters.address import PAGE, ClusterError, host_and_port, is_safe
from deploy.clusters.tls import security

PATIENCE_S: Final = 10.0
_LOOK_S: Final = 5.0
"""So often whoever waits for a worker looks what keeps it."""


def connect(address: str) -> Client:
    """A client of the cluster, which has workers, and lets in nobody without a key.

    `address`: tls://HOST:PORT of the scheduler, or tcp:// of one on this computer. Raises ClusterError.
    """
    for name in ("distributed", "distributed.client"):  # what they say there is raised as well
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        given = security(address, PATIENCE_S) if address.startswith("tls://") else None
        client = Client(address, timeout=PATIENCE_S, security=given)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise ClusterError(f"--on {address}: no Dask scheduler answers there: {reason}") from None
    try:
        refuse_open(client, address)
        if not client.nthreads():
            raise ClusterError(
                f"--on {address}: has no workers; must have one at least, such as by "
                f"./acrc cluster join {address}"
            )
    except ClusterError:
        client.close(timeout=PATIENCE_S)
        raise
    return client


def refuse_open(client: Client, address: str) -> None:
    """Raise ClusterError where somebody from outside could give the cluster work."""
    about = client.scheduler_info(n_workers=-1)
    for who in (str(about["address"]), *map(str, about["workers"])):
        if not is_safe(who):
            raise ClusterError(
                f"--on {address}: listens at {who} without TLS, and runs whatever comes from "
                f"whoever reaches it; must have TLS, or listen at 127.0.0.1 ({PAGE})"
            )
    if address.startswith("tcp://"):
        sys.stderr.write(
            f"acrc: --on {address}: has no TLS: whoever has an account on this computer can run "
            f"code as you there\n"
        )


def machines(client: Client) -> list[str]:
    """The address of one worker on each computer of the cluster, in order of their addresses."""
    first: dict[str, str] = {}
    for worker in sorted(map(str, client.nthreads())):
        first.setdefault(host_and_port(worker)[0], worker)
    return list(first.values())


def answer(client: Client, address: str, worker: str, future: Future[Any]) -> Any:
    """What the worker has to say to the task, as long as that takes; after a while whoever waits is told why.

    Raises ClusterError where the worker has left or the scheduler is lost, and what the task raises.
    """
    told = False
    try:
        while not future.done():
            try:
                wait(future, timeout=_LOOK_S)
            except TimeoutError:
                why = _why(client, address, worker, future)
                if not told:
                    sys.stderr.write(f"acrc: --on {address}: waiting for the worker {worker}{why}\n")
                told = True
        return future.result()
    except CancelledError:
        raise ClusterError(f"--on {address}: the scheduler does not answer any more ({PAGE})") from None


def _why(client: Client, address: str, worker: str, future: Future[Any]) -> str:
    """What keeps the worker, in words; empty if nothing is known. Raises ClusterError if it has left."""
    if worker not in client.nthreads():
        raise ClusterError(f"--on {address}: the worker {worker} has left the cluster ({PAGE})")
    others = {*client.processing([worker]).get(worker, ())} - {future.key}
    return "; it is busy, as with another run or a campaign" if others else ""
