"""Hosts: network namespaces, each with one link to a namespace called "here", where a coordinator runs.

Nothing of the machine's own network is touched. A host reaches here and nobody else; here reaches all. Each
namespace is anonymous and lives as long as its holder (`benchmarks.hosts.holder`), which ends with its maker.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from actors.installation.repository import REPOSITORY
from benchmarks.hosts.host import HERE, RigHost
from benchmarks.hosts.links import HostsError, lay_links
from benchmarks.hosts.members import leftovers, room

MOST: Final = 250
"""Hosts; each has a third number of the address to itself."""
_PATIENCE_S: Final = 30.0


class Hosts:
    """Hosts h1, h2, … and here; a context manager that leaves no process, namespace or link behind."""

    here: RigHost
    each: tuple[RigHost, ...]

    def __init__(self, count: int, *, disk_bytes: int = 0) -> None:
        """`disk_bytes`: the size of each host's own disk for temporary files; 0: they share the machine's.

        "Here" always shares it.
        """
        if not 1 <= count <= MOST:
            raise HostsError(f"hosts: {count}; must be 1 to {MOST}")
        if disk_bytes < 0:
            raise HostsError(f"the size of a host's disk: {disk_bytes}; must be 0 bytes or more")
        self._count = count
        self._disk_bytes = disk_bytes

    def __enter__(self) -> Self:
        """Raises HostsError where hosts cannot be made. What a killed earlier run has left is told."""
        _check()
        for one in leftovers():
            sys.stderr.write(f"acrc: left on a host by an earlier run that was killed: {one}\n")
        with ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="acrc-host-"))
            holders = [self._hold(stack, number, folder) for number in range(self._count + 1)]
            for number, holder in enumerate(holders):
                _await(number, holder)
            lay_links(holders[0].pid, [holder.pid for holder in holders[1:]])
            disk = Path(folder) if self._disk_bytes else None
            self.here, *others = (_host(number, holder.pid, disk) for number, holder in enumerate(holders))
            self.each = tuple(others)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _hold(self, stack: ExitStack, number: int, folder: str) -> subprocess.Popen[str]:
        size = self._disk_bytes if number else 0
        words = ("benchmarks.hosts.holder", _name(number), str(size), folder)
        holder = subprocess.Popen(
            [sys.executable, "-P", "-m", *words],
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for its maker, who then ends it
        )
        stack.callback(_release, number, holder)
        return holder


def _check() -> None:
    if os.geteuid() != 0:
        raise HostsError(
            f"hosts are network namespaces; user id {os.geteuid()} must be 0 (root) to make them"
        )
    for program, package in (("ip", "iproute2"), ("nsenter", "util-linux")):
        if shutil.which(program) is None:
            raise HostsError(f"the program {program} is not installed; to install it: apt install {package}")


def _name(number: int) -> str:
    return f"h{number}" if number else "here"


def _await(number: int, holder: subprocess.Popen[str]) -> None:
    assert holder.stdout is not None and holder.stderr is not None
    if holder.stdout.readline() != "ready\n":
        raise HostsError(f"host {_name(number)} cannot be made: {holder.stderr.read().strip()}")


def _release(number: int, holder: subprocess.Popen[str]) -> None:
    """End a host and all that runs on it. Raises HostsError where something goes on there."""
    try:
        _, said = holder.communicate(timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired:
        holder.kill()
        _, said = holder.communicate()
        said = f"its holder did not end within {_PATIENCE_S:g} s {said}"
    if holder.returncode > 0 and sys.exception() is None:
        raise HostsError(f"host {_name(number)}: {said.strip()}")


def _host(number: int, holder: int, disk: Path | None) -> RigHost:
    own = room(holder)
    if own is None or own == room(os.getpid()):
        raise HostsError(f"host {_name(number)} has ended already")
    if number == 0:
        return RigHost(_name(0), HERE, HERE, None, holder, own)
    return RigHost(_name(number), f"10.77.{number}.2", f"10.77.{number}.1", disk, holder, own)
