"""Starts robots on their hosts and everything else here; to whoever looks after a run it is one launcher."""

import select
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from actors.processes.launch import Child, Launcher, Program
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.process_table import ProcessGlance
from deploy.hosts.host_link import HostLink

_FIRST_TOLD_S: Final = 5.0
_UNLINKED_S: Final = 2.0
"""A link is broken if the mesh still is there so long afterwards: else it has ended as planned."""
_HERE: Final = 1 << 32
"""Process ids below are of this computer."""


class HostedLauncher:
    """Two kinds of launching, by the robots' names."""

    def __init__(
        self,
        here: Launcher,
        links: Sequence[HostLink],
        silence_s: float,
        say: Callable[[str], None],
        why_lost: Callable[[str], str],
    ) -> None:
        """`silence_s`: after so much of it a host is held to be lost. `why_lost`: what the cluster knows of a
        host's end; empty if that is nothing."""
        self._here = here
        self._links = links
        self._silence_s = silence_s
        self._say = say
        self._why_lost = why_lost
        self._of = {robot: link for link in links for robot in link.robots}
        self._world: Child | None = None
        """The mesh ends with it."""
        self._told_s = dict.fromkeys((link.name for link in links), _FIRST_TOLD_S)

    @property
    def arriving(self) -> bool:
        """What has ended somewhere is on its way here."""
        return any(link.arriving for link in self._links)

    def start(self, program: Program) -> Child:
        """StartRobot one program where it belongs."""
        link = self._of.get(program.actor)
        child = self._here.start(program) if link is None else link.start(program)
        if program.actor == "world":
            self._world = child
        return child

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Robots have it in common on their hosts, which were told; here is none."""

    def wait(self, timeout_s: float) -> None:
        """Return when something may have happened, at the latest after `timeout_s`. Raises LaunchError."""
        links = [link for link in self._links if link.connected and not link.lost]
        unsent = [link for link in links if link.unsent]
        select.select([self._here.fileno(), *(link.fileno() for link in links)], unsent, [], timeout_s)
        self._here.wait(0.0)
        for link in links:
            link.turn()
            self._tell(link)

    def fault(self) -> str | None:
        """A sentence on the first host because of which the run cannot go on; None if there is none."""
        for link in self._links:
            if link.fault:
                return f"host {link.name}: {link.fault}"
            if time.monotonic() > link.unlinked_s + _UNLINKED_S and self._mesh_is_there:
                return f"host {link.name}: its link to the mesh broke"
            if link.lost and not link.done:
                why = self._why_lost(link.name)
                return f"host {link.name} is lost, with {_names(link.robots)}: {link.lost}" + (
                    f"; {why}" if why else ""
                )
        return None

    @property
    def _mesh_is_there(self) -> bool:
        return self._world is not None and self._world.exit_code is None

    def table(self) -> Mapping[int, ProcessGlance]:
        """Every process of this machine, and of the hosts what belongs to the run."""
        found = process_table.table()
        for link in self._links:
            found.update(link.table())
        return found

    def queued_s(self, pid: int) -> float | None:
        """How long a process has waited for a processor, s; None where that is unknown."""
        if pid < _HERE:
            return process_table.queued_s(pid)
        return next((link.queued[pid] for link in self._links if pid in link.queued), None)

    def _tell(self, link: HostLink) -> None:
        """Say how long nothing has been heard of a host; give it up in the end."""
        if link.lost:
            return
        silent_s = link.silent_s
        if silent_s < _FIRST_TOLD_S:
            if self._told_s[link.name] > _FIRST_TOLD_S:
                self._say(f"host {link.name} is heard again")
            self._told_s[link.name] = _FIRST_TOLD_S
        elif silent_s >= self._silence_s:
            link.lose(f"nothing has been heard of it for {silent_s:.0f} s")
        elif silent_s >= self._told_s[link.name]:
            self._told_s[link.name] *= 2
            self._say(
                f"nothing has been heard of host {link.name} for {silent_s:.0f} s; the run waits for it"
            )


def _names(robots: tuple[str, ...]) -> str:
    return ", ".join(robots[:3]) + (f" and {len(robots) - 3} more" if len(robots) > 3 else "")
