"""The table of running processes, and the end of all descendants of one. On Linux; elsewhere it is empty."""

import contextlib
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

_PROC: Final = Path("/proc")
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_HELD: Final = re.compile(rb"^(RssAnon|RssShmem|VmPTE|VmSwap|HugetlbPages|Threads):\s+(\d+)", re.MULTILINE)
"""Lines of /proc/PID/status; sizes in KiB."""
_LONGEST_SWEEP_S: Final = 5.0
"""Limit of the pursuit of something that starts processes as fast as they are ended."""


class ProcessGlance(NamedTuple):
    """One process at one instant, from /proc/PID/stat (proc(5))."""

    parent: int
    session: int
    state: str
    """R running or waiting for a processor, S and D waiting, T and t stopped, Z ended."""
    cpu_s: float
    """With that of its children that have ended and been waited for."""

    @property
    def stopped(self) -> bool:
        """True while a signal or a debugger holds it."""
        return self.state in ("T", "t")


class Holding(NamedTuple):
    """Memory and threads of one process, from /proc/PID/status (proc_pid_status(5))."""

    memory: int
    """Bytes that no file backs: data and stacks, shared memory, page tables, swap. What it shares with its
    parent since the fork counts for both."""
    threads: int


def table() -> dict[int, ProcessGlance]:
    """Return every visible process by its id."""
    if not (_PROC / "self/stat").exists():
        return {}
    found = {int(entry.name): glance(int(entry.name)) for entry in _PROC.iterdir() if entry.name.isdigit()}
    return {pid: one for pid, one in found.items() if one is not None}


def glance(pid: int) -> ProcessGlance | None:
    """Return one process; None if it has ended."""
    text = _told(pid, "stat")
    if not text:
        return None
    # The name stands in parentheses and may hold anything; what follows the last one is numbers.
    words = text.rpartition(b")")[2].split()
    cpu_ticks = sum(map(int, words[11:15]))
    return ProcessGlance(int(words[1]), int(words[3]), words[0].decode(), cpu_ticks / _TICKS_PER_S)


def held(pid: int) -> Holding:
    """Return what a process holds; nothing if it has ended."""
    numbers = {name: int(number) for name, number in _HELD.findall(_told(pid, "status"))}
    threads = numbers.pop(b"Threads", 0)
    return Holding(1024 * sum(numbers.values()), threads)


def _told(pid: int, name: str) -> bytes:
    """Return a file of the process; nothing if it has ended. Some µs count: there may be hundreds."""
    try:
        with open(f"/proc/{pid}/{name}", "rb", buffering=0) as file:  # noqa: PTH123
            return file.read()
    except OSError:
        return b""


def queued_s(pid: int) -> float | None:
    """Return the waiting time of a process's threads for a processor, s; None where that is unknown.

    From /proc/PID/task/TID/schedstat (Documentation/scheduler/sched-stats in the kernel's sources).
    """
    try:
        threads = list((_PROC / str(pid) / "task").iterdir())
        return sum(int((thread / "schedstat").read_text().split()[1]) for thread in threads) / 1e9
    except (OSError, IndexError, ValueError):
        return None


def children(of: int, among: Mapping[int, ProcessGlance]) -> set[int]:
    """Return the children of a process."""
    return {pid for pid, one in among.items() if one.parent == of}


def descendants(of: Iterable[int], among: Mapping[int, ProcessGlance]) -> set[int]:
    """Return these processes and their descendants."""
    below: dict[int, list[int]] = {}
    for pid, one in among.items():
        below.setdefault(one.parent, []).append(pid)
    found: set[int] = set()
    waiting = [pid for pid in of if pid in among]
    while waiting:
        pid = waiting.pop()
        if pid not in found:
            found.add(pid)
            waiting += below.get(pid, [])
    return found


def end_orphans(heirs: Collection[int]) -> int:
    """End these children of this process with their descendants; return how many of them still ran.

    This process must inherit orphans (PR_SET_CHILD_SUBREAPER) to find those that arise on the way.
    """
    ended: set[int] = set()
    wanted = set(heirs)
    sessions: set[int] = set()
    deadline = time.monotonic() + _LONGEST_SWEEP_S
    while time.monotonic() < deadline:
        known = table()
        # Others may lose their parent at this moment, too: other families are left alone.
        own = {pid for pid in children(os.getpid(), known) if pid in wanted or known[pid].session in sessions}
        if not own:
            break
        family = descendants(own, known)
        living = {pid for pid in family if known[pid].state != "Z"}
        for number in (signal.SIGSTOP, signal.SIGKILL):  # nothing that is stopped starts another one
            for pid in living:
                _signal(pid, number)
        ended |= living
        wanted |= family
        sessions |= {known[pid].session for pid in family} - {os.getsid(0)}
        for pid in own:
            _wait(pid)
        time.sleep(0.002)
    return len(ended)


def end_sessions(leaders: Collection[int]) -> None:
    """End the rest of the sessions that these processes have begun (setsid(2))."""
    for pid, one in table().items():
        if one.session in leaders:
            _signal(pid, signal.SIGKILL)


def has_strays() -> bool:
    """Return whether a descendant of this process runs."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:  # what has only not been waited for
            pass
    if os.getppid() == 0:  # a process namespace of its own, whose other processes /proc need not show
        try:
            os.kill(-1, 0)
        except ProcessLookupError:
            return False
        return True
    known, me = table(), os.getpid()
    return any(known[pid].state != "Z" for pid in descendants((me,), known) - {me})


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)


def _wait(pid: int) -> None:
    with contextlib.suppress(ChildProcessError):
        os.waitpid(pid, os.WNOHANG)


def leftover_fault(strays: bool, at_first: Collection[threading.Thread] | None = None) -> str | None:
    """Return what is wrong with an actor that leaves processes, or other threads than `at_first`."""
    if strays:
        return f"processes of its own were still running at its end: {_RULE}"
    if at_first is None:
        return None
    names = sorted(thread.name for thread in threading.enumerate() if thread not in at_first)
    shown = ", ".join(names)
    return f"threads of its own were still running at its end ({shown}): {_RULE}" if names else None


_RULE = "a strategy must start neither processes nor threads"


_NAMES: Final = frozenset(
    {
        "PATH", "HOME", "LANG", "LANGUAGE", "TZ", "TMPDIR", "TERM", "COLUMNS", "VIRTUAL_ENV",
        "LD_LIBRARY_PATH", "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "XDG_RUNTIME_DIR", "GLIBC_TUNABLES",
    }
)  # fmt: skip
_PREFIXES: Final = (
    "LC_", "PYTHON", "NUMBA_", "NPY_", "OPENBLAS_", "OMP_", "MKL_", "ZENOH_", "RERUN_", "WGPU_",
)  # fmt: skip
"""Of the libraries that a run uses."""


def python() -> list[str]:
    """Return this interpreter's command, without the working directory on its path, with this -O."""
    return [sys.executable, "-P", *["-O"] * sys.flags.optimize]


def passed_on(shell: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of interpreter, libraries and viewer in the environment `shell`.

    No others: one may hold a key or password of the user's, and all robots can read it.
    """
    return {name: value for name, value in shell.items() if name in _NAMES or name.startswith(_PREFIXES)}
