"""Runs over hosts, started on "here"."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.hosts.cluster import ADDRESS, TlsCluster
from benchmarks.hosts.namespaces import Hosts
from benchmarks.hosts.relay_process import RelayProcess
from tests.hosts.on_host import eventually

ROOT = Path(__file__).parents[2]
TOLD = "10.77.99.1"
"""An address that nobody has: hosts are told it, and relays there lead here."""
PORT = 7450


class HostedRun:
    """A run that goes on."""

    def __init__(self, hosts: Hosts, cluster: TlsCluster, out: Path, *words: str) -> None:
        self.out = out
        self.hosts = hosts
        command = [sys.executable, "-P", "-m", "command_line", "run", "--on", ADDRESS, "--out", str(out)]
        self.process = subprocess.Popen(
            hosts.here.command([*command, *words]),
            cwd=ROOT,
            env=cluster.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def under_way(self) -> None:
        """Wait until robots have recorded some steps."""
        deadline = time.monotonic() + 120
        while not (self.out / "r1/r1.mcap").is_file() or (self.out / "r1/r1.mcap").stat().st_size < 20_000:
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline, self.out
            time.sleep(0.05)

    def ended(self) -> tuple[int, str]:
        """Its exit code, and what it said last on standard error."""
        _, said = self.process.communicate(timeout=180)
        return self.process.returncode, said.strip().splitlines()[-1]

    def digest(self) -> str:
        out, said = self.process.communicate(timeout=180)
        assert self.process.returncode == 0, said
        digest: str = json.loads(out)["digest"]
        return digest

    def nothing_left(self) -> bool:
        """On no host a process of the run is left."""
        return eventually(lambda: all(len(host.processes()) <= 1 for host in self.hosts.each))


@contextmanager
def relayed(hosts: Hosts, delay_ms: float) -> Iterator[list[RelayProcess]]:
    """Relays on every host, at TOLD, to the mesh and to the run here."""
    with ExitStack() as stack:
        made = []
        for host in hosts.each:
            address = ["ip", "address", "replace", f"{TOLD}/32", "dev", "lo"]
            subprocess.run(host.command(address), check=True)
            for port in (PORT, PORT + 1):
                relay = RelayProcess(host, f"{TOLD}:{port}", f"10.77.0.1:{port}", delay_ms=delay_ms)
                made.append(stack.enter_context(relay))
        yield made
