"""Hosts of one run: their agents, certificates, launcher and release."""

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
from actors.installation.usage import command_line
from actors.processes.launcher import ChildProcess, Launcher, Program
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import HostGateway
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.processor import first_names
from deploy.hosts import certificates
from deploy.hosts.address import PAGE, bind_address, bracketed, free_port, host_and_port
from deploy.hosts.agent import CODE, HostAgent, HostTask, block_worker
from deploy.hosts.allocation import HostPool
from deploy.hosts.files import RUN, IncomingFiles, files_below
from deploy.hosts.host_link import PID_OFFSET, HostLink

_FIRST_REPORT_S: Final = 5.0
"""Delay of an answer after which it is reported first, s."""
_LINK_LOST_TIMEOUT_S: Final = 2.0
"""A lost connection is an error if the mesh still exists after this time, s; else the run is ending."""
_POLL_S: Final = 0.02


class HostedLauncher:
    """Launcher that starts robots on their hosts and all other actors on this computer."""

    def __init__(
        self,
        local_launcher: Launcher,
        links: Sequence[HostLink],
        silence_s: float,
        say: Callable[[str], None],
    ) -> None:
        """`silence_s`: timeout of a host's answers."""
        self._here = local_launcher
        self._links = links
        self._silence_s = silence_s
        self._say = say
        self._link_by_robot = {robot: link for link in links for robot in link.robots}
        self._world: ChildProcess | None = None
        """The world's process, which is the mesh's router."""
        self._next_report_s = dict.fromkeys((link.name for link in links), _FIRST_REPORT_S)

    @property
    def arriving(self) -> bool:
        """True if output of exited processes is still to be received."""
        return any(link.ending for link in self._links)

    def start(self, program: Program) -> ChildProcess:
        """Start one program on its host or here."""
        link = self._link_by_robot.get(program.actor)
        child = self._here.start(program) if link is None else link.start(program)
        if program.actor == "world":
            self._world = child
        return child

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Do nothing: each host loads the data that its robots share."""

    def wait(self, timeout_s: float) -> None:
        """Wait for events, at most `timeout_s`. Raises LaunchError."""
        select.select([self._here.fileno()], [], [], min(timeout_s, _POLL_S))
        self._here.wait(0.0)
        for link in self._links:
            link.poll()
            self._report_silence(link)

    def fault(self) -> str | None:
        """Describe the first failure of a host; None if there is none."""
        has_mesh = self._world is not None and self._world.exit_code is None
        for link in self._links:
            if link.fault:
                return f"host {link.name}: {link.fault}"
            if time.monotonic() > link.link_lost_s + _LINK_LOST_TIMEOUT_S and has_mesh:
                return f"host {link.name}: its link to the mesh broke"
            if link.lost and not link.done:
                return f"host {link.name} is lost, with {first_names(link.robots)}: {link.lost}"
        return None

    def table(self) -> Mapping[int, process_table.ProcessState]:
        """Return all processes here and the run's processes on hosts."""
        found = process_table.processes()
        for link in self._links:
            found.update(link.table())
        return found

    def queued_s(self, pid: int) -> float | None:
        """Return the time that a process has waited for a processor, s; None if unknown."""
        if pid < PID_OFFSET:
            return process_table.queued_s(pid)
        return next((link.queued[pid] for link in self._links if pid in link.queued), None)

    def _report_silence(self, link: HostLink) -> None:
        """Report a host that does not answer; after the timeout it is lost."""
        if link.is_over:
            return
        silent_s = link.silent_s
        if silent_s < _FIRST_REPORT_S:
            if self._next_report_s[link.name] > _FIRST_REPORT_S:
                self._say(f"host {link.name} answers again")
            self._next_report_s[link.name] = _FIRST_REPORT_S
        elif silent_s >= self._silence_s:
            link.mark_lost(f"no answer for {silent_s:.0f} s")
        elif silent_s >= self._next_report_s[link.name]:
            self._next_report_s[link.name] *= 2
            self._say(f"no answer from host {link.name} for {silent_s:.0f} s; the run waits for it")


