"""Network namespaces as emulated hosts, a Dask cluster on them, and `acrc bench hosts`.

All hosts share this computer's cores, so the benchmark measures the cost of links, not a speed-up.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from statistics import median
from typing import Final, Self

import yaml

from acrc_testbed.benchmarks.benchmark_result import ACRC, BenchmarkResult, final_note, make_table
from actors.installation.repository import REPOSITORY
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from deploy.hosts import certificates

HERE: Final = "10.77.0.1"
"""Address of the namespace "here", where a coordinator runs."""
ADDRESS: Final = f"tls://{HERE}:8786"
"""Address of the scheduler."""
_DELAYS_MS: Final = (0.0, 1.0, 10.0)
_START_S: Final = 60.0
_ENTER: Final = 'exec nsenter --target="$0" --net --uts --mount env --chdir="$PWD" "$@"'
"""Shell command that is replaced by the program, so that the program receives signals."""
_HOLD: Final = (
    'echo "$0" > /proc/sys/kernel/hostname; '
    '[ "$1" = 0 ] || mount -t tmpfs -o "size=$1" none "$2"; echo ready; read -r _'
)


class HostsError(AcrcError):
    """Hosts or a cluster that cannot be started."""


@dataclass(frozen=True)
class RigHost:
    """A network namespace with its own host name and mounts."""

    name: str
    address: str
    disk: Path | None
    """Mount point of its own small disk, for temporary files; None: the machine's disk."""
    holder: int
    """Process that keeps the namespaces alive."""

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command that runs `words` on the host, in the caller's folder."""
        disk = () if self.disk is None else (f"TMPDIR={self.disk}",)
        return ["sh", "-c", _ENTER, str(self.holder), *disk, *words]

    def processes(self) -> list[int]:
        """Return the ids of all processes on the host, including sandboxed robots."""
        own = _uts(self.holder)
        return [pid for pid in process_table.processes() if pid != self.holder and own and _uts(pid) == own]

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to every process on the host, including new ones."""
        done: set[int] = set()
        while new := set(self.processes()) - done:
            for pid in new:
                with suppress(ProcessLookupError):
                    os.kill(pid, number)
            done |= new


class Hosts(ExitStack):
    """Context with hosts h1, h2, …, each connected to "here" only."""

    here: RigHost
    each: tuple[RigHost, ...]

    def __init__(self, count: int, *, disk_bytes: int = 0) -> None:
        """Define `count` hosts; `disk_bytes`: size of each host's own disk, 0: none."""
        super().__init__()
        self._count, self._disk_bytes = count, disk_bytes

    def __enter__(self) -> Self:
        """Create the hosts. Raises HostsError."""
        if os.geteuid() != 0 or not all(map(shutil.which, ("ip", "nsenter", "unshare"))):
            raise HostsError("emulated hosts (network namespaces) require root, ip, nsenter and unshare")
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="acrc-host-")))
            names = ["here", *(f"h{number}" for number in range(1, self._count + 1))]
            holders = [self._start_holder(stack, name, folder) for name in names]
            _connect_hosts(holders)
            disk = folder if self._disk_bytes else None
            self.here, *each = (
                RigHost(name, f"10.77.{number}.2" if number else HERE, disk if number else None, holder)
                for number, (name, holder) in enumerate(zip(names, holders, strict=True))
            )
            self.each = tuple(each)
            for host in (self.here, *each):
                stack.callback(host.signal, signal.SIGKILL)
            self.push(stack.pop_all())
        return self

    def _start_holder(self, stack: ExitStack, name: str, folder: Path) -> int:
        size = 0 if name == "here" else self._disk_bytes
        words = ("unshare", "--net", "--uts", "--mount", "sh", "-c", _HOLD, name, str(size), folder)
        holder = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        stack.callback(holder.communicate)
        assert holder.stdout is not None
        if holder.stdout.readline() != "ready\n":
            raise HostsError(f"host {name} cannot be created: unshare failed")
        return holder.pid

    def delay(self, milliseconds: float) -> None:
        """Delay all packets each way. Raises HostsError if the kernel lacks netem."""
        for host in self.each:
            for there, link in ((host, "here"), (self.here, host.name)):
                words = ["tc", "qdisc", "replace", "dev", link, "root", "netem", "delay", f"{milliseconds}ms"]
                done = subprocess.run(there.command(words), capture_output=True, text=True, check=False)
                if done.returncode:
                    raise HostsError(f"links cannot be delayed: {done.stderr.strip()}")

    def stall(self, *, stalled: bool) -> None:
        """Drop all packets to the hosts by a wrong link-layer address, or deliver them if not `stalled`."""
        for host in self.each:
            wrong = ("replace", host.address, "lladdr", "02:00:00:00:00:99", "nud", "permanent")
            words = ["ip", "neigh", *(wrong if stalled else ("del", host.address)), "dev", host.name]
            subprocess.run(self.here.command(words), check=True)


