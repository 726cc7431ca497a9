"""The links between here and each host."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from actors.runtime.errors import AcrcError
from benchmarks.hosts.host import HERE


class HostsError(AcrcError):
    """Hosts that cannot be made."""


def lay_links(here: int, others: Sequence[int]) -> None:
    """Lay a link from here to each; a host has a way to here, and none to other hosts.

    All are named by their holders. Raises HostsError, and changes nothing, where one is in this process's own
    network: that may be the machine's.
    """
    for holder in (here, *others):
        if _network(holder) == _network("self"):
            raise HostsError(f"process {holder} has no network of its own; must have one to hold a host")
    lines = ["link set lo up", f"address add {HERE}/32 dev lo"]
    for number, other in enumerate(others, 1):
        lines += (
            f"link add h{number} type veth peer name here netns {other}",
            f"address add 10.77.{number}.1/24 dev h{number}",
            f"link set h{number} up",
        )
    _ip(here, lines)
    for number, other in enumerate(others, 1):
        _ip(other, (
            "link set lo up",
            f"address add 10.77.{number}.2/24 dev here",
            "link set here up",
            f"route add {HERE}/32 via 10.77.{number}.1",
        ))  # fmt: skip


def _network(process: int | str) -> Path:
    return Path(f"/proc/{process}/ns/net").readlink()


def _ip(holder: int, lines: Sequence[str]) -> None:
    words = ["nsenter", f"--target={holder}", "--net", "ip", "-batch", "-"]
    done = subprocess.run(words, input="\n".join(lines) + "\n", capture_output=True, text=True, check=False)
    if done.returncode:
        raise HostsError(f"ip cannot lay the hosts' links: {' '.join(done.stderr.split())}")
