"""Runs over hosts, started on "here"."""

import json
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.hosts.cluster import ADDRESS, TlsCluster
from benchmarks.hosts.namespaces import Hosts
from tests.hosts.on_host import eventually
from tests.swarm.command import run

ROOT = Path(__file__).parents[2]


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

    def secrets_left(self) -> list[str]:
        """What lies there of keys and passwords of a run."""
        found: list[str] = []
        for host in self.hosts.each:
            names = ["(", "-name", "credentials", "-o", "-name", "key.pem", "-o", "-name", "users", ")"]
            words = ["find", str(host.disk), "-path", "*/acrc-*/*", *names]
            listed = subprocess.run(host.command(words), capture_output=True, text=True, check=True)
            found += listed.stdout.split()
        return found

    def folders_left(self) -> list[str]:
        """What lies on the hosts' disks, beside the cluster's own."""
        found = []
        for host in self.hosts.each:
            listed = subprocess.run(
                host.command(["ls", str(host.disk)]), capture_output=True, text=True, check=True
            )
            found += [name for name in listed.stdout.split() if name.startswith("acrc-")]
        return found


def digest_here(out: Path, *words: str) -> str:
    """Of the same run on one computer."""
    return str(run(out, *words, "--bus", "memory")["digest"])
