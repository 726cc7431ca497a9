"""Hosts of one run: their actors and certificates, the launcher that starts robots there, their release."""

import math
import secrets
import select
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from distributed import Future

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostPart, HostsFile, RemoteFile
from actors.installation.usage import command_line
from actors.processes.launcher import ChildProcess, Launcher, Program
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import HostGateway
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process_table import ProcessState
from deploy.hosts import certificates
from deploy.hosts.address import PAGE, bound, bracketed, free_port, host_and_port
from deploy.hosts.agent import CODE, HostAgent, HostTask, occupy
from deploy.hosts.allocation import HostPool
from deploy.hosts.files import RUN, IncomingFiles, files_below
from deploy.hosts.host_link import HostLink

_FIRST_TOLD_S: Final = 5.0
_UNLINKED_S: Final = 2.0
"""A link is broken if the mesh still is there so long afterwards: else it has ended as planned."""
_TURN_S: Final = 0.02
_HERE: Final = 1 << 32
"""Process ids below are of this computer."""


class HostedLauncher:
    """Launches robots on their hosts, and all other actors here."""

    def __init__(
        self, here: Launcher, links: Sequence[HostLink], silence_s: float, say: Callable[[str], None]
    ) -> None:
        """`silence_s`: timeout after which a host that does not answer is lost."""
        self._here = here
        self._links = links
        self._silence_s = silence_s
        self._say = say
        self._of = {robot: link for link in links for robot in link.robots}
        self._world: ChildProcess | None = None
        """The mesh ends with it."""
        self._told_s = dict.fromkeys((link.name for link in links), _FIRST_TOLD_S)

    @property
    def arriving(self) -> bool:
        """Output of ended processes is on its way here."""
        return any(link.ending for link in self._links)

    def start(self, program: Program) -> ChildProcess:
        """Start one program where it belongs."""
        link = self._of.get(program.actor)
        child = self._here.start(program) if link is None else link.start(program)
        if program.actor == "world":
            self._world = child
        return child

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Do nothing: hosts share data among their own robots."""

    def wait(self, timeout_s: float) -> None:
        """Return when something may have happened, at the latest after `timeout_s`. Raises LaunchError."""
        select.select([self._here.fileno()], [], [], min(timeout_s, _TURN_S))
        self._here.wait(0.0)
        for link in self._links:
            link.turn()
            self._tell(link)

    def fault(self) -> str | None:
        """Return a sentence on the first host that ends the run; None if there is none."""
        for link in self._links:
            if link.fault:
                return f"host {link.name}: {link.fault}"
            if time.monotonic() > link.unlinked_s + _UNLINKED_S and self._mesh_is_there:
                return f"host {link.name}: its link to the mesh broke"
            if link.lost and not link.done:
                return f"host {link.name} is lost, with {_names(link.robots)}: {link.lost}"
        return None

    @property
    def _mesh_is_there(self) -> bool:
        return self._world is not None and self._world.exit_code is None

    def table(self) -> Mapping[int, ProcessState]:
        """Return all processes here, and the run's on its hosts."""
        found = process_table.processes()
        for link in self._links:
            found.update(link.table())
        return found

    def queued_s(self, pid: int) -> float | None:
        """Return how long a process has waited for a processor, s; None where that is unknown."""
        if pid < _HERE:
            return process_table.queued_s(pid)
        return next((link.queued[pid] for link in self._links if pid in link.queued), None)

    def _tell(self, link: HostLink) -> None:
        """Report how long a host has not answered; after the timeout it is lost."""
        if link.is_over:
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
"""Clocks that differ by more are reported."""
_SILENCE_FACTOR: Final = 4.0
"""Timeout of a host, as a multiple of the timeout of a robot."""
_COMING_S: Final = 60.0
"""How long a host may take to begin, and then to join: own choice, more than a slow computer needs."""
_FAREWELL_S: Final = 10.0
_ENDING_S: Final = 30.0
"""How long a host may take at the end without sending anything new."""


@dataclass(frozen=True)
class HostSettings:
    """Settings of all hosts of a run."""

    out: Path
    """The run's folder here."""
    spawn: str
    limits: ProcessLimits
    timeout_s: float
    share: Callable[[tuple[str, ...]], tuple[tuple[str, ...], ...]]
    """Return the data that these robots share, as arguments of `share` of their program."""
    leave: bool
    """Recordings stay on the hosts."""
    code: tuple[tuple[tuple[str, Path], ...], ...] = ()
    """For each folder with code its files, and their names there."""

    @property
    def silence_s(self) -> float:
        """Timeout of a host, and of its calls."""
        return min(_SILENCE_FACTOR * self.timeout_s, 86_400.0)


