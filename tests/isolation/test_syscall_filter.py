"""What the filter of system calls decides, on each kind of processor."""

import errno
from collections.abc import Sequence

import pytest

from actors.runtime.isolation import syscall_filter
from actors.runtime.isolation.syscall_filter import Instruction


def decide(code: list[Instruction], machine: int, number: int, arguments: Sequence[int] = ()) -> int:
    """Run a filter by the rules of classic BPF and give its decision."""
    data = {0: number, 4: machine} | {16 + 8 * i: 0 for i in range(6)}
    data |= {16 + 8 * i: value & 0xFFFF_FFFF for i, value in enumerate(arguments)}
    data |= {20 + 8 * i: (arguments[i] if i < len(arguments) else 0) >> 32 for i in range(6)}
    accumulator, at = 0, 0
    while True:
        step = code[at]
        at += 1
        if step.code == 0x20:
            accumulator = data[step.value]
        elif step.code == 0x54:
            accumulator &= step.value
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
    (62, 129, (4711, 9), 0),  # kill: nobody but its own children can be named
    (56, 220, (0x0100_0011,), 0),  # clone
    (56, 220, (0x1000_0011,), errno.EPERM),
    (56, 220, (0x0002_0011,), errno.EPERM),
    (435, 435, (), errno.ENOSYS),  # clone3
    (425, 425, (), errno.ENOSYS),  # io_uring_setup
    (206, 0, (), errno.ENOSYS),  # io_setup
    (437, 437, (), errno.ENOSYS),  # openat2
    (41, 198, (1, 1), 0),  # socket
    (41, 198, (40, 1), errno.EAFNOSUPPORT),
    (72, 25, (3, 1), 0),  # fcntl F_GETFD…
    (72, 25, (3, 1030), 0),
    (72, 25, (3, 1031), errno.EPERM),  # F_SETPIPE_SZ, F_GETPIPE_SZ
    (72, 25, (3, 1032), errno.EPERM),
    (72, 25, (3, 6), errno.EPERM),  # F_SETLK…
    (72, 25, (3, 1024), errno.EPERM),
    (72, 25, (3, 1036), errno.EPERM),  # F_SET_RW_HINT
    (72, 25, (3, 4711), errno.EPERM),  # what is yet to be invented
    (16, 29, (1, 0x5401), 0),  # ioctl
    (16, 29, (1, 0x5412), errno.ENOTTY),
    (16, 29, (3, 0xC020_660B), errno.ENOTTY),  # FS_IOC_FIEMAP
    (41, 198, (16, 3, 0), 0),  # AF_NETLINK: routes
    (41, 198, (16, 3, 4), errno.EAFNOSUPPORT),  # sock_diag
    (55, 209, (3, 1, 4), 0),  # getsockopt: SO_ERROR
    (55, 209, (3, 1, 57), errno.ENOPROTOOPT),  # SO_COOKIE
    (46, 211, (3,), errno.EPERM),  # sendmsg
    (61, 260, (-1 & 0xFFFF_FFFF, 0, 1, 0), 0),  # wait4
    (61, 260, (7, 0, 1, 0x7FFF_0000_0000), errno.EPERM),
    (61, 260, (7, 0, 1, 0x1000), errno.EPERM),
    (247, 95, (0, 7, 0, 4, 0), 0),  # waitid
    (247, 95, (0, 7, 0, 4, 0x7FFF_0000_0000), errno.EPERM),
    (98, 165, (0,), errno.EPERM),  # getrusage
    (99, 179, (), errno.EPERM),  # sysinfo
    (137, 43, (), errno.EPERM),  # statfs
    (138, 44, (), errno.EPERM),  # fstatfs
    (237, 235, (), errno.EPERM),  # mbind
    (239, 236, (), errno.EPERM),  # get_mempolicy
    (294, 26, (), errno.EPERM),  # inotify_init1
    (323, 282, (), errno.EPERM),  # userfaultfd
    (324, 283, (), errno.EPERM),  # membarrier
    (462, 462, (), 0),  # mseal, the last one that was looked at
    (463, 463, (), errno.ENOSYS),
    (73, 32, (3, 2), errno.EPERM),  # flock
    (101, 117, (16, 0), errno.EPERM),  # ptrace
    (272, 97, (0, 0), errno.EPERM),  # unshare
    (165, 40, (0, 0), errno.EPERM),  # mount
    (27, 232, (), errno.EPERM),  # mincore
    (451, 451, (), errno.EPERM),  # cachestat
    (103, 116, (3,), errno.EPERM),  # syslog
    (327, 286, (3, 0, 1, 0, 0, 0), 0),  # preadv2
    (327, 286, (3, 0, 1, 0, 0, 8), errno.EOPNOTSUPP),
    (221, 223, (3, 0, 0, 3), 0),  # fadvise64
    (221, 223, (3, 0, 0, 4), errno.EPERM),
    (28, 233, (0, 4096, 4), 0),  # madvise
    (28, 233, (0, 4096, 14), 0),
    *((28, 233, (0, 4096, advice), errno.EINVAL) for advice in (9, 12, 20, 21, 22, 25, 101, 103, 4711)),
    (202, 98, (0, 128), 0),  # futex: private wait, wake
    (202, 98, (0, 129), 0),
    (202, 98, (0, 128 | 256 | 9), 0),
    (202, 98, (0, 0), errno.EAGAIN),  # shared wait
    (202, 98, (0, 256 | 9), errno.EAGAIN),
    (202, 98, (0, 1), 0),  # shared wake
    (202, 98, (0, 10), 0),
    (202, 98, (0, 6), errno.ENOSYS),  # shared lock with inheritance
    (91, 52, (3, 0o755), 0),  # fchmod
    (91, 52, (3, 0o4755), errno.EPERM),
    (268, 53, (3, 0, 0o2755), errno.EPERM),  # fchmodat
    (259, 33, (3, 0, 0o104755), errno.EPERM),  # mknodat
    (257, 56, (3, 0, 0, 0o4755), 0),  # openat that creates nothing
    (257, 56, (3, 0, 0o101, 0o755), 0),
    (257, 56, (3, 0, 0o101, 0o4755), errno.EPERM),
    (257, 56, (3, 0, 0o20200002, 0o4755), errno.EPERM),  # O_TMPFILE
)


@pytest.mark.parametrize("case", DECISIONS)
def test_the_filter_decides_alike_on_both_machines(case: tuple[int, int, tuple[int, ...], int]) -> None:
    x86_64, aarch64, arguments, error = case
    intel = decide(syscall_filter.program("x86_64"), 0xC000_003E, x86_64, arguments)
    arm = decide(syscall_filter.program("aarch64"), 0xC000_00B7, aarch64, arguments)
    assert intel == arm == (REFUSED | error if error else ALLOWED)


def test_calls_in_the_old_spelling_are_the_same_calls() -> None:
    intel = syscall_filter.program("x86_64")
    for number, arguments in (
        (2, (0, 0o101, 0o4755)),
        (85, (0, 0o4755)),
        (90, (0, 0o4755)),
        (133, (0, 0o4755)),
    ):
        assert decide(intel, 0xC000_003E, number, arguments) == REFUSED | errno.EPERM
    assert decide(intel, 0xC000_003E, 2, (0, 0, 0o4755)) == ALLOWED
    assert decide(intel, 0xC000_003E, 0x4000_0000 + 165) == REFUSED | errno.ENOSYS  # x32


def test_the_filter_refuses_every_call_of_a_foreign_machine() -> None:
    assert decide(syscall_filter.program("x86_64"), 0x4000_0003, 20) == REFUSED | errno.EPERM