_MB: Final = 1_000_000
_CLOCK_S: Final = 1.0
"""Clock offset above which a host is reported, s."""
_SILENCE_FACTOR: Final = 4.0
"""Timeout of a host, as a multiple of the timeout of a robot."""
_JOIN_TIMEOUT_S: Final = 60.0
"""Timeout for a host to start, and again to join the mesh, s; our choice, for slow computers."""
_FINAL_SILENCE_S: Final = 10.0
"""Timeout of a host's answers during the release, s."""
_FINAL_PROGRESS_S: Final = 30.0
"""Timeout of a host's progress during the release, s."""


@dataclass(frozen=True)
class HostSettings:
    """Common settings of a run's hosts."""

    out: Path
    """Output folder of the run."""
    spawn: str
    limits: ProcessLimits
    timeout_s: float
    share: Callable[[tuple[str, ...]], tuple[tuple[str, ...], ...]]
    """Returns the `HostTask.share` of these robots."""
    leave: bool
    """Keep recordings on the hosts."""
    code: tuple[tuple[tuple[str, Path], ...], ...]
    """Files of each code folder, with their names on the host."""


class RunHosts:
    """Hosts with robots of a run."""

    def __init__(
        self, pool: HostPool, robots: Mapping[str, tuple[str, ...]], keys: Path, settings: HostSettings
    ) -> None:
        """Create certificates and the hosts' agents. Raises AcrcError.

        `robots`: by host name. `keys`: new folder for this computer's keys.
        """
        address, port = pool.listen
        own_keys, host_keys = certificates.create_run_keys(list(robots), address)
        own_keys.write(keys)
        bound = bind_address(address)
        port = free_port(bound, port)
        self.gate = HostGateway(f"tls/{bracketed(bound)}:{port}", keys, robots)
        """Endpoint of the world's router for hosts."""
        self._endpoint = f"{bracketed(address)}:{port}"
        self._pool, self._settings = pool, settings
        self._silence_s = min(_SILENCE_FACTOR * settings.timeout_s, 86_400.0)
        """Timeout of a host's answers, and of calls to it, s."""
        self._run_id = secrets.token_hex(8)
        self._futures: list[Future[Any]] = []
        self._links = tuple(
            self._link(name, index, group, host_keys[name])
            for index, (name, group) in enumerate(robots.items(), start=1)
        )

    def launcher(self, local_launcher: Launcher, say: Callable[[str], None]) -> HostedLauncher:
        """Return a launcher of robots on the hosts and of other actors with `local_launcher`."""
        return HostedLauncher(local_launcher, self._links, self._silence_s, say)

    def join(self, check_failures: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Connect all hosts to the mesh, whose router must be running. Raises AcrcError.

        `check_failures`: called while waiting; raises other failures. `wait`: waits for a number of seconds.
        """
        for link in self._links:
            link.begin(self._files(link.robots))
        while missing := [link for link in self._links if not link.joined]:
            wait(0.02)
            check_failures()
            if late := next((link for link in missing if link.idle_s > _JOIN_TIMEOUT_S), None):
                raise AcrcError(
                    f"host {late.name} cannot reach {self._endpoint}, where the run's router listens; open "
                    f"the port, or choose another address: --listen HOST:PORT ({PAGE})"
                    if late.begun
                    else f"host {late.name} has not started within {_JOIN_TIMEOUT_S:g} s; its worker is busy"
                )
        self._futures += [self._pool.submit(link.name, block_worker, self._run_id) for link in self._links]

    @property
    def sentence(self) -> str:
        """Robots and cores of each host, the router's address, and large clock offsets, as text."""
        parts = []
        for link in self._links:
            cores = self._pool.offers[link.name].cores
            parts.append(
                f"{link.name} ({cores} {'core' if cores == 1 else 'cores'}): {_robot_range(link.robots)}"
            )
        text = f"hosts: {'; '.join(parts)}; they connect to {self._endpoint}"
        words = [
            f"{link.name}'s is {math.fabs(s):.0f} s {'behind' if s < 0 else 'ahead'}"
            for link in self._links
            if math.fabs(s := link.clock_off_s) > _CLOCK_S
        ]
        return text + (f"; clocks differ: {', '.join(words)}" if words else "")

    @property
    def load_sentence(self) -> str:
        """Average load of each host, as text; empty after a very short run."""
        parts = []
        for link in self._links:
            if not link.meter.load.worked:
                return ""
            load, cores = link.meter.load, self._pool.offers[link.name].cores
            parts.append(
                f"{link.name} used {load.worked:.1f} of {cores} {'core' if cores == 1 else 'cores'}, "
                f"{load.waited:.1f} processes waited for a core, answers took {load.answer_s * 1000:.0f} ms "
                f"(at most {load.slowest_s * 1000:.0f})"
            )
        return f"hosts, on average: {'; '.join(parts)}"

    def write(self) -> None:
        """Write the file with the hosts, their loads and the recordings left on them."""
        out = self._settings.out
        pool = self._pool
        hosts = {
            link.name: seal.HostPart(
                host_and_port(pool.workers[link.name])[0],
                pool.offers[link.name].cores,
                link.robots,
                link.folder,
                link.meter.load,
            )
            for link in self._links
        }
        left = {
            record.relative_to(out).as_posix(): seal.RemoteFile(link.name, one.bytes, one.sha256)
            for link in self._links
            for record, one in link.left.items()
        }
        seal.write_hosts(out, seal.HostsFile(pool.address, self._run_id, hosts, left))

    @property
    def remaining_files(self) -> str:
        """Files left on hosts and how to fetch them, as text; empty if there are none."""
        out = self._settings.out
        if left := seal.remote_recordings(out):
            return seal.fetch_sentence(out, left)
        lost = [link.name for link in self._links if link.joined and not link.done]
        if not lost:
            return ""
        return (
            f"files remain on {', '.join(lost)}; once the cluster has a worker there again: "
            f"`{command_line('cluster', 'fetch', out)}`"
        )

    def finish(self, wait: Callable[[float], None]) -> None:
        """Receive remaining output and end the hosts' tasks."""
        for link in self._links:
            link.finish = True
        begin_s = time.monotonic()
        while any(
            link.is_created
            and not link.is_over
            and link.silent_s <= _FINAL_SILENCE_S
            and min(time.monotonic() - begin_s, link.idle_s) <= _FINAL_PROGRESS_S
            for link in self._links
        ):
            wait(0.02)

    def close(self) -> None:
        """Release the agents; those that were not finished end their robots."""
        for future in self._futures:
            with suppress(Exception):  # any error of the library about a lost cluster
                future.cancel()

    def _link(self, name: str, index: int, robots: tuple[str, ...], keys: certificates.PemKeys) -> HostLink:
        settings = self._settings
        task = HostTask(
            run=self._run_id,
            robots=robots,
            endpoint=f"tls/{self._endpoint}",
            spawn=settings.spawn,
            limits=settings.limits,
            silence_s=self._silence_s,
            code=len(settings.code),
            share=settings.share(robots),
            leave=settings.leave,
        )
        agent_future = self._pool.submit(name, HostAgent, task, keys, actor=True)
        self._futures.append(agent_future)
        max_bytes = settings.limits.disk_mb * _MB * len(robots)
        files = IncomingFiles(
            settings.out.resolve(),
            frozenset(robots).__contains__,
            max_bytes,
            "the limit of its robots (disk_mb)",
        )
        return HostLink(name, index, robots, files, agent_future)

    def _files(self, robots: tuple[str, ...]) -> Iterator[tuple[Path, str]]:
        """Yield the files of these robots, with their names on the host."""
        out = self._settings.out
        for robot in robots:
            yield from files_below(out / robot, out, f"{RUN}/")
        for number, files in enumerate(self._settings.code, start=1):
            for name, path in files:
                yield path, f"{CODE}/{number}/{name}"


def _robot_range(robots: tuple[str, ...]) -> str:
    if len(robots) < 3:
        return " and ".join(robots)
    return f"{len(robots)} robots, {robots[0]} to {robots[-1]}"
