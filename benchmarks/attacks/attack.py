"""What an attack is: a few stages, each carried out by one member of the swarm."""

import os
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from benchmarks.attacks.member import Note, Stage, SwarmMember


class Layer(IntEnum):
    """What closes a way between robots; a mode has its own layer and all weaker ones."""

    NONE = 0
    """Nothing: positive controls, which every swarm must let pass."""
    RULES = 1
    """Passwords and access rules of the router."""
    PROCESS = 2
    """The isolated process."""
    REMAINS = 3
    """Nothing that we have: a way that is known and stays open."""


class Attack(NamedTuple):
    """A way by which r1 tries to reach r2, or to be taken for somebody else.

    The stages end with a note `reached`; a refused system call or Zenoh call ends the attack before.
    """

    name: str
    layer: Layer
    closed_by: str
    """The mechanism, for the table in docs/isolation.md."""
    stages: tuple[Stage, ...]
    folder: str = ""
    """Only tried where this folder can be written to."""
    root: bool = False
    """Only tried by root, who alone has the means."""
    processors: int = 1
    """Only tried where there are so many."""
    traces: bool = False
    """Only tried where one may trace one's own processes (Yama's ptrace_scope)."""


def missing_means(attack: Attack) -> str | None:
    """Why this user could not carry out the attack even against an unprotected swarm; None if he could."""
    if attack.folder.startswith("/") and not os.access(attack.folder, os.W_OK):
        return f"{attack.folder} cannot be written to by this user"
    if attack.root and os.getuid() != 0:
        return "only root could do this"
    if len(os.sched_getaffinity(0)) < attack.processors:
        return f"needs {attack.processors} processors"
    yama = Path("/proc/sys/kernel/yama/ptrace_scope")
    if attack.traces and os.getuid() != 0 and yama.exists() and yama.read_text().strip() != "0":
        return "Yama forbids to trace one's own processes"
    return None


def eavesdrop(member: SwarmMember, _: Note) -> None:
    """Listen to everything, in the hope of being sent some of it."""
    member.listen("**")


def mark(member: SwarmMember, note: Note) -> None:
    """Say on an allowed key that all has been sent; what was sent before has then been dealt with."""
    member.session.put("swarm/up/r1/drive", f"mark {note['token']}")


def relay_mark(member: SwarmMember, note: Note) -> Note:
    """The world awaits r1's mark, tells both robots that it is over, and says whether it was told a lie."""
    member.await_payload(f"mark {note['token']}")
    fooled = member.has_heard(note["token"])
    for robot in member.swarm.robots:
        member.session.put(f"swarm/down/{robot}/senses", f"over {note['token']}")
    return {"reached": fooled}


def has_heard(member: SwarmMember, note: Note) -> Note:
    """Whether the token has come until it was over."""
    member.await_payload(f"over {note['token']}")
    return {"reached": note.get("reached", False) or member.has_heard(note["token"])}
