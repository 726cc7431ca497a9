"""Attacks over the tables of the kernel (processes, IPC, key rings), and ways out of isolation."""

import ctypes
import fcntl
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from actors.runtime.lifecycle import linux
from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.breakouts import NEST, UNDO
from benchmarks.attacks.file_attacks import FILTER
from benchmarks.attacks.member import Note, Stage, SwarmMember
from benchmarks.attacks.network_attacks import REPOSITORY, process

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.shmat.restype = ctypes.c_void_p
IPC = "system call filter, IPC namespace"
PROCESSES = "no /proc"
PIDS = "process namespace"
PROCESS_CLOCK = 2
"""CPUCLOCK_SCHED of a whole process (posix-timers.h)."""
KERNEL_LOG_READ_ALL = 3
IPC_CREAT = 0o1000
IPC_RMID = 0
SEM_SETVAL, SEM_GETVAL = 16, 12
USER_KEYRING = -4
KEYCTL_SEARCH = 10
SYSCALLS = {"x86_64": (248, 250, 438), "aarch64": (217, 219, 438)}
"""add_key, keyctl, pidfd_getfd."""
PTRACE_ATTACH, PTRACE_DETACH = 16, 17
F_SETOWN = 8
PR_SET_NAME = 15


def checked(result: int, what: str) -> int:
    """The result of a C function, or OSError."""
    if result == -1:
        raise OSError(ctypes.get_errno(), what)
    return result


def key_of(note: Note) -> int:
    """A System V key that both compute from the token."""
    return int(note["token"], 16) & 0x7FFF_FFFF


def share_memory(_: SwarmMember, note: Note) -> None:
    """Write the token to a System V segment."""
    segment = checked(LIBC.shmget(key_of(note), 4096, IPC_CREAT | 0o600), "shmget")
    address = LIBC.shmat(segment, None, 0)
    ctypes.memmove(address, note["token"].encode(), len(note["token"]))
    LIBC.shmdt(ctypes.c_void_p(address))


def find_memory(_: SwarmMember, note: Note) -> Note:
    """Read the segment and remove it."""
    segment = checked(LIBC.shmget(key_of(note), 4096, 0), "shmget")
    address = LIBC.shmat(segment, None, 0)
    text = ctypes.string_at(address, len(note["token"]))
    LIBC.shmdt(ctypes.c_void_p(address))
    LIBC.shmctl(segment, IPC_RMID, None)
    return {"reached": text.decode() == note["token"]}


def raise_semaphore(_: SwarmMember, note: Note) -> None:
    """Set a System V semaphore."""
    semaphores = checked(LIBC.semget(key_of(note), 1, IPC_CREAT | 0o600), "semget")
    checked(LIBC.semctl(semaphores, 0, SEM_SETVAL, 7), "semctl")


def find_semaphore(_: SwarmMember, note: Note) -> Note:
    """Read the semaphore and remove it."""
    semaphores = checked(LIBC.semget(key_of(note), 1, 0), "semget")
    value = LIBC.semctl(semaphores, 0, SEM_GETVAL)
    LIBC.semctl(semaphores, 0, IPC_RMID)
    return {"reached": value == 7}


def queue_message(_: SwarmMember, note: Note) -> None:
    """Put the token into a System V queue."""
    queue = checked(LIBC.msgget(key_of(note), IPC_CREAT | 0o600), "msgget")
    text = (1).to_bytes(8, sys.byteorder) + note["token"].encode()
    checked(LIBC.msgsnd(queue, text, ctypes.c_size_t(len(text) - 8), 0), "msgsnd")


def find_queue(_: SwarmMember, note: Note) -> Note:
    """Read the queue and remove it."""
    queue = checked(LIBC.msgget(key_of(note), 0), "msgget")
    buffer = ctypes.create_string_buffer(108)
    LIBC.msgrcv(queue, buffer, ctypes.c_size_t(100), ctypes.c_long(0), 0)
    LIBC.msgctl(queue, IPC_RMID, None)
    return {"reached": note["token"].encode() in buffer.raw}


def post_message(_: SwarmMember, note: Note) -> None:
    """Make a POSIX queue that bears the token."""
    name = f"/{note['token']}".encode()
    os.close(checked(LIBC.mq_open(name, os.O_CREAT | os.O_RDWR, 0o600, None), "mq_open"))