class RunHosts:
    """The hosts that have robots of a run."""

    def __init__(
        self, pool: HostPool, robots: Mapping[str, tuple[str, ...]], keys: Path, settings: HostSettings
    ) -> None:
        """Draw certificates and make the hosts' actors. Raises AcrcError.

        `robots`: by the names of their hosts. `keys`: new folder for this computer's keys.
        """
        address, port = pool.listen
        own, drawn = certificates.draw(list(robots), address)
        own.write(keys)
        here = bound(address)
        port = free_port(here, port)
        self.gate = HostGateway(f"tls/{bracketed(here)}:{port}", keys, robots)
        """Where the world's router listens for them."""
        self._place = f"{bracketed(address)}:{port}"
        self._pool, self._settings = pool, settings
        self._run = secrets.token_hex(8)
        self._futures: list[Future[Any]] = []
        self._links = tuple(
            self._link(name, place, some, drawn[name])
            for place, (name, some) in enumerate(robots.items(), start=1)
        )

    def launcher(self, here: Launcher, say: Callable[[str], None]) -> HostedLauncher:
        """Return a launcher that starts their robots there, and all else by `here`."""
        return HostedLauncher(here, self._links, self._settings.silence_s, say)

    def join(self, look: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Connect all hosts to the mesh, whose router must be there. Raises AcrcError.

        `look` may raise for other failures meanwhile; `wait` passes so many seconds.
        """
        for link in self._links:
            link.begin(self._files(link.robots))
        while missing := [link for link in self._links if not link.joined]:
            wait(0.02)
            look()
            if late := next((link for link in missing if link.idle_s > _COMING_S), None):
                raise AcrcError(
                    f"host {late.name} does not reach {self._place}, where the run's router listens; must be "
                    f"let through, or be another: --listen HOST:PORT ({PAGE})"
                    if late.begun
                    else f"host {late.name} has not started within {_COMING_S:g} s; its worker is busy"
                )
        self._futures += [self._pool.submit(link.name, occupy, self._run) for link in self._links]

    @property
    def sentence(self) -> str:
        """Robots and cores by host, the address they connect to, and clocks that differ."""
        parts = []
        for link in self._links:
            cores = self._pool.offers[link.name].cores
            parts.append(f"{link.name} ({cores} {'core' if cores == 1 else 'cores'}): {_range(link.robots)}")
        text = f"hosts: {'; '.join(parts)}; they connect to {self._place}"
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
            if not link.meter.load.worked:
                return ""
            load, cores = link.meter.load, self._pool.offers[link.name].cores
            parts.append(
                f"{link.name} worked with {load.worked:.1f} of {cores} {'core' if cores == 1 else 'cores'}, "
                f"{load.waited:.1f} processes waited for one, answers took {load.answer_s * 1000:.0f} ms "
                f"(at most {load.slowest_s * 1000:.0f})"
            )
        return f"hosts, on average: {'; '.join(parts)}"

    def write(self) -> None:
        """Write down who is where, how it went there, and what stays there."""
        out = self._settings.out
        pool = self._pool
        hosts = {
            link.name: HostPart(
                host_and_port(pool.workers[link.name])[0],
                pool.offers[link.name].cores,
                link.robots,
                link.folder,
                link.meter.load,
            )
            for link in self._links
        }
        left = {
            record.relative_to(out).as_posix(): RemoteFile(link.name, one.bytes, one.sha256)
            for link in self._links
            for record, one in link.left.items()
        }
        seal.write_hosts(out, HostsFile(pool.address, self._run, hosts, left))

    @property
    def kept(self) -> str:
        """One sentence on what has stayed on hosts, and how it comes here; empty if nothing has."""
        out = self._settings.out
        if left := seal.remote_recordings(out):
            return seal.fetch_sentence(out, left)
        lost = [link.name for link in self._links if link.joined and not link.done]
        if not lost:
            return ""
        return (
            f"what has stayed on {', '.join(lost)} comes by `{command_line('cluster', 'fetch', out)}`, once "
            "the cluster has a worker there again"
        )

    def dismiss(self, wait: Callable[[float], None]) -> None:
        """Receive what they still have, and end their parts."""
        for link in self._links:
            link.finish = True
        begin_s = time.monotonic()
        while any(self._is_awaited(link, time.monotonic() - begin_s) for link in self._links):
            wait(0.02)

    def close(self) -> None:
        """Release the actors: a host that has not been dismissed ends its robots."""
        for future in self._futures:
            with suppress(Exception):  # any error of the library about a lost cluster
                future.cancel()

    def _link(self, name: str, place: int, robots: tuple[str, ...], keys: certificates.PemKeys) -> HostLink:
        settings = self._settings
        task = HostTask(
            run=self._run,
            robots=robots,
            endpoint=f"tls/{self._place}",
            spawn=settings.spawn,
            limits=settings.limits,
            silence_s=settings.silence_s,
            code=len(settings.code),
            share=settings.share(robots),
            leave=settings.leave,
        )
        made = self._pool.submit(name, HostAgent, task, keys, actor=True)
        self._futures.append(made)
        most = settings.limits.disk_mb * _MB * len(robots)
        files = IncomingFiles(
            settings.out.resolve(),
            frozenset(robots).__contains__,
            most,
            "what its robots may write (disk_mb)",
        )
        return HostLink(name, place, robots, files, made)

    def _files(self, robots: tuple[str, ...]) -> Iterator[tuple[Path, str]]:
        """Return the files of these robots, and their names on the host."""
        out = self._settings.out
        for robot in robots:
            yield from files_below(out / robot, out, f"{RUN}/")
        for number, files in enumerate(self._settings.code, start=1):
            for name, path in files:
                yield path, f"{CODE}/{number}/{name}"

    def _is_awaited(self, link: HostLink, waited_s: float) -> bool:
        """Return True while a host may still send something."""
        late = link.silent_s > _FAREWELL_S or min(waited_s, link.idle_s) > _ENDING_S
        return link.made and not (link.is_over or late)


def _range(robots: tuple[str, ...]) -> str:
    if len(robots) < 3:
        return " and ".join(robots)
    return f"{len(robots)} robots, {robots[0]} to {robots[-1]}"
