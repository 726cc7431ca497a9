"""Attacks over what the kernel counts for the whole machine or for all processes of a user."""

import ctypes
import mmap
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.file_attacks import FILTER
from benchmarks.attacks.member import Note, Stage, SwarmMember
from benchmarks.attacks.memory_attacks import OTHER_PAGES, PAGES, clear_pages, read_pages, view
from benchmarks.attacks.network_attacks import REPOSITORY, TREE, process
from benchmarks.attacks.number_attacks import (
    BATCH,
    COOKIE_BATCH,
    cookie_of_socket,
    drawn,
    inode_of_pipe,
    make_files,
    see_number,
)
from benchmarks.attacks.process_attacks import LIBC, PROCESSES, checked, who

LIMITS = "limits of its own"
EXCLUSIVE = 56
"""The bit of /proc/self/pagemap that says that no other process has mapped the page (pagemap.rst)."""
LIVE = (
    *(
        "stat",
        "vmstat",
        "loadavg",
        "schedstat",
        "interrupts",
        "softirqs",
        "zoneinfo",
        "buddyinfo",
        "slabinfo",
    ),
    *("locks", "diskstats", "swaps", "uptime", "mounts", "pressure/memory", "sys/fs/dentry-state"),
    *("sys/fs/inode-nr", "sys/fs/file-nr", "sys/kernel/random/entropy_avail", "self/stat", "self/statm"),
    *("self/status", "self/smaps", "self/smaps_rollup", "self/maps", "self/mountinfo", "self/fdinfo/1"),
    *("self/io", "self/sched", "self/oom_score", "self/net/unix", "1/stat", "thread-self/stat"),
)
SPACE = 64_000_000
TIMERS = 60
BARE = "from actors.runtime.lifecycle import linux\nlinux.drop_capabilities()\n"
"""Root's processes would be exempt from limits, and a robot is none."""
FILL_PIPES = """
import os, resource, sys
hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
pipes = [os.pipe() for _ in range(min(1100, hard // 2 - 10))]
print(len(pipes), flush=True)
sys.stdin.read()
"""
MEASURE_PIPE = """
import os
out, into = os.pipe()
os.set_blocking(into, False)
room = 0
try:
    while True:
        room += os.write(into, bytes(4096))
except BlockingIOError:
    print(room)
"""
FLY = """
import os, socket, sys
ends = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(int(sys.argv[1]))]
for sender, _ in ends:
    for _ in range(8):
        try:
            socket.send_fds(sender, [b"!"], [sender.fileno()] * 250)
        except OSError as error:
            print("full", error, flush=True)
            break
print("done", flush=True)
sys.stdin.read()
"""


