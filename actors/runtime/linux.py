"""Linux system calls missing in Python 3.11, and the start and end of processes.

Each raises OSError naming the call. Constants are from the kernel's uapi headers (sched.h, mount.h, prctl.h,
capability.h).
"""

import contextlib
import ctypes
import faulthandler
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

CLONE_NEWNS: Final = 0x0002_0000
CLONE_NEWCGROUP: Final = 0x0200_0000
CLONE_NEWUTS: Final = 0x0400_0000
CLONE_NEWIPC: Final = 0x0800_0000
CLONE_NEWUSER: Final = 0x1000_0000
CLONE_NEWPID: Final = 0x2000_0000
CLONE_NEWNET: Final = 0x4000_0000

MS_RDONLY: Final = 0x1
MS_NOSUID: Final = 0x2
MS_NODEV: Final = 0x4
MS_NOEXEC: Final = 0x8
MS_REMOUNT: Final = 0x20
MS_NOATIME: Final = 0x400
MS_NODIRATIME: Final = 0x800
MS_BIND: Final = 0x1000
MS_REC: Final = 0x4000
MS_PRIVATE: Final = 0x4_0000
MS_RELATIME: Final = 0x20_0000
MS_STRICTATIME: Final = 0x100_0000

_ST_RELATIME: Final = 0x1000
_SYS_PIVOT_ROOT: Final = {"x86_64": 155, "aarch64": 41}

MNT_DETACH: Final = 0x2
_FALLOC_FL_KEEP_SIZE: Final = 0x1

PR_SET_PDEATHSIG: Final = 1
_PR_SET_NAME: Final = 15
PR_SET_SECCOMP: Final = 22
PR_SET_CHILD_SUBREAPER: Final = 36
_PR_CAPBSET_DROP: Final = 24
_PR_SET_NO_NEW_PRIVS: Final = 38
_PR_CAP_AMBIENT: Final = 47
_PR_CAP_AMBIENT_CLEAR_ALL: Final = 4
_CAPABILITY_VERSION_3: Final = 0x2008_0522
_CAPABILITIES: Final = 64
"""Number of capabilities in version 3."""


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(result: int, what: str) -> int:
    if result == -1:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return result


def unshare(flags: int) -> None:
    """Move this process to new namespaces (unshare(2))."""
    _checked(_libc().unshare(flags), "unshare of user, network, mount, IPC and process namespaces")


def mount(source: str | None, target: str | Path, kind: str | None, flags: int, options: str = "") -> None:
    """Mount, bind, move or remount (mount(2))."""
    place = os.fsencode(target)
    result = _libc().mount(
        None if source is None else os.fsencode(source),
        place,
        None if kind is None else kind.encode(),
        ctypes.c_ulong(flags),
        options.encode() or None,
    )
    _checked(result, f"mount on {target}")


def mount_flags(path: str | Path) -> int:
    """Return the mount flags at `path` to repeat in a remount; without MS_RDONLY."""
    found = os.statvfs(path).f_flag
    flags = found & (MS_NOSUID | MS_NODEV | MS_NOEXEC | MS_NOATIME | MS_NODIRATIME)
    if found & _ST_RELATIME:
        return flags | MS_RELATIME
    return flags if flags & MS_NOATIME else flags | MS_STRICTATIME


def pivot_root(root: str | Path) -> None:
    """Make the mount at `root` the root of this process, and detach the former one (pivot_root(2))."""
    os.chdir(root)
    number = ctypes.c_long(_SYS_PIVOT_ROOT[os.uname().machine])
    _checked(_libc().syscall(number, b".", b"."), f"pivot_root to {root}")
    _checked(_libc().umount2(b".", MNT_DETACH), "umount of the former root")
    os.chdir("/")


def allocate(descriptor: int, size: int) -> None:
    """Allocate the first `size` bytes of a file on disk without changing its length (fallocate(2))."""
    result = _libc().fallocate(
        descriptor, _FALLOC_FL_KEEP_SIZE, ctypes.c_longlong(0), ctypes.c_longlong(size)
    )
    _checked(result, "fallocate")


def prctl(option: int, argument: int = 0, more: int | ctypes.c_void_p = 0) -> None:
    """Change a property of this process (prctl(2))."""
    last = more if isinstance(more, ctypes.c_void_p) else ctypes.c_ulong(more)
    result = _libc().prctl(option, ctypes.c_ulong(argument), last, ctypes.c_ulong(0), ctypes.c_ulong(0))
    _checked(result, f"prctl option {option}")


def set_title(title: str) -> None:
    """Set the process name and command line shown by ps and top, truncated to the available space.

    Overwrites the command line in memory (arg_start in /proc/PID/stat, proc(5)).
    """
    name = ctypes.create_string_buffer(title.encode()[:15])
    prctl(_PR_SET_NAME, ctypes.addressof(name))
    if (place := _command_line()) is None:
        return
    start, end = place
    ctypes.memset(start, 0, end - start)
    ctypes.memmove(start, title.encode(), min(len(title.encode()), end - start - 1))


@cache
def _command_line() -> tuple[int, int] | None:
    """Return the command line's start and end in memory, also for forks without /proc; None under qemu."""
    numbers = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    return (int(numbers[45]), int(numbers[46])) if len(numbers) > 46 else None


