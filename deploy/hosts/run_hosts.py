"""The hosts of one run: told of their robots, joined to the mesh, and let go at the end."""

import math
import secrets
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
from distributed import Future

from actors.installation.usage import typed
from actors.processes.launch import Launcher
from actors.runtime.access.credentials import Gate
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.resource_limits import ProcessLimits
from deploy.clusters.address import PAGE, host_and_port
from deploy.hosts import run_keys
from deploy.hosts.host_link import HostLink, below
from deploy.hosts.host_messages import PART, Begin, FilePart, Finish
from deploy.hosts.host_program import CODE, RUN, HostErrand
from deploy.hosts.hosted_launcher import HostedLauncher
from deploy.hosts.listening import bound, bracketed, free_port
from deploy.hosts.reception import HostReception
from deploy.hosts.recruits import Recruits, last_words
from observation.results import hosts_file
from observation.results.hosts_file import HostPart, HostsFile, LeftFile

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
        drawn = run_keys.draw(list(robots), address)
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
        hosts_file.write(out, HostsFile(recruits.address, self._run, hosts, left))

    @property
    def kept(self) -> str:
        """One sentence on what has stayed on hosts, and how it comes here; empty if nothing has."""
        out = self._shared.out
        if left := hosts_file.elsewhere(out):
            return hosts_file.where(out, left)
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