def _uts(pid: int) -> str | None:
    try:
        return str(Path(f"/proc/{pid}/ns/uts").readlink())
    except OSError:
        return None


def _connect_hosts(holders: Sequence[int]) -> None:
    lines = ["link set lo up", f"address add {HERE}/32 dev lo"]
    for number, holder in enumerate(holders[1:], 1):
        lines += (
            f"link add h{number} type veth peer name here netns {holder}",
            f"address add 10.77.{number}.1/24 dev h{number}",
            f"link set h{number} up",
        )
    _run_ip(holders[0], lines)
    for number, holder in enumerate(holders[1:], 1):
        own = ("link set lo up", f"address add 10.77.{number}.2/24 dev here", "link set here up")
        _run_ip(holder, (*own, f"route add {HERE}/32 via 10.77.{number}.1"))


def _run_ip(holder: int, lines: Sequence[str]) -> None:
    words = ["nsenter", f"--target={holder}", "--net", "ip", "-batch", "-"]
    subprocess.run(words, input="\n".join(lines) + "\n", text=True, check=True)


class TlsCluster(ExitStack):
    """Context with a Dask scheduler on "here" and a worker on each host, over TLS."""

    def __init__(self, hosts: Hosts, folder: Path) -> None:
        """Define the cluster; `folder` is created for keys, temporary files and logs (h1.log, …)."""
        super().__init__()
        self.folder = folder.absolute()
        self.environment = os.environ | {"DASK_CONFIG": str(self.folder / "keys")}
        self._hosts = hosts
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        """Start scheduler and workers. Raises HostsError if one does not join."""
        self.folder.mkdir(parents=True)
        _write_keys(self.folder / "keys", self.folder / "scratch")
        with ExitStack() as stack:
            stack.callback(self._stop)
            where = ("--protocol", "tls", "--host", HERE, "--port", ADDRESS.rpartition(":")[2])
            self._start_program(self._hosts.here, f"Scheduler at: {ADDRESS}", "dask_scheduler", *where)
            for host in self._hosts.each:
                self.start_worker(host)
            self.push(stack.pop_all())
        return self

    def _stop(self) -> None:
        for name in self._processes:
            self.kill(name)
        for host in self._hosts.each:
            host.signal(signal.SIGKILL)

    def start_worker(self, host: RigHost) -> None:
        """Start a worker and wait until it joins."""
        words = (ADDRESS, "--host", host.address, "--name", host.name, "--nthreads", "1", "--no-nanny")
        disk = () if host.disk is None else ("--local-directory", str(host.disk))
        self._start_program(host, "Registered to:", "dask_worker", *words, *disk)

    def kill(self, name: str) -> None:
        """Kill the program on the host of that name (SIGKILL)."""
        self._processes[name].kill()
        self._processes[name].wait()

    def _start_program(self, host: RigHost, sign: str, program: str, *words: str) -> None:
        path = self.folder / f"{host.name}.log"
        command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
        with path.open("wb") as log:
            process = self._processes[host.name] = subprocess.Popen(
                host.command(command), cwd=self.folder, env=self.environment, stdout=log, stderr=log
            )
        deadline = time.monotonic() + _START_S
        while sign not in " ".join(path.read_text("utf-8", "replace").split()):
            if process.poll() is not None or time.monotonic() > deadline:
                raise HostsError(f"{program} on {host.name} did not start; see {path}")
            time.sleep(0.02)


