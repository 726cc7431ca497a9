"""Hosts of one run: allocated on the cluster, joined to the mesh, started as launchers, and released."""

import math
import re
import secrets
import select
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
from distributed import Client, Future

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostPart, HostsFile, LeftFile
from actors.installation.usage import typed
from actors.processes.launch import Child, Launcher, Program
from actors.runtime.access.credentials import Gate
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation.resource_limits import ProcessLimits
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.process_table import ProcessGlance
from deploy.clusters.address import PAGE, host_and_port
from deploy.clusters.connection import PATIENCE_S, ClusterError, answer, connect, machines
from deploy.hosts import certificates, host_probe, host_program
from deploy.hosts.channel import (
    PART,
    RUN,
    Begin,
    FilePart,
    Finish,
    HostErrand,
    PemKeys,
    bound,
    bracketed,
    free_port,
    own_address,
)
from deploy.hosts.host_link import HostLink, HostReception, below
from deploy.hosts.host_probe import HostOffer
from deploy.hosts.host_program import CODE


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
            host_program.serve,
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
        client.submit(host_program.describe, workers=[worker], allow_other_workers=False, pure=False)
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


_FIRST_TOLD_S: Final = 5.0
_UNLINKED_S: Final = 2.0
"""A link is broken if the mesh still is there so long afterwards: else it has ended as planned."""
_HERE: Final = 1 << 32
"""Process ids below are of this computer."""


class HostedLauncher:
    """Two kinds of launching, by the robots' names."""

    def __init__(
        self,
        here: Launcher,
        links: Sequence[HostLink],
        silence_s: float,
        say: Callable[[str], None],
        why_lost: Callable[[str], str],
    ) -> None:
        """`silence_s`: after so much of it a host is held to be lost. `why_lost`: what the cluster knows of a
        host's end; empty if that is nothing."""
        self._here = here
        self._links = links
        self._silence_s = silence_s
        self._say = say
        self._why_lost = why_lost
        self._of = {robot: link for link in links for robot in link.robots}
        self._world: Child | None = None
        """The mesh ends with it."""
        self._told_s = dict.fromkeys((link.name for link in links), _FIRST_TOLD_S)

    @property
    def arriving(self) -> bool:
        """What has ended somewhere is on its way here."""
        return any(link.arriving for link in self._links)

    def start(self, program: Program) -> Child:
        """StartRobot one program where it belongs."""
        link = self._of.get(program.actor)
        child = self._here.start(program) if link is None else link.start(program)
        if program.actor == "world":
            self._world = child
        return child

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Robots have it in common on their hosts, which were told; here is none."""

    def wait(self, timeout_s: float) -> None:
        """Return when something may have happened, at the latest after `timeout_s`. Raises LaunchError."""
        links = [link for link in self._links if link.connected and not link.lost]
        unsent = [link for link in links if link.unsent]
        select.select([self._here.fileno(), *(link.fileno() for link in links)], unsent, [], timeout_s)
        self._here.wait(0.0)
        for link in links:
            link.turn()
            self._tell(link)

    def fault(self) -> str | None:
        """A sentence on the first host because of which the run cannot go on; None if there is none."""
        for link in self._links:
            if link.fault:
                return f"host {link.name}: {link.fault}"
            if time.monotonic() > link.unlinked_s + _UNLINKED_S and self._mesh_is_there:
                return f"host {link.name}: its link to the mesh broke"
            if link.lost and not link.done:
                why = self._why_lost(link.name)
                return f"host {link.name} is lost, with {_names(link.robots)}: {link.lost}" + (
                    f"; {why}" if why else ""
                )
        return None

    @property
    def _mesh_is_there(self) -> bool:
        return self._world is not None and self._world.exit_code is None

    def table(self) -> Mapping[int, ProcessGlance]:
        """Every process of this machine, and of the hosts what belongs to the run."""
        found = process_table.table()
        for link in self._links:
            found.update(link.table())
        return found

    def queued_s(self, pid: int) -> float | None:
        """How long a process has waited for a processor, s; None where that is unknown."""
        if pid < _HERE:
            return process_table.queued_s(pid)
        return next((link.queued[pid] for link in self._links if pid in link.queued), None)

    def _tell(self, link: HostLink) -> None:
        """Say how long nothing has been heard of a host; give it up in the end."""
        if link.lost:
            return
        silent_s = link.silent_s
        if silent_s < _FIRST_TOLD_S:
            if self._told_s[link.name] > _FIRST_TOLD_S:
                self._say(f"host {link.name} is heard again")
            self._told_s[link.name] = _FIRST_TOLD_S
        elif silent_s >= self._silence_s:
            link.lose(f"nothing has been heard of it for {silent_s:.0f} s")
        elif silent_s >= self._told_s[link.name]:
            self._told_s[link.name] *= 2
            self._say(
                f"nothing has been heard of host {link.name} for {silent_s:.0f} s; the run waits for it"
            )


def _names(robots: tuple[str, ...]) -> str:
    return ", ".join(robots[:3]) + (f" and {len(robots) - 3} more" if len(robots) > 3 else "")


_MB: Final = 1_000_000
_CLOCK_S: Final = 1.0
"""Clocks that differ by more are told of."""
_SILENCE_FACTOR: Final = 4.0
"""A host may be silent for so many times as long as a robot may keep all others waiting."""
_COMING_S: Final = 60.0
"""How long hosts may take to report, and then to join: own choice, a slow computer's start and some."""
_FAREWELL_S: Final = 10.0
_LAST_WORDS_S: Final = 1.0


