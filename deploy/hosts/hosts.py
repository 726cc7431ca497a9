"""The hosts of one run: found in a cluster, told of their robots, and watched until the run has ended."""

import math
import select
import socket
import ssl
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
from distributed import Client, Future

from actors.processes.launch import Launcher
from actors.runtime.access.credentials import Gate
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation.resource_limits import ProcessLimits
from deploy.hosts import host_probe, host_task, placement, run_keys
from deploy.hosts.channel import to_host
from deploy.hosts.cluster import PATIENCE_S, connect, machines, offers
from deploy.hosts.cluster_address import PAGE, ClusterError
from deploy.hosts.host_link import HostLink, below
from deploy.hosts.host_messages import PART, Begin, FilePart, Finish
from deploy.hosts.host_probe import HostOffer
from deploy.hosts.host_program import HostErrand
from deploy.hosts.hosted_launcher import HostedLauncher
from deploy.hosts.listening import bound, bracketed, free_port, listening, own_address

_MB: Final = 1_000_000
_CLOCK_S: Final = 1.0
"""Clocks that differ by more are told of."""
_SILENCE_FACTOR: Final = 4.0
"""A host may be silent for so many times as long as a robot may keep all others waiting."""
_FAREWELL_S: Final = 10.0
_HANDSHAKE_S: Final = 3.0
"""Somebody who comes and says nothing keeps those out so long who come behind."""


@dataclass(frozen=True)
class SharedErrand:
    """What all hosts of a run are told alike."""

    spawn: str
    isolate: bool
    limits: ProcessLimits
    timeout_s: float
    share: Callable[[tuple[str, ...]], tuple[tuple[str, ...], ...]]
    """What these robots have in common, in words for `share` of their program."""
    code: tuple[tuple[tuple[str, Path], ...], ...] = ()
    """For each folder with code its files, and what they are called there."""