def find_post(_: SwarmMember, note: Note) -> Note:
    """Open the POSIX queue and remove it."""
    name = f"/{note['token']}".encode()
    os.close(checked(LIBC.mq_open(name, os.O_RDWR), "mq_open"))
    LIBC.mq_unlink(name)
    return {"reached": True}


def store_key(_: SwarmMember, note: Note) -> None:
    """Put the token into the user's key ring."""
    text = note["token"].encode()
    number = SYSCALLS[os.uname().machine][0]
    checked(LIBC.syscall(number, b"user", text, text, ctypes.c_size_t(len(text)), USER_KEYRING), "add_key")


def find_key(_: SwarmMember, note: Note) -> Note:
    """Search the user's key ring."""
    number = SYSCALLS[os.uname().machine][1]
    checked(LIBC.syscall(number, KEYCTL_SEARCH, USER_KEYRING, b"user", note["token"].encode(), 0), "keyctl")
    return {"reached": True}


def who(member: SwarmMember, _: Note) -> Note:
    """Tell one's process id."""
    return {"pid": member.pid, "environ": os.environ.get("SECRET", ""), "folder": str(member.folder)}


def await_signals(member: SwarmMember, _: Note) -> Note:
    """Note the signals that come."""
    for number in (signal.SIGUSR1, signal.SIGIO):
        signal.signal(number, lambda got, _: member.signals.append(got))
    return {"pid": member.pid}


def got_signal(member: SwarmMember, _: Note) -> Note:
    """Whether one has come."""
    return {"reached": bool(member.signals)}


def send_signal(_: SwarmMember, note: Note) -> None:
    """kill(2)."""
    os.kill(note["pid"], signal.SIGUSR1)


def send_by_descriptor(_: SwarmMember, note: Note) -> None:
    """pidfd_send_signal(2)."""
    handle = os.pidfd_open(note["pid"])
    signal.pidfd_send_signal(handle, signal.SIGUSR1)
    os.close(handle)


def send_by_socket(member: SwarmMember, note: Note) -> None:
    """Let the kernel signal the other when a socket of one's own becomes readable."""
    for end in socket.socketpair():
        member.keep(end)
    reader, writer = member.kept
    fcntl.fcntl(reader, F_SETOWN, note["pid"])
    fcntl.fcntl(reader, fcntl.F_SETFL, fcntl.fcntl(reader, fcntl.F_GETFL) | os.O_ASYNC)
    writer.send(b"!")


def set_limit(_: SwarmMember, note: Note) -> None:
    """Change a limit of the other."""
    soft, hard = resource.prlimit(note["pid"], resource.RLIMIT_NOFILE)
    resource.prlimit(note["pid"], resource.RLIMIT_NOFILE, (soft - 1, hard))


def limits(member: SwarmMember, note: Note) -> Note:
    """One's own limit, and whether it has changed since last asked."""
    now = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return {"pid": member.pid, "limit": now, "reached": note.get("limit", now) != now}


def set_niceness(_: SwarmMember, note: Note) -> None:
    """Change the other's priority."""
    os.setpriority(os.PRIO_PROCESS, note["pid"], os.getpriority(os.PRIO_PROCESS, note["pid"]) + 1)


def niceness(member: SwarmMember, note: Note) -> Note:
    """One's own priority, and whether it has changed since last asked."""
    now = os.getpriority(os.PRIO_PROCESS, 0)
    return {"pid": member.pid, "niceness": now, "reached": note.get("niceness", now) != now}


def set_scheduler(_: SwarmMember, note: Note) -> None:
    """Change the other's scheduling class."""
    os.sched_setscheduler(note["pid"], os.SCHED_BATCH, os.sched_param(0))


def scheduler(member: SwarmMember, _: Note) -> Note:
    """Whether one's own class has changed; back to the ordinary one."""
    changed = os.sched_getscheduler(0) == os.SCHED_BATCH
    if changed:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return {"pid": member.pid, "reached": changed}


def set_name(member: SwarmMember, note: Note) -> Note:
    """Use one's own name in the process table as a blackboard."""
    name = ctypes.create_string_buffer(note["token"][:15].encode())
    linux.prctl(PR_SET_NAME, ctypes.addressof(name))
    return {"pid": member.pid}


