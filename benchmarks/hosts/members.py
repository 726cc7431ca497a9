"""Which processes are on a host: those that share its namespace of the host name (uts_namespaces(7)).

A sandbox leaves the network and the mounts of its host, and keeps the host's name.
"""

import os
from pathlib import Path
from typing import Final

from actors.runtime.lifecycle import process_table

MARK: Final = "ACRC_HOST"
"""In the environment of whatever is started on a host: the host's name, and the process that made it."""
TITLE: Final = "acrc host "
"""What a holder is called, with the name of its host."""


def room(pid: int) -> str | None:
    """The namespace of a process, such as uts:[4026532193]; None if the process has ended."""
    try:
        return str(Path(f"/proc/{pid}/ns/uts").readlink())
    except OSError:
        return None


def members(of: str, holder: int) -> list[int]:
    """The processes of a room beside its holder; none if that is not its holder any more.

    A room lives as long as its holder. After that its number may be another room's.
    """
    if room(holder) != of:
        return []
    return [pid for pid in process_table.table() if pid != holder and room(pid) == of]


def leftovers() -> list[str]:
    """Who is on a host that has lost its holder, such as "h2 of 4711: sleep 9 (pid 4713)"."""
    here = room(os.getpid())
    rooms = {pid: room(pid) for pid in process_table.table()}
    held = {where for pid, where in rooms.items() if _words(pid, "cmdline").startswith(TITLE)}
    found = []
    for pid, where in sorted(rooms.items()):
        if where is None or where == here or where in held:
            continue
        mark = next((one for one in _words(pid, "environ").split("\0") if one.startswith(f"{MARK}=")), "")
        if mark:
            host, _, owner = mark.partition("=")[2].partition("@")
            said = _words(pid, "cmdline").replace("\0", " ").strip()
            found.append(f"{host} of {owner}: {said} (pid {pid})")
    return found


def _words(pid: int, name: str) -> str:
    """What a file of a process says; empty if there is none."""
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes().decode("utf-8", "replace")
    except OSError:
        return ""
