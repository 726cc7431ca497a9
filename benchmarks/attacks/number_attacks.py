"""Numbers that are given out to all, one after another: whoever draws many moves everybody's next one."""

import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.attacks.member import Note, Stage, SwarmMember

FILES = 500
BATCH = 1024
"""So many numbers a processor takes from the common counter at a time (fs/inode.c, LAST_INO_BATCH)."""
MUCH = 8
"""Batches that r1 takes to say 1."""
COOKIE_BATCH = 4096
SO_COOKIE = 57


def drawn(number: Callable[[], int], batch: int) -> tuple[Stage, ...]:
    """r1 draws many numbers of a common counter, and r2 sees its own have become larger by that."""

    def mine(_: SwarmMember, note: Note) -> Note:
        # More than a processor has in store; the largest, for who moves may end with another store's.
        last = max(number() for _times in range(2 * batch))
        step = last - note.get("number", last)
        return {"number": last, "reached": step > batch * MUCH // 2}

    def many(_: SwarmMember, __: Note) -> None:
        for _times in range(batch * MUCH):
            number()

    return (("r2", mine), ("r1", many), ("r2", mine))


def inode_of_pipe() -> int:
    """Of a new one."""
    out, into = os.pipe()
    number = os.fstat(out).st_ino
    os.close(out)
    os.close(into)
    return number


def cookie_of_socket() -> int:
    """Of a new one."""
    with socket.socket(socket.AF_UNIX) as one:
        return int.from_bytes(one.getsockopt(socket.SOL_SOCKET, SO_COOKIE, 8), sys.byteorder)


def make_files(member: SwarmMember, note: Note) -> None:
    """In one's own folder."""
    for _ in range(FILES):
        _made(member, note)


def see_number(member: SwarmMember, note: Note) -> Note:
    """Make one, and see how far its number is from that of the one before.

    ext4 gives out numbers that were freed before, and goes through them in either direction.
    """
    found = _made(member, note).stat().st_ino
    far = abs(found - note.get(member.name, found)) > FILES // 2
    return {member.name: found, "reached": note.get("reached", False) or far}


def _made(member: SwarmMember, note: Note) -> Path:
    path = member.folder / f"{note['token']}-{time.monotonic_ns()}"
    path.touch()
    return path