@dataclass
class RunHosts:
    """Those that the cluster has, and once they are placed, those of this run."""

    address: str
    client: Client
    offers: dict[str, HostOffer]
    workers: dict[str, str]
    """Dask's address of a worker on each."""
    listen: tuple[str, int]
    """Where hosts connect to; port 0: any."""
    robots: dict[str, tuple[str, ...]] = field(default_factory=dict)
    links: tuple[HostLink, ...] = ()
    _futures: dict[str, Future[Any]] = field(default_factory=dict)
    _server: socket.socket | None = None
    _context: ssl.SSLContext | None = None
    _gate: Gate | None = None
    _endpoint: str = ""
    """Where they connect to the mesh, as they are told."""

    @property
    def isolation_fault(self) -> str | None:
        """Why robots cannot be isolated on all of them; None if they can."""
        faults = ((name, offer.isolation_fault) for name, offer in self.offers.items())
        return next((f"on host {name} {fault}" for name, fault in faults if fault), None)

    def place(self, robots: Sequence[str]) -> None:
        """Decide which robot is on which."""
        self.robots = placement.shares(robots, {name: offer.cores for name, offer in self.offers.items()})

    def summon(self, out: Path, keys: Path, shared: SharedErrand) -> None:
        """Draw keys, into the folder `keys` for this computer, and have the hosts begin to come.

        `out`: the run's folder.
        """
        address, port = self.listen
        drawn = run_keys.draw(list(self.robots), address)
        drawn.world.write(keys)
        self._context = run_keys.server_context(keys)
        here = bound(address)
        self._server = listening(here, port + 1 if port else 0)
        port = port or free_port(here)
        self._gate = Gate(f"tls/{bracketed(here)}:{port}", keys, self.robots)
        self._endpoint = f"tls/{bracketed(address)}:{port}"
        self.links = tuple(
            HostLink(name, place, robots, below(out, robots, shared.limits.disk_mb * _MB * len(robots)))
            for place, (name, robots) in enumerate(self.robots.items(), start=1)
        )
        silence_s = min(_SILENCE_FACTOR * shared.timeout_s, 86_400.0)
        errand = msgspec.json.encode(HostErrand(address, self._server.getsockname()[1], silence_s))
        for name in self.robots:
            pem = drawn.hosts[name]
            words = (errand, (pem.authority, pem.certificate, pem.private_key))
            worker = self.workers[name]
            self._futures[name] = self.client.submit(
                host_task.serve, *words, workers=[worker], allow_other_workers=False, pure=False
            )

    @property
    def gate(self) -> Gate:
        """Where the world listens for them."""
        assert self._gate is not None
        return self._gate

    def launcher(self, here: Launcher, timeout_s: float, say: Callable[[str], None]) -> HostedLauncher:
        """Starts their robots there, and all else by `here`."""
        silence_s = min(_SILENCE_FACTOR * timeout_s, 86_400.0)
        return HostedLauncher(here, self.links, silence_s, say, self._why_ended)

    def join(
        self, out: Path, shared: SharedErrand, look: Callable[[], None], wait: Callable[[float], None]
    ) -> None:
        """Have all of them in the mesh, which must be there. Raises AcrcError."""
        deadline = time.monotonic() + 3 * PATIENCE_S
        while not all(link.connected for link in self.links):
            self._accept(0.05)
            look()
            missing = next((link.name for link in self.links if not link.connected), "")
            if missing and (self._futures[missing].done() or time.monotonic() > deadline):
                raise AcrcError(self._not_come(missing))
        for link in self.links:
            self._begin(link, out, shared, wait)
        deadline = time.monotonic() + 3 * PATIENCE_S
        while not all(link.joined for link in self.links):
            wait(0.02)
            look()
            if time.monotonic() > deadline:
                name = next(link.name for link in self.links if not link.joined)
                raise AcrcError(
                    f"host {name} does not reach {self._endpoint.removeprefix('tls/')}, where the "
                    f"run's router listens; must be let through, or be another: --listen HOST:PORT ({PAGE})"
                )

    @property
    def sentence(self) -> str:
        """Who is where, and whose clock differs."""
        parts = []
        for name, robots in self.robots.items():
            cores = self.offers[name].cores
            parts.append(f"{name} ({cores} {'core' if cores == 1 else 'cores'}): {_range(robots)}")
        text = f"hosts: {'; '.join(parts)}; they connect to {self._endpoint.removeprefix('tls/')}"
        off = {link.name: link.clock_off_s for link in self.links}
        words = [
            f"{name}'s is {math.fabs(s):.0f} s {'behind' if s < 0 else 'ahead'}"
            for name, s in off.items()
            if math.fabs(s) > _CLOCK_S
        ]
        return text + (f"; clocks differ: {', '.join(words)}" if words else "")

    def dismiss(self, wait: Callable[[float], None]) -> None:
        """Take what they still have, and let them go."""
        for link in self.links:
            if link.connected:
                link.send(Finish())
        while any(self._is_awaited(link) for link in self.links):
            wait(0.02)

    def _is_awaited(self, link: HostLink) -> bool:
        return link.connected and not (link.done or link.lost or link.silent_s > _FAREWELL_S)

    def close(self) -> None:
        """Close what is open here."""
        for link in self.links:
            link.close()
        if self._server is not None:
            self._server.close()
        deadline = time.monotonic() + _FAREWELL_S
        awaited = [self._futures[link.name] for link in self.links if link.done]
        while not all(future.done() for future in awaited) and time.monotonic() < deadline:
            time.sleep(0.05)
        for future in self._futures.values():
            with suppress(Exception):  # whatever a lost cluster is to the library
                future.cancel()

    def _accept(self, timeout_s: float) -> None:
        """Let in one who shows a certificate of the run, and is none who has come already."""
        assert self._server is not None
        assert self._context is not None
        if not select.select([self._server], [], [], timeout_s)[0]:
            return
        plain, _ = self._server.accept()
        plain.settimeout(_HANDSHAKE_S)
        try:
            encrypted = self._context.wrap_socket(plain, server_side=True)
        except (OSError, ValueError):
            plain.close()
            return
        name = run_keys.common_name(encrypted)
        link = next((link for link in self.links if link.name == name and not link.connected), None)
        if link is None:
            encrypted.close()
        else:
            link.connect(to_host(encrypted))

    def _begin(self, link: HostLink, out: Path, shared: SharedErrand, wait: Callable[[float], None]) -> None:
        """Send a host the files of its robots, and what it is to do."""
        for robot in link.robots:
            for path in sorted((out / robot).rglob("*")):
                if path.is_file():
                    _send(link, path, f"{robot}/{path.relative_to(out / robot).as_posix()}", wait)
        for number, files in enumerate(shared.code, start=1):
            for name, path in files:
                _send(link, path, f"code/{number}/{name}", wait)
        begin = Begin(
            robots=link.robots,
            endpoint=self._endpoint,
            spawn=shared.spawn,
            isolate=shared.isolate,
            limits=shared.limits,
            code=len(shared.code),
            share=shared.share(link.robots),
        )
        link.send(begin)

    def _why_ended(self, name: str) -> str:
        """What the cluster knows of a host's end; empty if that is nothing."""
        future = self._futures[name]
        deadline = time.monotonic() + 1.0
        while not future.done() and time.monotonic() < deadline:
            time.sleep(0.02)
        if not future.done():
            return ""
        try:
            code, said = future.result(timeout=1.0)
            last = str(said).strip().splitlines()
            return printable(last[-1][:500]) if last else f"its process ended with exit code {code}"
        except Exception as error:  # whatever a worker that has died is to the library
            return printable(f"the cluster says: {str(error).splitlines()[0][:300] or error!r}")

    def _not_come(self, name: str) -> str:
        assert self._server is not None
        host, port = self._server.getsockname()[:2]
        why = self._why_ended(name) or f"nothing came for {3 * PATIENCE_S:g} s"
        return (
            f"host {name} has not come to {host}:{port}: {why}; must reach that address and port, or "
            f"another: --listen HOST:PORT ({PAGE})"
        )


@contextmanager
def recruited(address: str, listen: tuple[str, int] | None) -> Iterator[RunHosts]:
    """The hosts of the cluster at `address`, all of which are fit for a run. Raises ClusterError.

    `listen`: where they are to connect to; None: this computer as it reaches the scheduler, any port.
    """
    client = connect(address)
    try:
        workers = machines(client)
        here = host_probe.offer()
        found = offers(client, address, workers)
        for name, there in found.items():
            if fault := host_probe.unfit(there, here):
                raise ClusterError(f"--on {address}: host {name} {fault} ({PAGE})")
        hosts = RunHosts(
            address,
            client,
            found,
            dict(zip(found, workers, strict=True)),
            listen or (own_address(address), 0),
        )
        try:
            yield hosts
        finally:
            hosts.close()
    finally:
        with suppress(Exception):  # whatever a lost cluster is to the library
            client.close(timeout=PATIENCE_S)


def _range(robots: tuple[str, ...]) -> str:
    if len(robots) < 3:
        return " and ".join(robots)
    return f"{len(robots)} robots, {robots[0]} to {robots[-1]}"


def _send(link: HostLink, path: Path, name: str, wait: Callable[[float], None]) -> None:
    with path.open("rb") as file:
        data = file.read(PART)
        link.send(FilePart(name, data))
        while data := file.read(PART):
            link.send(FilePart(name, data))
    while link.unsent and not link.lost:
        wait(0.01)