def drop_capabilities() -> None:
    """Drop all capabilities, also for programs executed later (capabilities(7))."""
    for capability in range(_CAPABILITIES):
        with contextlib.suppress(OSError):  # EINVAL beyond the kernel's last capability
            prctl(_PR_CAPBSET_DROP, capability)
    prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION_3, 0)
    nothing = (ctypes.c_uint32 * 6)()
    _checked(_libc().capset(header, nothing), "capset")
    prctl(_PR_SET_NO_NEW_PRIVS, 1)


LOG_RESERVE: Final = 8192
"""Bytes allocated beyond the end of a log, for the reason of a failure on a full disk."""


def create_log(path: Path) -> int:
    """Create a log for appending; return its descriptor. FileExistsError if the path exists, even as link."""
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_APPEND, 0o644)
    reserve_log_space(log)
    return log


def reserve_log_space(log: int) -> None:
    """Extend the space reserved for a log, as far as the disk has space."""
    if sys.platform == "linux":
        with suppress(OSError):  # full disk, no fallocate, or not a file
            allocate(log, os.fstat(log).st_size + LOG_RESERVE)


def redirect_output(log: int) -> None:
    """Redirect this process's standard output and error to an open log."""
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)


class Termination(SystemExit):
    """Exit on SIGTERM."""


def die_with_parent(parent: int, number: signal.Signals = signal.SIGKILL) -> None:
    """Send this process the signal `number` when its parent, the process `parent`, exits.

    Call it in the main thread, after `isolate`: a change of user or capabilities clears the setting
    (prctl(2), PR_SET_PDEATHSIG). The parent counts as exited when the *thread* that started this process
    exits. Outside Linux only a parent that has already exited is noticed.
    """
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def exit_on_sigterm() -> None:
    """Raise Ended on SIGTERM, so that sockets, files and sessions are closed."""

    def leave(number: int, frame: FrameType | None) -> None:
        raise Termination(128 + number)

    signal.signal(signal.SIGTERM, leave)


def exit_now(code: int) -> NoReturn:
    """Exit immediately, without waiting for the user's threads or a full disk."""
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def enable_stack_dumps() -> None:
    """Dump the stack to standard error on SIGUSR1, even in an endless loop, and on a crash."""
    faulthandler.enable(file=2)
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=True)


# Only a child can enter a new process namespace (pid_namespaces(7)). So the started process becomes the
# keeper outside, and the robot continues in a child, process 2 of the namespace. Process 1 is another child:
# when it exits, the kernel kills all processes of the namespace.

_FORWARDED: Final = (
    signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2,
)  # fmt: skip
_keeper_cpu_s: list[float] = []
"""CPU time of this process's keepers, s."""


def enter_namespace(parent: int | None, prepare: Callable[[], None], private: Collection[int]) -> None:
    """Continue in a child, alone in a new process namespace; this process becomes its keeper.

    Returns in the child. Call it after unshare(CLONE_NEWPID), with a single thread, and without open
    descriptors that the namespace must not share. The keeper first calls `prepare`, which must exit on
    failure; only the keeper keeps the descriptors `private`. It forwards signals, and exits like the child
    once the namespace is empty. The namespace ends with the keeper and with `parent` (a process id; None: no
    parent).
    """
    sys.stdout.flush()
    sys.stderr.flush()
    spent = cpu_s()
    pulse, lifeline = os.pipe()
    nothing = os.open(os.devnull, os.O_RDWR)  # before /dev is replaced
    first = os.fork()
    if first == 0:
        for handle in (lifeline, *private):
            os.close(handle)
        _run_init(pulse, nothing)
    child = os.fork()
    if child == 0:
        for handle in (pulse, lifeline, nothing, *private):
            os.close(handle)
        os.setsid()  # keeps signals to its group from the keeper's group
        _keeper_cpu_s.append(spent)
        return
    os.close(pulse)
    try:
        prepare()
        status = _run_keeper(child, nothing, parent)
    finally:  # the keeper must never return into the robot's program
        os.close(lifeline)
        os.waitpid(first, 0)
    _exit_alike(status)


def add_cpu_s(seconds: float) -> None:
    """Add a keeper's CPU time to `cpu_s`."""
    _keeper_cpu_s.append(seconds)


def cpu_s() -> float:
    """Return the CPU time of this process and its keepers, s."""
    return time.process_time() + sum(_keeper_cpu_s)


def _run_init(pulse: int, nothing: int) -> NoReturn:
    """Run as process 1: reap orphans by ignoring SIGCHLD; exit with the keeper."""
    try:
        os.setsid()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        _release_log(nothing)
        os.read(pulse, 1)
    finally:
        os._exit(0)


def _run_keeper(child: int, nothing: int, parent: int | None) -> int:
    """Wait for the child; return its status."""
    for number in _FORWARDED:
        signal.signal(number, lambda got, _: os.kill(child, got))
    _release_log(nothing)
    if parent is not None:
        die_with_parent(parent)
    return os.waitpid(child, 0)[1]


def _release_log(nothing: int) -> None:
    """Release log and working directory."""
    os.chdir("/")
    for number in (0, 1, 2):
        os.dup2(nothing, number)


def _exit_alike(status: int) -> NoReturn:
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if -code not in {signal.SIGKILL, signal.SIGSTOP}:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code if code >= 0 else 128 - code)
