"""System call filter of a sandboxed robot (seccomp(2), mode FILTER).

It blocks calls that namespaces do not confine: file locks, leases and watches, key rings, the kernel log,
tracing, socket families without network namespaces (vsock), and new namespaces and mounts.
"""

import ctypes
import platform
from collections.abc import Sequence
from errno import EAFNOSUPPORT, ENOSYS, EPERM
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.runtime import linux

_FILE: Final = Path(__file__).with_name("syscalls.toml")
_NUMBERS: Final = msgspec.toml.decode(_FILE.read_bytes(), type=dict[str, tuple[int, ...]])
_MISSING: Final = ("clone3", "io_uring_setup")
"""Calls with arguments in memory, which a filter cannot read; callers fall back to older calls."""
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
_FCNTL_ALLOWED: Final = (0, 1, 2, 3, 4, 1030, 1032, 1033, 1034)
"""F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_DUPFD_CLOEXEC, F_GETPIPE_SZ, F_ADD_SEALS, F_GET_SEALS
(fcntl.h): they affect only the descriptor; locks, leases, owners and watches affect the file."""
_MACHINES: Final = {"x86_64": (0xC000_003E, 0), "aarch64": (0xC000_00B7, 1)}
"""AUDIT_ARCH_* (uapi audit.h) and the column of `_NUMBERS`."""
_FIRST_UNKNOWN: Final = 463
"""First unreviewed call: those from Linux 6.11 on, and those of x32."""

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
    """Return whether the system call numbers of this machine are known (x86_64, aarch64)."""
    return platform.machine() in _MACHINES


def install() -> None:
    """Filter this process and all its future children; requires PR_SET_NO_NEW_PRIVS."""
    load(program(platform.machine()))


def load(instructions: Sequence[Instruction]) -> None:
    """Add a filter to this process and all its future children."""
    code = b"".join(
        i.code.to_bytes(2, "little") + bytes((i.if_true, i.if_false)) + i.value.to_bytes(4, "little")
        for i in instructions
    )
    buffer = ctypes.create_string_buffer(code, len(code))
    filter_ = _Program(len(code) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    linux.prctl(
        linux.PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, ctypes.cast(ctypes.byref(filter_), ctypes.c_void_p)
    )


def program(machine: str) -> list[Instruction]:
    """Return the filter for `machine` ("x86_64", "aarch64")."""
    audit_name, column = _MACHINES[machine]
    code = [
        Instruction(_LOAD, 0, 0, _MACHINE_AT),
        Instruction(_IF_EQUAL, 1, 0, audit_name),
        _refuse(EPERM),
        Instruction(_LOAD, 0, 0, _NUMBER_AT),
        Instruction(_IF_AT_LEAST, 0, 1, _FIRST_UNKNOWN),
        _refuse(ENOSYS),
    ]
    conditions = {
        "fcntl": _one_of(1, _FCNTL_ALLOWED, EPERM),
        "socket": _one_of(0, _SOCKET_FAMILIES, EAFNOSUPPORT),
        "clone": [_argument(0), Instruction(_IF_ANY_BIT, 0, 1, _NEW_NAMESPACES), _refuse(EPERM), _ALLOWED],
    }
    for name, numbers in _NUMBERS.items():
        body = conditions.get(name, [_refuse(ENOSYS if name in _MISSING else EPERM)])
        if column < len(numbers):  # the machine has the call
            code += [Instruction(_IF_EQUAL, 0, len(body), numbers[column]), *body]
    return [*code, _ALLOWED]


def _one_of(index: int, values: Sequence[int], error: int) -> list[Instruction]:
    count = len(values)
    tests = [Instruction(_IF_EQUAL, count - i, 0, value) for i, value in enumerate(values)]
    return [_argument(index), *tests, _refuse(error), _ALLOWED]


def _argument(index: int) -> Instruction:
    """Load the low word of an argument; the arguments checked here have 32 bits in the kernel."""
    return Instruction(_LOAD, 0, 0, _ARGUMENTS_AT + 8 * index)


def _refuse(error: int) -> Instruction:
    return Instruction(_RETURN, 0, 0, _REFUSE | error)


_ALLOWED: Final = Instruction(_RETURN, 0, 0, _ALLOW)