def _write_keys(folder: Path, scratch: Path) -> None:
    """Write one key for all hosts and Dask's configuration."""
    folder.mkdir(mode=0o700)
    now = datetime.now(UTC)
    authority = certificates.create_authority("hosts", now, 1)
    both = (certificates.SERVER, certificates.CLIENT)
    pair = certificates.issue_certificate(authority, "cluster", both, (), now, 1)
    (folder / "key.pem").write_bytes(pair.private_pem)
    (folder / "authority.pem").write_bytes(authority.certificate_pem)
    (folder / "certificate.pem").write_bytes(pair.certificate_pem)
    own = {"cert": str(folder / "certificate.pem"), "key": str(folder / "key.pem")}
    roles = {role: dict(own) for role in ("scheduler", "worker", "client")}
    comm = {
        "timeouts": {"tcp": "150s"},
        "require-encryption": True,
        "tls": {"ca-file": str(folder / "authority.pem"), **roles},
    }
    configuration = {"distributed": {"comm": comm}, "temporary-directory": str(scratch)}
    (folder / "cluster.yaml").write_text(yaml.safe_dump(configuration))


_COLUMNS: Final = ("hosts", "robots", "delay, ms", "steps/s", "CPU of world and radio, ms", "of a robot, ms")
"""Column titles of the figures of one swarm."""


def measure(robots: Sequence[int] | None = None, duration: float | None = None) -> BenchmarkResult:
    """Measure each number of robots on 1 to 3 hosts, with delays if the kernel supports them."""
    swarms: list[dict[str, float]] = []
    notes: dict[str, None] = {}
    numbers, seconds = tuple(robots or (6, 20, 60)), duration or 10.0
    swarms += (_measure_swarm(0, 0.0, count, seconds, None, None) for count in numbers)
    for hosted in (1, 2, 3):
        with (
            tempfile.TemporaryDirectory(prefix="acrc-") as name,
            Hosts(hosted) as hosts,
            TlsCluster(hosts, Path(name) / "cluster") as cluster,
        ):
            for delay_ms in _DELAYS_MS:
                try:
                    if delay_ms:
                        hosts.delay(delay_ms)
                except HostsError as error:
                    notes[str(error)] = None
                    break
                swarms += (
                    _measure_swarm(hosted, delay_ms, count, seconds, hosts, cluster) for count in numbers
                )
    rows = [dict(zip(_COLUMNS, one.values(), strict=True)) for one in swarms]
    title = "swarms on emulated hosts, CPU per step; 0 hosts: all on this computer"
    return BenchmarkResult(
        {"cores": os.cpu_count(), "swarms": swarms}, [make_table(rows, title, ".4g"), *notes]
    )


def _measure_swarm(
    number: int, delay_ms: float, robots: int, seconds: float, hosts: Hosts | None, cluster: TlsCluster | None
) -> dict[str, float]:
    """Run one swarm and return speed and CPU per step; without hosts, on this computer."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:
        out = Path(name) / "run"
        options = {"--robots": str(robots), "--duration": f"{seconds:g}", "--out": str(out)}
        words = [*ACRC, "run", "--json", *chain(*options.items())]
        environment: Mapping[str, str] = os.environ
        if hosts is not None and cluster is not None:
            words, environment = hosts.here.command([*words, "--on", ADDRESS]), cluster.environment
        done = subprocess.run(
            words, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise HostsError(f"run of {robots} robots on {number} hosts failed: {done.stderr.strip()[-500:]}")
        steps = seconds * 10
        spent = {path.stem: _cpu_s(path) for path in out.glob("*/*.mcap")}
        centre = spent.pop("world") + spent.pop("radio")
        rate = steps / float(json.loads(done.stdout)["wall_s"])
        return {
            "hosts": number,
            "robots": robots,
            "delay_ms": delay_ms,
            "steps_per_s": rate,
            "centre_ms": 1000 * centre / steps,
            "robot_ms": 1000 * median(spent.values()) / steps,
        }


def _cpu_s(recording: Path) -> float:
    """Return the CPU time of an actor from its first to its last step, s."""
    note = final_note(recording)
    return note.cpu_s - note.startup_cpu_s
