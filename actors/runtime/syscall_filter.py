"""The filter on system calls through which robots of one user could reach each other past the namespaces.

Namespaces hide what has a name. What is left is addressed by process number (signals, limits, priorities),
hangs on files that everyone may read (locks, watches, leases) or on the user (key rings), or is a socket
family that knows no network namespaces (vsock). One seccomp filter (seccomp(2), mode FILTER) refuses these,
and new namespaces and mounts with them.
"""

import ctypes
import os
import platform
from collections.abc import Sequence
from errno import EAFNOSUPPORT, ENOSYS, EPERM
from typing import Final, NamedTuple

from actors.runtime import linux

_NUMBERS: Final = {
    # name: (x86_64, aarch64), from the kernel's asm/unistd_64.h and asm-generic/unistd.h
    "add_key": (248, 217),
    "bpf": (321, 280),
    "chroot": (161, 51),
    "clone": (56, 220),
    "clone3": (435, 435),
    "fanotify_init": (300, 262),
    "fcntl": (72, 25),
    "flock": (73, 32),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fsopen": (430, 430),
    "fspick": (433, 433),
    "getpgid": (121, 155),
    "getsid": (124, 156),
    "inotify_add_watch": (254, 27),
    "io_uring_setup": (425, 425),
    "ioctl": (16, 29),
    "ioprio_set": (251, 30),
    "kcmp": (312, 272),
    "keyctl": (250, 219),
    "kill": (62, 129),
    "migrate_pages": (256, 238),
    "mount": (165, 40),
    "mount_setattr": (442, 442),
    "move_mount": (429, 429),
    "move_pages": (279, 239),
    "open_by_handle_at": (304, 265),
    "open_tree": (428, 428),
    "perf_event_open": (298, 241),
    "pidfd_getfd": (438, 438),
    "pidfd_open": (434, 434),
    "pidfd_send_signal": (424, 424),
    "pivot_root": (155, 41),
    "prlimit64": (302, 261),
    "process_madvise": (440, 440),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "ptrace": (101, 117),
    "request_key": (249, 218),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "sched_setaffinity": (203, 122),
    "sched_setattr": (314, 274),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "setns": (308, 268),
    "setpriority": (141, 140),
    "socket": (41, 198),
    "tgkill": (234, 131),
    "tkill": (200, 130),
    "umount2": (166, 39),
    "unshare": (272, 97),
}
_SPECIAL: Final = {
    "clone", "clone3", "io_uring_setup", "fcntl", "ioctl", "socket",
    "getpgid", "getsid", "kill", "pidfd_open", "prlimit64", "rt_sigqueueinfo", "rt_tgsigqueueinfo", "tgkill",
}  # fmt: skip
_ONLY_ITSELF: Final = ("kill", "pidfd_open", "rt_sigqueueinfo", "rt_tgsigqueueinfo", "tgkill")
_ONLY_ITSELF_OR_ZERO: Final = ("getpgid", "getsid", "prlimit64")
_NEW_NAMESPACES: Final = (
    linux.CLONE_NEWNS
    | linux.CLONE_NEWCGROUP
    | linux.CLONE_NEWUTS
    | linux.CLONE_NEWIPC
    | linux.CLONE_NEWUSER
    | linux.CLONE_NEWPID
    | linux.CLONE_NEWNET
)
_SOCKET_FAMILIES: Final = (1, 2, 10, 16)
"""AF_UNIX, AF_INET, AF_INET6, AF_NETLINK: confined by the network and mount namespaces."""
_FCNTL_REFUSED: Final = (6, 7, 37, 38, 8, 15, 1024, 1026)
"""F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW, F_SETOWN, F_SETOWN_EX, F_SETLEASE, F_NOTIFY (fcntl.h)."""
_IOCTL_REFUSED: Final = (0x8901, 0x8902, 0x5412)
"""FIOSETOWN, SIOCSPGRP: whom SIGIO goes to; TIOCSTI: typing into a terminal."""

_MACHINES: Final = {"x86_64": (0xC000_003E, 0), "aarch64": (0xC000_00B7, 1)}
"""AUDIT_ARCH_* (uapi audit.h) and the column of `_NUMBERS`."""
_X32_BIT: Final = 0x4000_0000

