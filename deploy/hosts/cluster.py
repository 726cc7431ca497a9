"""A Dask cluster as whoever starts a run or a campaign sees it: who is there, and whether that is safe."""

import logging
import re
import sys
from typing import Any, Final

import msgspec
from distributed import Client, Future

from actors.runtime.errors import printable
from deploy.hosts import host_task
from deploy.hosts.cluster_address import PAGE, ClusterError, host_and_port, is_safe
from deploy.hosts.cluster_tls import security
from deploy.hosts.host_probe import HostOffer

PATIENCE_S: Final = 10.0


def connect(address: str) -> Client:
    """A client of the cluster, which has workers, and lets in nobody without a key.

    `address`: tls://HOST:PORT of the scheduler, or tcp:// of one on this computer. Raises ClusterError.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it says there is raised as well
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


def offers(client: Client, address: str, workers: list[str]) -> dict[str, HostOffer]:
    """What these workers' computers have to offer, by a name for each. Raises ClusterError."""
    asked = [
        client.submit(host_task.describe, workers=[worker], allow_other_workers=False, pure=False)
        for worker in workers
    ]
    found: dict[str, HostOffer] = {}
    for worker, future in zip(workers, asked, strict=True):
        offer = _offer(address, worker, future)
        stem = re.sub(r"[^A-Za-z0-9_-]", "-", offer.name.partition(".")[0])[:24].strip("-_") or "host"
        number = next(n for n in range(1, len(workers) + 1) if _numbered(stem, n) not in found)
        found[_numbered(stem, number)] = offer
    return found


def _numbered(stem: str, number: int) -> str:
    return stem if number == 1 else f"{stem}-{number}"


def _offer(address: str, worker: str, future: Future[Any]) -> HostOffer:
    try:
        code, said, last = future.result()
        if code == 0:
            return msgspec.json.decode(said, type=HostOffer)
        reason = (str(last).strip() or f"exit code {code}").splitlines()[-1]
    except Exception as error:  # whatever it raised there, or a lost worker is to the library
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
    raise ClusterError(
        printable(
            f"--on {address}: the worker {worker} cannot be a host of this run: {reason[:500]} ({PAGE})"
        )
    )
