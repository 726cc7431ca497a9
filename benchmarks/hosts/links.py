"""The links between here and each host."""

import subprocess
from collections.abc import Sequence

from actors.runtime.errors import AcrcError
from benchmarks.hosts.host import HERE


class HostsError(AcrcError):
    """Hosts that cannot be made."""


def lay_links(here: int, others: Sequence[int]) -> None:
    """Lay a link from here to each; a host has a way to here, and none to other hosts."""
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


def _ip(holder: int, lines: Sequence[str]) -> None:
    words = ["nsenter", f"--target={holder}", "--net", "ip", "-batch", "-"]
    done = subprocess.run(words, input="\n".join(lines) + "\n", capture_output=True, text=True, check=False)
    if done.returncode:
        raise HostsError(f"ip cannot lay the hosts' links: {' '.join(done.stderr.split())}")
