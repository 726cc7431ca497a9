"""A Dask cluster with TLS on hosts: the scheduler here, a worker on each."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from actors.runtime.errors import AcrcError
from benchmarks.hosts.cluster_keys import write_keys
from benchmarks.hosts.host import HERE, RigHost
from benchmarks.hosts.namespaces import Hosts

PORT: Final = 8786
ADDRESS: Final = f"tls://{HERE}:{PORT}"
"""Of the scheduler."""
_PATIENCE_S: Final = 60.0
_SIGNS: Final = {"dask_scheduler": f"Scheduler at: {ADDRESS}", "dask_worker": "Registered to:"}
"""What a program logs when it is ready."""


class TlsClusterError(AcrcError):
    """A cluster on hosts whose scheduler or worker does not start."""


class TlsCluster:
    """A scheduler and a worker with one thread on each host; a context manager that ends them all.

    On leaving it, whatever else runs on h1, h2, … is killed as well: what the workers have started.
    """

    def __init__(self, hosts: Hosts, folder: Path, *, through: Mapping[str, str] | None = None) -> None:
        """`folder`: made for keys, temporary files and logs (here.log, h1.log, …), which stay there.

        `through`: by a host's name, the scheduler's address as its worker is told it, such as tls:// and that
        of a relay; the others are told ADDRESS.
        """
        self.folder = folder.absolute()
        self.environment = os.environ | {"DASK_CONFIG": str(self.folder / "keys")}
        """For a coordinator, to be started by the command of `hosts.here`."""
        self._hosts = hosts
        self._through = through or {}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        """Return when all workers have joined. Raises TlsClusterError where one does not."""
        self.folder.mkdir(parents=True)
        write_keys(self.folder / "keys", self.folder / "scratch")
        try:
            self.start_scheduler()
            logged = [self._begin_worker(number) for number in range(len(self._hosts.each))]
            for host, before in zip(self._hosts.each, logged, strict=True):
                self._await(host, "dask_worker", before)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def start_scheduler(self) -> None:
        """Start it, also again after it was killed, and wait until it listens."""
        where = ("--protocol", "tls", "--host", HERE, "--port", str(PORT))
        self._await(
            self._hosts.here, "dask_scheduler", self._begin(self._hosts.here, "dask_scheduler", *where)
        )

    def start_worker(self, number: int) -> None:
        """Start that of host `number`, counted from 0, again after it was killed, and wait until it joins."""
        self._await(self._hosts.each[number], "dask_worker", self._begin_worker(number))

    def kill_scheduler(self) -> None:
        """End it by SIGKILL."""
        self._kill("here")

    def kill_worker(self, number: int) -> None:
        """End that of host `number` by SIGKILL; what it has started is left alone.

        For a host without power: `hosts.each[number].signal`.
        """
        self._kill(self._hosts.each[number].name)

    def log(self, name: str) -> str:
        """What the program on the host of that name has logged so far."""
        return (self.folder / f"{name}.log").read_text("utf-8", "replace")

    def _begin_worker(self, number: int) -> int:
        host = self._hosts.each[number]
        return self._begin(
            host,
            "dask_worker",
            self._through.get(host.name, ADDRESS),
            *("--host", host.address, "--name", host.name, "--nthreads", "1"),
            *(() if host.disk is None else ("--local-directory", str(host.disk))),
            "--no-nanny",
        )

    def _begin(self, host: RigHost, program: str, *words: str) -> int:
        """Start a program; how long its log was before, in characters."""
        path = self.folder / f"{host.name}.log"
        path.touch()
        before = len(self.log(host.name))
        command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
        with path.open("ab") as log:
            self._processes[host.name] = subprocess.Popen(
                host.command(command),
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        return before

    def _await(self, host: RigHost, program: str, before: int) -> None:
        deadline = time.monotonic() + _PATIENCE_S
        while _SIGNS[program] not in " ".join((said := self.log(host.name)[before:]).split()):
            if self._processes[host.name].poll() is not None or time.monotonic() > deadline:
                last = said.splitlines()[-1] if said else "nothing"
                raise TlsClusterError(
                    f"{program} on {host.name} does not start; see {self.folder / host.name}.log: {last}"
                )
            time.sleep(0.02)

    def _kill(self, name: str) -> None:
        self._processes[name].kill()
        self._processes[name].wait()

    def _end(self) -> None:
        for name in self._processes:
            self._kill(name)
        for host in self._hosts.each:
            host.signal(signal.SIGKILL)
