"""Decisions of the system call filter on each kind of processor."""

import errno
from collections.abc import Sequence

import pytest

from actors.runtime.isolation import syscall_filter
from actors.runtime.isolation.syscall_filter import Instruction


def decide(code: list[Instruction], machine: int, number: int, arguments: Sequence[int] = ()) -> int:
    """Run a filter by the rules of classic BPF and return its decision."""
    data = {0: number, 4: machine} | {16 + 8 * i: 0 for i in range(6)}
    data |= {16 + 8 * i: value & 0xFFFF_FFFF for i, value in enumerate(arguments)}
    accumulator, at = 0, 0
    while True:
        step = code[at]
        at += 1
        if step.code == 0x20:
            accumulator = data[step.value]
        elif step.code == 0x06:
            return step.value
        else:
            holds = {
                0x15: accumulator == step.value,
                0x35: accumulator >= step.value,
                0x45: bool(accumulator & step.value),
            }[step.code]
            at += step.if_true if holds else step.if_false


ALLOWED, REFUSED = 0x7FFF_0000, 0x5_0000
DECISIONS = (
    # x86_64, aarch64, arguments, error (0: allowed)
    (0, 63, (), 0),  # read
    (62, 129, (4711, 9), 0),  # kill: the process namespace confines it
    (56, 220, (0x0100_0011,), 0),  # clone
    (56, 220, (0x1000_0011,), errno.EPERM),  # CLONE_NEWUSER
    (56, 220, (0x0002_0011,), errno.EPERM),  # CLONE_NEWNS
    (435, 435, (), errno.ENOSYS),  # clone3
    (425, 425, (), errno.ENOSYS),  # io_uring_setup
    (41, 198, (1, 1), 0),  # socket
    (41, 198, (16, 3), 0),  # AF_NETLINK
    (41, 198, (40, 1), errno.EAFNOSUPPORT),  # AF_VSOCK
    (72, 25, (3, 1), 0),  # fcntl F_GETFD
    (72, 25, (3, 1030), 0),
    (72, 25, (3, 6), errno.EPERM),  # F_SETLK
    (72, 25, (3, 37), errno.EPERM),  # F_OFD_SETLK
    (72, 25, (3, 1024), errno.EPERM),  # F_SETLEASE
    (72, 25, (3, 4711), errno.EPERM),
    (73, 32, (3, 2), errno.EPERM),  # flock
    (294, 26, (), errno.EPERM),  # inotify_init1
    (250, 219, (), errno.EPERM),  # keyctl
    (101, 117, (16, 0), errno.EPERM),  # ptrace
    (310, 270, (), errno.EPERM),  # process_vm_readv
    (438, 438, (), errno.EPERM),  # pidfd_getfd
    (272, 97, (0, 0), errno.EPERM),  # unshare
    (165, 40, (0, 0), errno.EPERM),  # mount
    (103, 116, (3,), errno.EPERM),  # syslog
    (462, 462, (), 0),  # mseal, the last reviewed call
    (463, 463, (), errno.ENOSYS),
)


@pytest.mark.parametrize("case", DECISIONS)
def test_the_filter_decides_alike_on_both_machines(case: tuple[int, int, tuple[int, ...], int]) -> None:
    x86_64, aarch64, arguments, error = case
    intel = decide(syscall_filter.program("x86_64"), 0xC000_003E, x86_64, arguments)
    arm = decide(syscall_filter.program("aarch64"), 0xC000_00B7, aarch64, arguments)
    assert intel == arm == (REFUSED | error if error else ALLOWED)


def test_calls_of_other_machines_and_of_x32_are_refused() -> None:
    intel = syscall_filter.program("x86_64")
    assert decide(intel, 0x4000_0003, 20) == REFUSED | errno.EPERM
    assert decide(intel, 0xC000_003E, 0x4000_0000 + 165) == REFUSED | errno.ENOSYS
