"""Attacks over what the kernel keeps in memory of files that everyone may read."""

import ctypes
import mmap
import os
import resource
import threading
import time
from pathlib import Path

import numpy as np

from benchmarks.attacks.file_attacks import FILTER
from benchmarks.attacks.member import Note, SwarmMember
from benchmarks.attacks.network_attacks import REPOSITORY, process

LIBC = ctypes.CDLL(None, use_errno=True)
PAGES = REPOSITORY / "LICENSE"
"""Something that every robot may read and nobody else does just now."""
OTHER_PAGES = REPOSITORY / "docs" / "radio.md"
FUTEX = {"x86_64": 202, "aarch64": 98}
FUTEX_WAIT, FUTEX_WAKE = 0, 1
WAIT_S = 5
MEETING_S = 0.5


class Timespec(ctypes.Structure):
    """struct timespec."""

    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def view(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """The file in memory, not looked at yet."""
    with path.open("rb") as file:
        return np.frombuffer(mmap.mmap(file.fileno(), 0, mmap.MAP_SHARED, mmap.PROT_READ), np.uint8)


def evict(*paths: Path) -> None:
    """Take files out of memory (posix_fadvise(2)); only what the disk has can be."""
    for path in paths:
        with path.open() as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def is_in_memory(path: Path) -> bool:
    """Whether the file's first page is in memory (mincore(2))."""
    pages = view(path)
    answer = ctypes.create_string_buffer(1)
    if LIBC.mincore(ctypes.c_void_p(pages.ctypes.data), ctypes.c_size_t(mmap.PAGESIZE), answer) == -1:
        raise OSError(ctypes.get_errno(), "mincore")
    return bool(answer.raw[0] & 1)


def clear_pages(_: SwarmMember, __: Note) -> None:
    """The system happens to need the memory."""
    evict(PAGES, OTHER_PAGES)


def read_pages(_: SwarmMember, __: Note) -> None:
    """Read the file, which brings it into memory."""
    PAGES.read_bytes()


def ask_for_pages(_: SwarmMember, __: Note) -> Note:
    """Ask whether it is in memory."""
    return {"reached": is_in_memory(PAGES)}


def read_at_once(_: SwarmMember, __: Note) -> Note:
    """Read it only if that takes no time (preadv2(2), RWF_NOWAIT)."""
    with PAGES.open("rb") as file:
        try:
            return {"reached": os.preadv(file.fileno(), [bytearray(10)], 0, os.RWF_NOWAIT) == 10}
        except BlockingIOError:
            return {"reached": False}


def clear_common_pages(_: SwarmMember, __: Note) -> None:
    """Take a common file out of everybody's memory."""
    evict(PAGES)


def miss_pages(_: SwarmMember, __: Note) -> Note:
    """See that it is gone."""
    return {"reached": not is_in_memory(PAGES)}


def faults(path: Path) -> int:
    """How often a disk had to be read to touch the file."""
    pages = view(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_majflt
    assert int(pages[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_majflt - before


def count_faults(_: SwarmMember, __: Note) -> Note:
    """Touch the file that r1 has read and one that nobody has."""
    return {"reached": faults(PAGES) == 0 < faults(OTHER_PAGES)}


def wait_at_file(member: SwarmMember, _: Note) -> None:
    """Wait at an address in a common file (futex(2), not private)."""
    pages, number = view(PAGES), FUTEX[os.uname().machine]
    address, word = ctypes.c_void_p(pages.ctypes.data), int(pages[:4].view("<u4")[0])
    limit = Timespec(WAIT_S, 0)

    def wait() -> None:
        assert len(pages)  # stay where they are
        woken = LIBC.syscall(number, address, FUTEX_WAIT, word, ctypes.byref(limit), None, 0)
        member.signals.append(woken)

    threading.Thread(target=wait, daemon=True).start()


def wake_at_file(_: SwarmMember, __: Note) -> Note:
    """Wake whoever waits there, as soon as somebody does."""
    pages, number = view(PAGES), FUTEX[os.uname().machine]
    assert int(pages[0])  # an address that nothing is behind is nobody's
    deadline = time.monotonic() + MEETING_S
    woken = 0
    while not woken and time.monotonic() < deadline:
        woken = LIBC.syscall(number, ctypes.c_void_p(pages.ctypes.data), FUTEX_WAKE, 1, None, None, 0)
        time.sleep(0.001)
    return {"woken": woken}


def woken(member: SwarmMember, note: Note) -> Note:
    """Whether r2 was woken."""
    deadline = time.monotonic() + MEETING_S
    while not member.signals and time.monotonic() < deadline:
        time.sleep(0.001)
    return {"reached": note["woken"] == 1 and member.signals == [0]}


MEMORY_ATTACKS = (
    process(
        "page cache by mincore", FILTER, ("world", clear_pages), ("r1", read_pages), ("r2", ask_for_pages)
    ),
    process(
        "page cache by reading without waiting",
        FILTER,
        ("world", clear_pages),
        ("r1", read_pages),
        ("r2", read_at_once),
    ),
    process(
        "taking a common file out of the page cache",
        FILTER,
        ("r2", read_pages),
        ("r1", clear_common_pages),
        ("world", miss_pages),
    ),
    process(
        "page cache by counting page faults",
        FILTER,
        ("world", clear_pages),
        ("r1", read_pages),
        ("r2", count_faults),
    ),
    process("futex in a common file", FILTER, ("r2", wait_at_file), ("r1", wake_at_file), ("r2", woken)),
)