_LOAD, _IF_EQUAL, _IF_ANY_BIT, _IF_AT_LEAST, _RETURN = 0x20, 0x15, 0x45, 0x35, 0x06
_NUMBER_AT, _MACHINE_AT, _ARGUMENTS_AT = 0, 4, 16
_ALLOW: Final = 0x7FFF_0000
_REFUSE: Final = 0x0005_0000
_SECCOMP_MODE_FILTER: Final = 2


class Instruction(NamedTuple):
    """One instruction of classic BPF (`struct sock_filter`)."""

    code: int
    if_true: int
    if_false: int
    value: int


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_void_p))


def supported() -> bool:
    """True where the numbers of the system calls are known: x86_64 and aarch64."""
    return platform.machine() in _MACHINES


def install() -> None:
    """Put the filter over this process and all it starts; needs PR_SET_NO_NEW_PRIVS."""
    code = b"".join(
        i.code.to_bytes(2, "little") + bytes((i.if_true, i.if_false)) + i.value.to_bytes(4, "little")
        for i in program(platform.machine(), os.getpid())
    )
    buffer = ctypes.create_string_buffer(code, len(code))
    filter_ = _Program(len(code) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    linux.prctl(
        linux.PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, ctypes.cast(ctypes.byref(filter_), ctypes.c_void_p)
    )


def program(machine: str, pid: int) -> list[Instruction]:
    """The filter for `machine` ("x86_64", "aarch64") and the process `pid`, in order of its checks."""
    audit_name, column = _MACHINES[machine]
    code = [
        Instruction(_LOAD, 0, 0, _MACHINE_AT),
        Instruction(_IF_EQUAL, 1, 0, audit_name),
        _refuse(EPERM),
        Instruction(_LOAD, 0, 0, _NUMBER_AT),
    ]
    if machine == "x86_64":
        code += [Instruction(_IF_AT_LEAST, 0, 1, _X32_BIT), _refuse(ENOSYS)]
    bodies = {name: [_refuse(EPERM)] for name in _NUMBERS if name not in _SPECIAL}
    # clone3 and io_uring take their arguments from memory, where a filter cannot look; libc falls back.
    bodies |= {name: [_refuse(ENOSYS)] for name in ("clone3", "io_uring_setup")}
    bodies |= {name: _one_of(0, (pid,), EPERM) for name in _ONLY_ITSELF}
    bodies |= {name: _one_of(0, (0, pid), EPERM) for name in _ONLY_ITSELF_OR_ZERO}
    bodies["socket"] = _one_of(0, _SOCKET_FAMILIES, EAFNOSUPPORT)
    bodies["fcntl"] = _none_of(1, _FCNTL_REFUSED)
    bodies["ioctl"] = _none_of(1, _IOCTL_REFUSED)
    bodies["clone"] = [
        _argument(0),
        Instruction(_IF_ANY_BIT, 0, 1, _NEW_NAMESPACES),
        _refuse(EPERM),
        Instruction(_RETURN, 0, 0, _ALLOW),
    ]
    for name, body in bodies.items():
        code += [Instruction(_IF_EQUAL, 0, len(body), _NUMBERS[name][column]), *body]
    return [*code, Instruction(_RETURN, 0, 0, _ALLOW)]


def _argument(index: int) -> Instruction:
    """Load the low word of an argument: all arguments that are looked at are 32 bits wide in the kernel."""
    return Instruction(_LOAD, 0, 0, _ARGUMENTS_AT + 8 * index)


def _refuse(error: int) -> Instruction:
    return Instruction(_RETURN, 0, 0, _REFUSE | error)


def _one_of(index: int, values: Sequence[int], error: int) -> list[Instruction]:
    count = len(values)
    tests = [Instruction(_IF_EQUAL, count - i, 0, value) for i, value in enumerate(values)]
    return [_argument(index), *tests, _refuse(error), Instruction(_RETURN, 0, 0, _ALLOW)]


def _none_of(index: int, values: Sequence[int]) -> list[Instruction]:
    count = len(values)
    tests = [Instruction(_IF_EQUAL, count - i, 0, value) for i, value in enumerate(values)]
    return [_argument(index), *tests, Instruction(_RETURN, 0, 0, _ALLOW), _refuse(EPERM)]
