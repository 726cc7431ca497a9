"""Allocation of a cluster's computers to a run: offers, checks, and distribution of robots."""

import os
import re
import socket
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
from distributed import Client, Future

from acrc_testbed.results.result import package_versions
from actors.installation.repository import REPOSITORY
from actors.installation.version import software_version
from actors.processes.kernel_compilation import compile_kernels
from actors.robot import assembly
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation import sandbox
from actors.runtime.processor import differing_kernels, first_names
from deploy.hosts.address import PAGE, local_address
from deploy.hosts.connection import ClusterError, await_result, connected, error_line, host_workers

Text = Annotated[str, msgspec.Meta(max_length=2000)]


class HostOffer(msgspec.Struct, frozen=True):
    """Offer of a computer: its resources and versions."""

    name: Text
    """Host name."""
    cores: Annotated[int, msgspec.Meta(ge=1, le=100_000)]
    """Cores that the worker may use."""
    commit: Text
    versions: dict[str, str]
    """Versions of Python and of packages that affect results."""
    kernels: dict[str, str]
    """Fingerprints of the results of compiled kernels, by name."""
    isolation_fault: Text | None
    """Why robots cannot be isolated there; None if they can."""
    repository: Text
    """Path of the repository there."""


@dataclass(frozen=True)
class HostPool:
    """Hosts that are suitable for a run."""

    client: Client
    address: str
    """Address of the scheduler."""
    offers: dict[str, HostOffer]
    workers: dict[str, str]
    """Dask address of a worker on each host."""
    listen: tuple[str, int]
    """Address and port at which the hosts' routers connect; port 0: any."""

    @property
    def isolation_fault(self) -> str | None:
        """Why robots cannot be isolated on all of them; None if they can."""
        faults = ((name, offer.isolation_fault) for name, offer in self.offers.items())
        return next((f"on host {name} {fault}" for name, fault in faults if fault), None)

    def submit(self, name: str, function: Any, *words: Any, actor: bool = False) -> Future[Any]:
        """Submit a function, or an actor's class, to this host only."""
        return self.client.submit(
            function, *words, workers=[self.workers[name]], allow_other_workers=False, pure=False, actor=actor
        )


@contextmanager
def allocate_hosts(address: str, listen: tuple[str, int] | None) -> Iterator[HostPool]:
    """Allocate all computers of the cluster at `address`. Raises ClusterError if one is unsuitable.

    `listen`: address for their connections; None: this computer's on its route to the scheduler, any port.
    """
    with connected(address) as client:
        workers = host_workers(client)
        here = local_offer()
        found = _offers(client, address, workers)
        for name, there in found.items():
            if fault := host_fault(there, here):
                raise ClusterError(f"--on {address}: host {name} {fault} ({PAGE})")
        by_name = dict(zip(found, workers, strict=True))
        yield HostPool(client, address, found, by_name, listen or (local_address(address), 0))


def local_offer() -> HostOffer:
    """Return the offer of this computer, after the compilation of kernels if necessary."""
    compile_kernels(quiet=True)
    return HostOffer(
        name=socket.gethostname(),
        cores=len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1,
        commit=software_version(),
        versions=package_versions(),
        kernels=assembly.kernels(),
        isolation_fault=sandbox.isolation_fault(),
        repository=str(REPOSITORY),
    )


def host_fault(there: HostOffer, here: HostOffer) -> str | None:
    """Return why a computer is unsuitable for a run started here; None if it is suitable."""
    if there.commit != here.commit:
        return printable(
            f"has {there.commit}, this computer {here.commit}; update it: git -C {there.repository} "
            f"fetch && git -C {there.repository} checkout {here.commit.removesuffix('+')}, and restart its "
            "worker"
        )
    for name, version in here.versions.items():
        if (other := there.versions.get(name)) != version:
            return printable(f"has {name} {other}, this computer {version}; install the same version")
    if names := differing_kernels(there.kernels, here.kernels):
        return printable(f"computes different bits than this computer: in {first_names(names)}")
    return None


def distribute_robots(robots: Sequence[str], cores: Mapping[str, int]) -> dict[str, tuple[str, ...]]:
    """Distribute robots to hosts by cores, in order; hosts without robots are omitted.

    Each robot goes to the first host with the fewest robots per core.
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


def encoded_offer() -> bytes:
    """Return this worker's offer as JSON. Raises AcrcError if its software has changed since its start."""
    now, loaded = software_version.__wrapped__(), software_version()
    if now.removesuffix("+") != loaded.removesuffix("+"):
        raise AcrcError(f"it runs {loaded}, but its clone is at {now}; restart the worker")
    return msgspec.json.encode(local_offer())


def _offers(client: Client, address: str, workers: list[str]) -> dict[str, HostOffer]:
    """Return the offers of these workers' computers, by unique name. Raises ClusterError."""
    futures = [
        client.submit(encoded_offer, workers=[worker], allow_other_workers=False, pure=False)
        for worker in workers
    ]
    found: dict[str, HostOffer] = {}
    for worker, future in zip(workers, futures, strict=True):
        try:
            answer = await_result(client, address, worker, future)
            offer = msgspec.json.decode(answer, type=HostOffer)
        except ClusterError:
            raise
        except Exception as error:  # raised there, or by the library about a lost worker
            raise ClusterError(
                f"--on {address}: the worker {worker} cannot be a host of this run: "
                f"{error_line(error)} ({PAGE})"
            ) from None
        stem = re.sub(r"[^A-Za-z0-9_-]", "-", offer.name.partition(".")[0])[:24].strip("-_") or "host"
        names = (stem if number == 1 else f"{stem}-{number}" for number in range(1, len(workers) + 1))
        found[next(name for name in names if name not in found)] = offer
    return found
