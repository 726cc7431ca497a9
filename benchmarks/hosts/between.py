"""Relays between hosts and a run here: what goes over a link is late, waits, or is lost."""

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

from benchmarks.hosts.host import HERE
from benchmarks.hosts.namespaces import Hosts
from benchmarks.hosts.relay_process import RelayProcess

_TOLD: Final = "10.77.99.1"
"""An address that nobody has: hosts are told it, and on each it is a relay's."""
_PORT: Final = 7450
LISTEN: Final = ("--listen", f"{_TOLD}:{_PORT}")
"""The words by which a run tells hosts to come by the relays."""


@contextmanager
def relayed(hosts: Hosts, delay_ms: float) -> Iterator[dict[str, tuple[RelayProcess, ...]]]:
    """By each host's name the relays to the run's two ports, with this delay each way."""
    with ExitStack() as stack:
        made: dict[str, tuple[RelayProcess, ...]] = {}
        for host in hosts.each:
            address = host.command(["ip", "address", "replace", f"{_TOLD}/32", "dev", "lo"])
            subprocess.run(address, check=True)
            relays = [
                RelayProcess(host, f"{_TOLD}:{port}", f"{HERE}:{port}", delay_ms=delay_ms)
                for port in (_PORT, _PORT + 1)
            ]
            made[host.name] = tuple(stack.enter_context(relay) for relay in relays)
        yield made
