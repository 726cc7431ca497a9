"""The computers of a cluster that are fit to be a run's hosts, and which robot is on which."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import msgspec
from distributed import Client, Future

from actors.runtime.errors import printable
from deploy.clusters.address import PAGE, ClusterError
from deploy.clusters.connection import PATIENCE_S, answer, connect, machines
from deploy.hosts import host_probe, host_task
from deploy.hosts.host_probe import HostOffer
from deploy.hosts.listening import own_address
from deploy.hosts.run_tls import PemKeys


@dataclass(frozen=True)
class Recruits:
    """What they offer, by their names, and the way to them."""

    client: Client
    address: str
    """Of the scheduler."""
    offers: dict[str, HostOffer]
    workers: dict[str, str]
    """Dask's address of a worker on each."""
    listen: tuple[str, int]
    """Where hosts are to connect to; port 0: any two."""

    @property
    def isolation_fault(self) -> str | None:
        """Why robots cannot be isolated on all of them; None if they can."""
        faults = ((name, offer.isolation_fault) for name, offer in self.offers.items())
        return next((f"on host {name} {fault}" for name, fault in faults if fault), None)

    def summon(self, name: str, errand: bytes, keys: PemKeys) -> Future[Any]:
        """Have one come, and be a host until its run has ended."""
        return self.client.submit(
            host_task.serve,
            errand,
            (keys.authority, keys.certificate, keys.private_key),
            workers=[self.workers[name]],
            allow_other_workers=False,
            pure=False,
        )


@contextmanager
def recruited(address: str, listen: tuple[str, int] | None) -> Iterator[Recruits]:
    """The computers of the cluster at `address`, all of which are fit for a run. Raises ClusterError.

    `listen`: where they are to connect to; None: this computer as it reaches the scheduler, any two ports.
    """
    client = connect(address)
    try:
        workers = machines(client)
        here = host_probe.offer()
        found = _offers(client, address, workers)
        for name, there in found.items():
            if fault := host_probe.unfit(there, here):
                raise ClusterError(f"--on {address}: host {name} {fault} ({PAGE})")
        ways = dict(zip(found, workers, strict=True))
        yield Recruits(client, address, found, ways, listen or (own_address(address), 0))
    finally:
        with suppress(Exception):  # whatever a lost cluster is to the library
            client.close(timeout=PATIENCE_S)


def _offers(client: Client, address: str, workers: list[str]) -> dict[str, HostOffer]:
    """What these workers' computers have to offer, by a name for each. Raises ClusterError."""
    asked = [
        client.submit(host_task.describe, workers=[worker], allow_other_workers=False, pure=False)
        for worker in workers
    ]
    found: dict[str, HostOffer] = {}
    for worker, future in zip(workers, asked, strict=True):
        offer = _offer(client, address, worker, future)
        stem = re.sub(r"[^A-Za-z0-9_-]", "-", offer.name.partition(".")[0])[:24].strip("-_") or "host"
        number = next(n for n in range(1, len(workers) + 1) if _numbered(stem, n) not in found)
        found[_numbered(stem, number)] = offer
    return found


def _numbered(stem: str, number: int) -> str:
    return stem if number == 1 else f"{stem}-{number}"


def _offer(client: Client, address: str, worker: str, future: Future[Any]) -> HostOffer:
    try:
        code, said, last = answer(client, address, worker, future)
        if code == 0:
            return msgspec.json.decode(said, type=HostOffer)
        reason = (str(last).strip() or f"exit code {code}").splitlines()[-1]
    except ClusterError:
        raise
    except Exception as error:  # whatever it raised there, or a lost worker is to the library
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
    raise ClusterError(
        printable(
            f"--on {address}: the worker {worker} cannot be a host of this run: {reason[:500]} ({PAGE})"
        )
    )


def last_words(future: Future[Any], patience_s: float) -> str:
    """How a host's task has ended, for a person; empty if it has not."""
    try:
        code, said = future.result(timeout=patience_s)
    except TimeoutError:
        return ""
    except Exception as error:  # whatever a worker that has died is to the library
        told = str(error).splitlines()
        return printable(f"the cluster says: {told[0][:300] if told else repr(error)}")
    last = str(said).strip().splitlines()
    return printable(last[-1][:500]) if last else f"its process ended with exit code {code}"


def shares(robots: Sequence[str], cores: Mapping[str, int]) -> dict[str, tuple[str, ...]]:
    """The robots of each host, in their order, by its cores; hosts without any are left out.

    Each next robot goes to the host with the fewest robots per core, among equals to the first.
    """
    counts = dict.fromkeys(cores, 0)
    for _ in robots:
        least = min(counts, key=lambda host: counts[host] / cores[host])
        counts[least] += 1
    found, first = {}, 0
    for host, count in counts.items():
        if count:
            found[host] = tuple(robots[first : first + count])
        first += count
    return found