@dataclass(frozen=True)
class SharedErrand:
    """What all hosts of a run are told alike."""

    out: Path
    """The run's folder here."""
    spawn: str
    limits: ProcessLimits
    timeout_s: float
    share: Callable[[tuple[str, ...]], tuple[tuple[str, ...], ...]]
    """What these robots have in common, in words for `share` of their program."""
    leave: bool
    """Recordings stay on the hosts."""
    code: tuple[tuple[tuple[str, Path], ...], ...] = ()
    """For each folder with code its files, and what they are called there."""

    @property
    def silence_s(self) -> float:
        """After so much silence a host is held to be lost, and holds itself to be alone."""
        return min(_SILENCE_FACTOR * self.timeout_s, 86_400.0)


class RunHosts:
    """Those that have robots of a run."""

    def __init__(
        self, recruits: Recruits, robots: Mapping[str, tuple[str, ...]], keys: Path, shared: SharedErrand
    ) -> None:
        """Draw keys and have the hosts begin to come. Raises AcrcError.

        `robots`: by the names of their hosts. `keys`: new folder for this computer's keys.
        """
        address, port = recruits.listen
        drawn = certificates.draw(list(robots), address)
        drawn.world.write(keys)
        here = bound(address)
        self._reception = HostReception(here, port + 1 if port else 0, keys)
        mesh = port or free_port(here)
        self.gate = Gate(f"tls/{bracketed(here)}:{mesh}", keys, robots)
        """Where the world listens for them."""
        self._told = f"{bracketed(address)}:{mesh}"
        self._recruits, self._shared = recruits, shared
        most = shared.limits.disk_mb * _MB
        self._links = tuple(
            HostLink(name, place, some, below(shared.out, some, most * len(some)))
            for place, (name, some) in enumerate(robots.items(), start=1)
        )
        self._run = secrets.token_hex(8)
        errand = msgspec.json.encode(HostErrand(address, self._reception.port, shared.silence_s, self._run))
        self._tasks: dict[str, Future[Any]] = {
            name: recruits.summon(name, errand, drawn.hosts[name]) for name in robots
        }

    def launcher(self, here: Launcher, say: Callable[[str], None]) -> HostedLauncher:
        """Starts their robots there, and all else by `here`."""
        return HostedLauncher(here, self._links, self._shared.silence_s, say, self._last_words)

    def join(self, look: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Have all of them in the mesh, which must be there. Raises AcrcError.

        `look` may raise what else goes wrong meanwhile; `wait` passes so many seconds.
        """
        deadline = time.monotonic() + _COMING_S
        while missing := [link.name for link in self._links if not link.connected]:
            self._reception.admit(self._links, 0.05)
            look()
            gone = next((name for name in missing if self._tasks[name].done()), "")
            if gone or time.monotonic() > deadline:
                raise AcrcError(self._not_come(gone or missing[0]))
        for link in self._links:
            self._begin(link, wait)
        deadline = time.monotonic() + _COMING_S
        while missing := [link.name for link in self._links if not link.joined]:
            wait(0.02)
            look()
            if time.monotonic() > deadline:
                raise AcrcError(
                    f"host {missing[0]} does not reach {self._told}, where the run's router listens; must be "
                    f"let through, or be another: --listen HOST:PORT ({PAGE})"
                )

    @property
    def sentence(self) -> str:
        """Who is where, where they connect to, and whose clock differs."""
        parts = []
        for link in self._links:
            cores = self._recruits.offers[link.name].cores
            parts.append(f"{link.name} ({cores} {'core' if cores == 1 else 'cores'}): {_range(link.robots)}")
        text = f"hosts: {'; '.join(parts)}; they connect to {self._told} and port {self._reception.port}"
        off = {link.name: link.clock_off_s for link in self._links if math.fabs(link.clock_off_s) > _CLOCK_S}
        words = [
            f"{name}'s is {math.fabs(s):.0f} s {'behind' if s < 0 else 'ahead'}" for name, s in off.items()
        ]
        return text + (f"; clocks differ: {', '.join(words)}" if words else "")

    @property
    def loads(self) -> str:
        """How much each host had to do; empty after a run that was too short to tell."""
        parts = []
        for link in self._links:
            if not link.load.worked:
                return ""
            load, cores = link.load, self._recruits.offers[link.name].cores
            parts.append(
                f"{link.name} worked with {load.worked:.1f} of {cores} {'core' if cores == 1 else 'cores'}, "
                f"{load.waited:.1f} processes waited for one, answers took {load.answer_s * 1000:.0f} ms "
                f"(at most {load.slowest_s * 1000:.0f})"
            )
        return f"hosts, on average: {'; '.join(parts)}"

    def write(self) -> None:
        """Write down who is where, how it went there, and what stays there."""
        out = self._shared.out
        recruits = self._recruits
        hosts = {
            link.name: HostPart(
                host_and_port(recruits.workers[link.name])[0],
                recruits.offers[link.name].cores,
                link.robots,
                link.folder,
                link.load,
            )
            for link in self._links
        }
        left = {
            record.relative_to(out).as_posix(): LeftFile(link.name, one.bytes, one.sha256)
            for link in self._links
            for record, one in link.left.items()
        }
        seal.write(out, HostsFile(recruits.address, self._run, hosts, left))

    @property
    def kept(self) -> str:
        """One sentence on what has stayed on hosts, and how it comes here; empty if nothing has."""
        out = self._shared.out
        if left := seal.elsewhere(out):
            return seal.where(out, left)
        lost = [link.name for link in self._links if link.joined and not link.done]
        if not lost:
            return ""
        return (
            f"what has stayed on {', '.join(lost)} comes by `{typed('cluster', 'fetch', out)}`, once "
            "the cluster has a worker there again"
        )

    def dismiss(self, wait: Callable[[float], None]) -> None:
        """Take what they still have, and let them go."""
        for link in self._links:
            link.send(Finish())
        while any(link.connected and not link.over(_FAREWELL_S) for link in self._links):
            wait(0.02)

    def close(self) -> None:
        """Close what is open here; what has not been let go holds itself to be alone, and ends."""
        self._reception.close()
        for link in self._links:
            link.close()
        deadline = time.monotonic() + _FAREWELL_S
        ending = [self._tasks[link.name] for link in self._links if link.done]
        while not all(task.done() for task in ending) and time.monotonic() < deadline:
            time.sleep(0.05)
        for task in self._tasks.values():
            with suppress(Exception):  # whatever a lost cluster is to the library
                task.cancel()

    def _begin(self, link: HostLink, wait: Callable[[float], None]) -> None:
        """Send a host the files of its robots, and what it is to do."""
        shared = self._shared
        for robot in link.robots:
            for path in sorted((shared.out / robot).rglob("*")):
                if path.is_file():
                    _send(link, path, f"{RUN}/{path.relative_to(shared.out).as_posix()}", wait)
        for number, files in enumerate(shared.code, start=1):
            for name, path in files:
                _send(link, path, f"{CODE}/{number}/{name}", wait)
        link.send(
            Begin(
                robots=link.robots,
                endpoint=f"tls/{self._told}",
                spawn=shared.spawn,
                limits=shared.limits,
                code=len(shared.code),
                share=shared.share(link.robots),
                leave=shared.leave,
            )
        )

    def _last_words(self, name: str) -> str:
        return last_words(self._tasks[name], _LAST_WORDS_S)

    def _not_come(self, name: str) -> str:
        address, _ = self._recruits.listen
        why = self._last_words(name) or f"nothing came for {_COMING_S:g} s"
        return (
            f"host {name} has not come to {bracketed(address)}:{self._reception.port}: {why}; it must be let "
            f"through, or be another: --listen HOST:PORT ({PAGE})"
        )


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