def proc(entry: str) -> Stage:
    """r1 reads an entry of /proc about r2 and finds what only r2 knows."""

    def act(_: SwarmMember, note: Note) -> Note:
        text = Path(f"/proc/{note['pid']}/{entry.format(**note)}").read_bytes().decode(errors="replace")
        return {"reached": any(word in text for word in (note["token"][:15], "SECRET=", "r2:"))}

    return ("r1", act)


def hold_memory(member: SwarmMember, note: Note) -> Note:
    """Hold the token in a file without a name and in memory."""
    diary = member.keep(tempfile.TemporaryFile(buffering=0))  # noqa: SIM115 — the member closes it
    diary.write(note["token"].encode())
    text = ctypes.create_string_buffer(note["token"].encode())
    member.signals.append(ctypes.addressof(text))
    MEMORY.append(text)
    return {"pid": member.pid, "handle": diary.fileno(), "address": ctypes.addressof(text)}


def read_command_line(_: SwarmMember, note: Note) -> Note:
    """See how the other was started."""
    return {"reached": bool(Path(f"/proc/{note['pid']}/cmdline").read_bytes())}


MEMORY: list[ctypes.Array[ctypes.c_char]] = []
"""Keeps the buffers of `hold_memory` where they are."""


def steal_descriptor(_: SwarmMember, note: Note) -> Note:
    """pidfd_getfd(2)."""
    process_handle = os.pidfd_open(note["pid"])
    number = SYSCALLS[os.uname().machine][2]
    handle = checked(LIBC.syscall(number, process_handle, note["handle"], 0), "pidfd_getfd")
    os.close(process_handle)
    with os.fdopen(handle, "rb", buffering=0) as file:
        file.seek(0)
        return {"reached": file.read().decode() == note["token"]}


class IoVector(ctypes.Structure):
    """struct iovec."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def read_memory(_: SwarmMember, note: Note) -> Note:
    """process_vm_readv(2)."""
    size = len(note["token"])
    buffer = ctypes.create_string_buffer(size)
    here, there = IoVector(ctypes.addressof(buffer), size), IoVector(note["address"], size)
    checked(
        LIBC.process_vm_readv(note["pid"], ctypes.byref(here), 1, ctypes.byref(there), 1, 0),
        "process_vm_readv",
    )
    return {"reached": buffer.raw.decode() == note["token"]}


def trace(_: SwarmMember, note: Note) -> Note:
    """ptrace(2)."""
    checked(LIBC.ptrace(PTRACE_ATTACH, note["pid"], None, None), "ptrace")
    os.waitpid(note["pid"], 0x4000_0000)
    LIBC.ptrace(PTRACE_DETACH, note["pid"], None, None)
    return {"reached": True}


def break_out(member: SwarmMember, note: Note) -> Note:
    """Undo the file tree in a nested user namespace."""
    ran = subprocess.run(
        [sys.executable, "-c", NEST + UNDO, str(REPOSITORY), note["token"], member.swarm.out],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=True,
    )
    reached = {"written", "r2"} & set(ran.stdout.split())
    return {"litter": [str(REPOSITORY / f".{note['token']}")], "reached": bool(reached)}


def remount(member: SwarmMember, note: Note) -> Note:
    """Make the tree writable again, and write."""
    path = REPOSITORY / f".{note['token']}"
    for folder in ("/", str(REPOSITORY)):
        try:
            linux.mount(None, folder, None, linux.MS_REMOUNT | linux.MS_BIND | linux.mount_flags(folder))
        except OSError:
            continue
    path.write_text(note["token"])
    return {"litter": [str(path)], "reached": True}


def read_clock(_: SwarmMember, note: Note) -> Note:
    """Read how much processor time the other has used."""
    return {"reached": time.clock_gettime((~note["pid"] << 3) | PROCESS_CLOCK) > 0}


def set_affinity(_: SwarmMember, note: Note) -> None:
    """Keep the other to one processor."""
    os.sched_setaffinity(note["pid"], {min(os.sched_getaffinity(0))})


def affinity(member: SwarmMember, note: Note) -> Note:
    """One's own processors, and whether they have changed since last asked; back to all of them."""
    now = sorted(os.sched_getaffinity(0))
    before = note.get("processors", now)
    if before != now:
        os.sched_setaffinity(0, before)
    return {"pid": member.pid, "processors": now, "reached": before != now}