def is_alone(path: Path) -> bool:
    """Whether nobody else has the file's first page in memory (/proc/self/pagemap)."""
    pages = view(path)
    assert int(pages[0])
    with Path("/proc/self/pagemap").open("rb", buffering=0) as table:
        table.seek(pages.ctypes.data // mmap.PAGESIZE * 8)
        return bool(int.from_bytes(table.read(8), sys.byteorder) >> EXCLUSIVE & 1)


def map_nothing(_: SwarmMember, __: Note) -> Note:
    """r1 says 0."""
    return {"alone": is_alone(PAGES)}


def map_page(member: SwarmMember, _: Note) -> None:
    """r1 says 1."""
    pages = view(PAGES)
    assert int(pages[0])
    member.ears.append(Mapped(pages))


class Mapped:
    """Something in memory until the attack is over."""

    def __init__(self, pages: object) -> None:
        self.pages = pages

    def close(self) -> None:
        """Let go of it."""
        self.pages = None


def read_bit(_: SwarmMember, note: Note) -> Note:
    """Read it."""
    return {"reached": note["alone"] and not is_alone(PAGES)}


def read_start(_: SwarmMember, note: Note) -> Note:
    """When the other was started."""
    return {"reached": bool(Path(f"/proc/{note['pid']}/stat").read_text().rpartition(")")[2].split()[19])}


def read_live(_: SwarmMember, __: Note) -> Note:
    """Any file of procfs or sysfs that changes while somebody works."""
    names = [Path("/proc", name) for name in LIVE]
    names += [*Path("/sys").rglob("cpuidle/state*/usage"), *Path("/sys/block").glob("*/stat")]
    names += [Path("/sys/kernel/mm/ksm/pages_shared"), Path("/dev/fd"), Path("/proc/self/fd")]
    return {"reached": any(os.access(name, os.R_OK) for name in names) or "MemFree" in _memory()}


def _memory() -> str:
    with suppress(OSError):
        return Path("/proc/meminfo").read_text()
    return ""


def ask_for_memory(_: SwarmMember, __: Note) -> Note:
    """Free memory and load of the machine (sysinfo(2))."""
    checked(LIBC.sysinfo(ctypes.create_string_buffer(256)), "sysinfo")
    return {"reached": True}


def ask_for_space(member: SwarmMember, note: Note) -> Note:
    """Free space where both keep their files (statvfs(3))."""
    disk = os.statvfs(member.folder)
    free = disk.f_bfree * disk.f_frsize
    return {"free": free, "reached": note.get("free", 0) - free > SPACE // 2}


def take_space(member: SwarmMember, _: Note) -> Note:
    """Take some of it."""
    path = member.folder / "own" if (member.folder / "own").is_dir() else member.folder
    with (path / "space").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, SPACE)
    return {"litter": [str(path / "space")]}


def faults_of_child(path: Path) -> int:
    """How often a disk had to be read for a child to touch the file (wait4(2))."""
    reading = "import mmap, sys; f = open(sys.argv[1], 'rb'); mmap.mmap(f.fileno(), 0, prot=1)[0]"
    found = list[int]()
    for one in (__file__, path):  # the first one also reads all of Python that this needs
        child = subprocess.Popen([sys.executable, "-S", "-c", reading, str(one)])
        found.append(os.wait4(child.pid, 0)[2].ru_majflt)
        child.returncode = 0
    return found[1]


def count_faults_of_child(_: SwarmMember, note: Note) -> Note:
    """Let a child touch the file that r1 has read and one that nobody has."""
    differ = faults_of_child(PAGES) == 0 < faults_of_child(OTHER_PAGES)
    return {"reached": note.get("reached", False) or differ}


def at_limit(take: Callable[[SwarmMember], None], most: int) -> tuple[Stage, ...]:
    """r1 takes all that the user may have of something, so that r2 gets none."""

    def one(member: SwarmMember, _: Note) -> None:
        take(member)

    def every(member: SwarmMember, _: Note) -> None:
        with suppress(OSError):
            for _times in range(most):
                take(member)

    def none_left(member: SwarmMember, _: Note) -> Note:
        try:
            take(member)
        except OSError:
            return {"reached": True}
        return {"reached": False}

    return (("r2", one), ("r1", every), ("r2", none_left))


def watch_nothing(member: SwarmMember) -> None:
    """inotify_init(2)."""
    member.keep(os.fdopen(checked(LIBC.inotify_init(), "inotify_init"), "rb", buffering=0))


class Timer:
    """A timer of the process (timer_create(2)), which takes one of the user's pending signals."""

    def __init__(self) -> None:
        self._id = ctypes.c_void_p()
        checked(LIBC.timer_create(1, None, ctypes.byref(self._id)), "timer_create")

    def close(self) -> None:
        """Delete it."""
        LIBC.timer_delete(self._id)


def set_timer(member: SwarmMember) -> None:
    """One timer, by somebody who holds himself to so many of all that the user may have."""
    hard = resource.getrlimit(resource.RLIMIT_SIGPENDING)[1]
    few = TIMERS if hard == resource.RLIM_INFINITY else min(TIMERS, hard)
    resource.setrlimit(resource.RLIMIT_SIGPENDING, (few, hard))
    member.kept.append(Timer())


class Queue:
    """A POSIX message queue, whose bytes are counted for the user."""

    def __init__(self) -> None:
        self._name = f"/{os.urandom(8).hex()}".encode()
        self._handle = checked(LIBC.mq_open(self._name, os.O_CREAT | os.O_RDWR, 0o600, None), "mq_open")

    def close(self) -> None:
        """Remove it."""
        os.close(self._handle)
        LIBC.mq_unlink(self._name)


def open_queue(member: SwarmMember) -> None:
    """One queue."""
    member.kept.append(Queue())


class Bare:
    """A child without capabilities that does something, says what came of it, and holds it."""

    def __init__(self, code: str, *arguments: str) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-c", BARE + code, *arguments],
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._child.stdout is not None
        self.lines = [self._child.stdout.readline().strip()]

    def close(self) -> None:
        """Let go of it."""
        self._child.communicate()


def measure_pipe(_: SwarmMember, note: Note) -> Note:
    """How much a new pipe takes: less, once the user's pipes together have what they may."""
    bare = Bare(MEASURE_PIPE)
    bare.close()
    room = int(bare.lines[0])
    return {"room": room, "reached": room < note.get("room", 0)}


def fill_pipes(member: SwarmMember, _: Note) -> None:
    """Have so many pipes."""
    member.kept.append(Bare(FILL_PIPES))


def fly(count: str) -> Callable[[SwarmMember, Note], Note]:
    """Send oneself descriptors and do not take them (unix(7), ETOOMANYREFS)."""

    def act(member: SwarmMember, note: Note) -> Note:
        bare = Bare(FLY, count)
        member.kept.append(bare)
        free = bare.lines[0] == "done"
        return {f"{member.name} may": free, "reached": note.get(f"{member.name} may", False) and not free}

    return act


def age(member: SwarmMember, _: Note) -> None:
    """Nobody has read the file for two days."""
    two_days_ago = time.time() - 2 * 86_400
    os.utime(Path(member.swarm.study, "strategy.py"), (two_days_ago, two_days_ago))


def read_code(member: SwarmMember, _: Note) -> None:
    """Read it."""
    Path(member.swarm.study, "strategy.py").read_bytes()


def see_reading(member: SwarmMember, _: Note) -> Note:
    """See that it has been read."""
    read = Path(member.swarm.study, "strategy.py").stat().st_atime
    return {"reached": time.time() - read < 86_400}


COUNTER_ATTACKS = (
    process(
        "who else has a page of a common file in memory",
        PROCESSES,
        ("r2", map_nothing),
        ("r1", map_page),
        ("r2", read_bit),
    ),
    process("start time of r2", PROCESSES, ("r2", who), ("r1", read_start)),
    process("counters of the machine in /proc and /sys", PROCESSES, ("r1", read_live)),
    process("free memory and load by sysinfo", FILTER, ("r1", ask_for_memory)),
    process(
        "free space on the common disk",
        FILTER,
        ("r2", ask_for_space),
        ("r1", take_space),
        ("r2", ask_for_space),
    ),
    process(
        "page cache by counting the page faults of a child",
        FILTER,
        *3 * (("world", clear_pages), ("r1", read_pages), ("r2", count_faults_of_child)),
    ),
    process("all watchers of the user", FILTER, *at_limit(watch_nothing, 10_000)),
    process("all queued signals of the user", LIMITS, *at_limit(set_timer, 2 * TIMERS)),
    process("all message queues of the user", LIMITS, *at_limit(open_queue, 10_000)),
    process(
        "all descriptors in flight of the user",
        FILTER,
        ("r2", fly("1")),
        ("r1", fly("400")),
        ("r2", fly("1")),
    ),
    process("numbers of sockets", FILTER, *drawn(cookie_of_socket, COOKIE_BATCH)),
    process("last reading of a common file", TREE, ("world", age), ("r1", read_code), ("r2", see_reading)),
    Attack("inode numbers of pipes", Layer.REMAINS, "nothing", drawn(inode_of_pipe, BATCH)),
    Attack(
        "inode numbers of files on the common disk",
        Layer.REMAINS,
        "nothing",
        (("r2", see_number), *3 * (("r1", make_files), ("r2", see_number))),
    ),
    Attack(
        "all room in pipes of the user",
        Layer.REMAINS,
        "nothing",
        (("r2", measure_pipe), ("r1", fill_pipes), ("r2", measure_pipe)),
    ),
)
