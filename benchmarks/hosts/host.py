"""One host, as those who use it see it: its addresses, and how something runs there."""

import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.hosts.members import MARK, members

HERE: Final = "10.77.0.1"
"""The address of "here", the same for all hosts."""
_ENTER: Final = 'exec nsenter --target="$0" --net --uts --mount env --chdir="$PWD" "$@"'
"""nsenter and env become the program, so a signal to the process is one to the program. Entering the mounts
leads to the root folder: the shell knows where the caller was."""


@dataclass(frozen=True)
class RigHost:
    """One host: where it is, and how to run something on it."""

    name: str
    """Its host name: here, h1, h2, …"""
    address: str
    here_address: str
    """Where it reaches a program that listens here on its link only; all hosts reach one at HERE."""
    disk: Path | None
    """The folder for temporary files, a small disk of its own; None: it shares the machine's."""
    holder: int
    room: str

    def command(self, words: Sequence[str]) -> list[str]:
        """The command that runs `words` on it, in the caller's folder; the process is the program's own."""
        disk = () if self.disk is None else (f"TMPDIR={self.disk}",)
        mark = f"{MARK}={self.name}@{os.getpid()}"
        return ["sh", "-c", _ENTER, str(self.holder), mark, *disk, *words]

    def processes(self) -> list[int]:
        """The ids of all processes on it."""
        return members(self.room, self.holder)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to every process on it, also to those that come meanwhile."""
        told: set[int] = set()
        while new := set(self.processes()) - told:
            for pid in new:
                with suppress(ProcessLookupError):
                    os.kill(pid, number)
            told |= new