def read_affinity(_: SwarmMember, note: Note) -> Note:
    """Ask which processors the other keeps to."""
    return {"reached": bool(os.sched_getaffinity(note["pid"]))}


def read_niceness(_: SwarmMember, note: Note) -> Note:
    """Ask for the other's priority."""
    os.getpriority(os.PRIO_PROCESS, note["pid"])
    return {"reached": True}


def read_kernel_log(_: SwarmMember, __: Note) -> Note:
    """Read the kernel's log, where a robot that crashes leaves a line (syslog(2))."""
    text = ctypes.create_string_buffer(4096)
    return {"reached": checked(LIBC.klogctl(KERNEL_LOG_READ_ALL, text, len(text)), "syslog") >= 0}


def read_environment(_: SwarmMember, __: Note) -> Note:
    """See what the user's shell knows."""
    told = Path("/proc/self/environ").read_bytes().decode(errors="replace")
    return {"reached": "SECRET=" in told or "SECRET" in os.environ}


def traced(name: str, closed_by: str, *stages: Stage) -> Attack:
    """An attack that needs the right to trace."""
    return Attack(name, Layer.PROCESS, closed_by, stages, traces=True)


PROCESS_ATTACKS = (
    process("System V shared memory", IPC, ("r1", share_memory), ("r2", find_memory)),
    process("System V semaphore", IPC, ("r1", raise_semaphore), ("r2", find_semaphore)),
    process("System V message queue", IPC, ("r1", queue_message), ("r2", find_queue)),
    process("POSIX message queue", IPC, ("r1", post_message), ("r2", find_post)),
    process("key ring of the user", FILTER, ("r1", store_key), ("r2", find_key)),
    process("signal", FILTER, ("r2", await_signals), ("r1", send_signal), ("r2", got_signal)),
    process(
        "signal by descriptor", FILTER, ("r2", await_signals), ("r1", send_by_descriptor), ("r2", got_signal)
    ),
    process(
        "signal by a socket's owner",
        FILTER,
        ("r2", await_signals),
        ("r1", send_by_socket),
        ("r2", got_signal),
    ),
    process("limits of r2", FILTER, ("r2", limits), ("r1", set_limit), ("r2", limits)),
    process("priority of r2", FILTER, ("r2", niceness), ("r1", set_niceness), ("r2", niceness)),
    process("scheduling class of r2", FILTER, ("r2", scheduler), ("r1", set_scheduler), ("r2", scheduler)),
    process("processor time of r2", PIDS, ("r2", who), ("r1", read_clock)),
    Attack(
        "processors of r2",
        Layer.PROCESS,
        PIDS,
        (("r2", affinity), ("r1", set_affinity), ("r2", affinity)),
        processors=2,
    ),
    process("asking for the processors of r2", PIDS, ("r2", who), ("r1", read_affinity)),
    process("asking for the priority of r2", PIDS, ("r2", who), ("r1", read_niceness)),
    Attack("log of the kernel", Layer.PROCESS, FILTER, (("r1", read_kernel_log),), root=True),
    process("secret in the user's environment", "chosen environment", ("r1", read_environment)),
    process("process name as a blackboard", PROCESSES, ("r2", set_name), proc("comm")),
    process("command line of r2", PROCESSES, ("r2", who), ("r1", read_command_line)),
    traced("environment of r2", PROCESSES, ("r2", who), proc("environ")),
    traced("/proc/…/root of r2", PROCESSES, ("r2", who), proc("root{folder}/credentials")),
    traced("/proc/…/cwd of r2", PROCESSES, ("r2", who), proc("cwd/r2/credentials")),
    traced("/proc/…/fd of r2", PROCESSES, ("r2", hold_memory), proc("fd/{handle}")),
    traced("descriptor taken from r2", FILTER, ("r2", hold_memory), ("r1", steal_descriptor)),
    traced("memory of r2", FILTER, ("r2", hold_memory), ("r1", read_memory)),
    traced("tracing r2", FILTER, ("r2", who), ("r1", trace)),
    process("remounting the tree", "no capabilities", ("r1", remount)),
    process("nested user namespace", FILTER, ("r1", break_out)),
)
