"""The table of running processes, and termination of process trees. Linux only; empty elsewhere."""

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
_USAGE: Final = re.compile(rb"^(RssAnon|RssShmem|VmPTE|VmSwap|HugetlbPages|Threads):\s+(\d+)", re.MULTILINE)
"""Lines of /proc/PID/status; sizes in KiB."""
_MAX_SWEEP_S: Final = 5.0
"""Timeout against a program that starts processes as fast as they are killed."""


class ProcessState(NamedTuple):
    """Status of one process, from /proc/PID/stat (proc(5))."""

    parent: int
    session: int
    state: str
    """R running or runnable, S and D sleeping, T and t stopped, Z zombie."""
    cpu_s: float
    """CPU time with that of waited-for children, s."""

    @property
    def stopped(self) -> bool:
        """True while stopped by a signal or a debugger."""
        return self.state in ("T", "t")


class ProcessUsage(NamedTuple):
    """Memory and threads of one process, from /proc/PID/status (proc_pid_status(5))."""

    memory: int
    """Bytes not backed by files: data, stacks, shared memory, page tables, swap. Memory shared with the
    parent since a fork counts for both."""
    threads: int


def processes() -> dict[int, ProcessState]:
    """Return the status of every visible process, by process id."""
    if not (_PROC / "self/stat").exists():
        return {}
    found = {
        int(entry.name): process_state(int(entry.name)) for entry in _PROC.iterdir() if entry.name.isdigit()
    }
    return {pid: one for pid, one in found.items() if one is not None}


def process_state(pid: int) -> ProcessState | None:
    """Return the status of a process; None if it has exited."""
    text = _read(pid, "stat")
    if not text:
        return None
    # The name in parentheses may contain anything; only numbers follow the last parenthesis.
    words = text.rpartition(b")")[2].split()
    cpu_ticks = sum(map(int, words[11:15]))
    return ProcessState(int(words[1]), int(words[3]), words[0].decode(), cpu_ticks / _TICKS_PER_S)


def process_usage(pid: int) -> ProcessUsage:
    """Return a process's memory and threads; zero if it has exited."""
    numbers = {name: int(number) for name, number in _USAGE.findall(_read(pid, "status"))}
    threads = numbers.pop(b"Threads", 0)
    return ProcessUsage(1024 * sum(numbers.values()), threads)


def _read(pid: int, name: str) -> bytes:
    """Read a process's file; empty if it has exited. Unbuffered for speed: there may be hundreds."""
    try:
        with open(f"/proc/{pid}/{name}", "rb", buffering=0) as file:  # noqa: PTH123
            return file.read()
    except OSError:
        return b""


def queued_s(pid: int) -> float | None:
    """Return how long a process's threads waited for a processor, s; None if unknown.

    From /proc/PID/task/TID/schedstat (Documentation/scheduler/sched-stats in the kernel's sources).
    """
    try:
        threads = list((_PROC / str(pid) / "task").iterdir())
        return sum(int((thread / "schedstat").read_text().split()[1]) for thread in threads) / 1e9
    except (OSError, IndexError, ValueError):
        return None


def children(parent: int, table: Mapping[int, ProcessState]) -> set[int]:
    """Return the children of a process."""
    return {pid for pid, one in table.items() if one.parent == parent}


def descendants(roots: Iterable[int], table: Mapping[int, ProcessState]) -> set[int]:
    """Return these processes and their descendants."""
    children_of: dict[int, list[int]] = {}
    for pid, one in table.items():
        children_of.setdefault(one.parent, []).append(pid)
    found: set[int] = set()
    waiting = [pid for pid in roots if pid in table]
    while waiting:
        pid = waiting.pop()
        if pid not in found:
            found.add(pid)
            waiting += children_of.get(pid, [])
    return found


def kill_orphans(orphans: Collection[int]) -> int:
    """Kill these children of this process with their descendants; return how many were running.

    This process must inherit orphans (PR_SET_CHILD_SUBREAPER) to find those that arise meanwhile.
    """
    ended: set[int] = set()
    pids = set(orphans)
    sessions: set[int] = set()
    deadline = time.monotonic() + _MAX_SWEEP_S
    while time.monotonic() < deadline:
        table = processes()
        # Only these families: unrelated orphans may arrive at the same moment.
        own_orphans = {
            pid for pid in children(os.getpid(), table) if pid in pids or table[pid].session in sessions
        }
        if not own_orphans:
            break
        family = descendants(own_orphans, table)
        running = {pid for pid in family if table[pid].state != "Z"}
        for number in (signal.SIGSTOP, signal.SIGKILL):  # a stopped process cannot start another
            for pid in running:
                _signal(pid, number)
        ended |= running
        pids |= family
        sessions |= {table[pid].session for pid in family} - {os.getsid(0)}
        for pid in own_orphans:
            _wait(pid)
        time.sleep(0.002)
    return len(ended)


def kill_sessions(leaders: Collection[int]) -> None:
    """Kill the remaining processes of the sessions led by these processes (setsid(2))."""
    for pid, one in processes().items():
        if one.session in leaders:
            _signal(pid, signal.SIGKILL)


def has_descendants() -> bool:
    """Return whether a descendant of this process is running."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:  # reap zombies
            pass
    if os.getppid() == 0:  # in a process namespace, whose processes /proc may not show
        try:
            os.kill(-1, 0)
        except ProcessLookupError:
            return False
        return True
    table, own_pid = processes(), os.getpid()
    return any(table[pid].state != "Z" for pid in descendants((own_pid,), table) - {own_pid})


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)


def _wait(pid: int) -> None:
    with contextlib.suppress(ChildProcessError):
        os.waitpid(pid, os.WNOHANG)


def leftover_fault(orphans: bool, initial_threads: Collection[threading.Thread] | None = None) -> str | None:
    """Return the fault of an actor that leaves processes or new threads; None: no fault."""
    if orphans:
        return f"its child processes were still running at its end: {_RULE}"
    if initial_threads is None:
        return None
    names = sorted(thread.name for thread in threading.enumerate() if thread not in initial_threads)
    shown = ", ".join(names)
    return f"its threads were still running at its end ({shown}): {_RULE}" if names else None


_RULE = "a strategy must not start processes or threads"


_NAMES: Final = frozenset(
    {
        "PATH", "HOME", "LANG", "LANGUAGE", "TZ", "TMPDIR", "TERM", "COLUMNS", "VIRTUAL_ENV",
        "LD_LIBRARY_PATH", "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "XDG_RUNTIME_DIR", "GLIBC_TUNABLES",
    }
)  # fmt: skip
_PREFIXES: Final = (
    "LC_", "PYTHON", "NUMBA_", "NPY_", "OPENBLAS_", "OMP_", "MKL_", "ZENOH_", "RERUN_", "WGPU_",
)  # fmt: skip
"""Prefixes of the variables of libraries that a run uses."""


def python_command() -> list[str]:
    """Return the command of this interpreter, with -P and the same -O."""
    return [sys.executable, "-P", *["-O"] * sys.flags.optimize]


def child_environment(shell: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of interpreter, libraries and viewer from the environment `shell`.

    All others are dropped: robots could read a key or password in them.
    """
    return {name: value for name, value in shell.items() if name in _NAMES or name.startswith(_PREFIXES)}
