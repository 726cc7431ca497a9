"""The filter on system calls through which robots of one user could reach each other past the namespaces.

Namespaces hide what has a name. What is left hangs on files that everyone may read (locks, watches, leases,
hints, futexes, what of them is in memory), on the user (key rings, what all of his processes may have
together), on the machine (free memory and disk, counters of faults and switches) or on the kernel (its log),
or is a socket family that knows no network namespaces (vsock). One seccomp filter (seccomp(2), mode FILTER)
refuses these, and new namespaces, mounts and set-user-ID files with them; and memory that no limit of a
process counts.
"""

import ctypes
import platform
from collections.abc import Sequence
from errno import EAFNOSUPPORT, EAGAIN, EINVAL, ENOPROTOOPT, ENOSYS, ENOTTY, EOPNOTSUPP, EPERM
from typing import Final, NamedTuple

from actors.runtime.lifecycle import linux

_NUMBERS: Final = {
    # name: (x86_64, aarch64), from the kernel's asm/unistd_64.h and asm-generic/unistd.h
    "add_key": (248, 217),
    "bpf": (321, 280),
    "cachestat": (451, 451),
    "chmod": (90, None),
    "chroot": (161, 51),
    "clone": (56, 220),
    "clone3": (435, 435),
    "creat": (85, None),
    "fadvise64": (221, 223),
    "fanotify_init": (300, 262),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "fcntl": (72, 25),
    "flock": (73, 32),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fsopen": (430, 430),
    "fspick": (433, 433),
    "fstatfs": (138, 44),
    "futex": (202, 98),
    "futex_requeue": (456, 456),
    "futex_wait": (455, 455),
    "futex_waitv": (449, 449),
    "futex_wake": (454, 454),
    "get_mempolicy": (239, 236),
    "getrusage": (98, 165),
    "getsockopt": (55, 209),
    "inotify_add_watch": (254, 27),
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "io_setup": (206, 0),
    "io_uring_setup": (425, 425),
    "ioctl": (16, 29),
    "ioprio_set": (251, 30),
    "kcmp": (312, 272),
    "keyctl": (250, 219),
    "landlock_create_ruleset": (444, 444),
    "listmount": (458, 458),
    "madvise": (28, 233),
    "mbind": (237, 235),
    "membarrier": (324, 283),
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
    "migrate_pages": (256, 238),
    "mincore": (27, 232),
    "mknod": (133, None),
    "mknodat": (259, 33),
    "mmap": (9, 222),
    "mount": (165, 40),
    "mount_setattr": (442, 442),
    "move_mount": (429, 429),
    "move_pages": (279, 239),
    "mq_open": (240, 180),
    "msgget": (68, 186),
    "open": (2, None),
    "open_by_handle_at": (304, 265),
    "open_tree": (428, 428),
    "openat": (257, 56),
    "openat2": (437, 437),
    "perf_event_open": (298, 241),
    "pidfd_getfd": (438, 438),
    "pivot_root": (155, 41),
    "preadv2": (327, 286),
    "process_madvise": (440, 440),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "ptrace": (101, 117),
    "pwritev2": (328, 287),
    "quotactl": (179, 60),
    "quotactl_fd": (443, 443),
    "request_key": (249, 218),
    "sched_setaffinity": (203, 122),
    "sched_setattr": (314, 274),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "semget": (64, 190),
    "sendfile": (40, 71),
    "sendmmsg": (307, 269),
    "sendmsg": (46, 211),
    "set_mempolicy": (238, 237),
    "set_mempolicy_home_node": (450, 450),
    "setns": (308, 268),
    "setpriority": (141, 140),
    "shmget": (29, 194),
    "socket": (41, 198),
    "splice": (275, 76),
    "statfs": (137, 43),
    "statmount": (457, 457),
    "sysinfo": (99, 179),
    "syslog": (103, 116),
    "tee": (276, 77),
    "umount2": (166, 39),
    "unshare": (272, 97),
    "userfaultfd": (323, 282),
    "ustat": (136, None),
    "vmsplice": (278, 75),
    "wait4": (61, 260),
    "waitid": (247, 95),
}
_NO_SUCH_CALL: Final = (
    "clone3", "futex_requeue", "futex_wait", "futex_waitv", "futex_wake",
    "io_setup", "io_uring_setup", "openat2",
)  # fmt: skip
"""They take their arguments from memory, where a filter cannot look (clone3, openat2, futex_requeue,
futex_waitv), set up calls that do (io_setup, io_uring_setup), or are other names, a few years old, for what
`futex` does (futex_wait, futex_wake). Whoever finds them missing falls back on the older call."""
_UNCOUNTED: Final = (
    "landlock_create_ruleset", "memfd_create", "memfd_secret", "mq_open", "msgget", "semget", "sendfile",
    "shmget", "splice", "tee", "vmsplice",
)  # fmt: skip
"""They hold memory that neither setrlimit(2) nor a process's resident size counts: files and segments in
memory, queues, semaphores, rules, and pages that only a pipe still refers to. Libraries do without them."""
_MODE_AT: Final = {
    "chmod": 1,
    "creat": 1,
    "fchmod": 1,
    "fchmodat": 2,
    "fchmodat2": 2,
    "mknod": 1,
    "mknodat": 2,
}
_CREATING_AT: Final = {"open": 1, "openat": 2}
"""Where their flags are; the mode follows."""
_SET_ID_BITS: Final = 0o6000
_O_CREATES: Final = 0x40_0040
"""O_CREAT, __O_TMPFILE: without them the mode is not looked at and may be anything."""
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
_MAP_SHARED: Final = 0x1
_MAP_ANONYMOUS: Final = 0x20
_MAP_REFUSED: Final = 0x4_0100
"""MAP_HUGETLB, MAP_GROWSDOWN (mman.h): RLIMIT_DATA counts neither."""
_AF_NETLINK: Final = 16
_COOKIES: Final = (57, 71)
"""SO_COOKIE, SO_NETNS_COOKIE (socket.h): counted over all sockets of the machine."""
_FCNTL_ALLOWED: Final = (0, 1, 2, 3, 4, 1030, 1033, 1034)
"""F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_DUPFD_CLOEXEC, F_ADD_SEALS, F_GET_SEALS (fcntl.h): they
concern the own descriptor; locks, leases, owners, watches and hints concern the file, and the size of a pipe
what all pipes of the user have left."""
_IOCTL_ALLOWED: Final = (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451, 0x802C_542A)
"""TCGETS, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX, TCGETS2 (ioctls.h). Others tell where a file lies
on the disk, whom SIGIO goes to, what a device has done, or type into a terminal."""
_MADVISE_ALLOWED: Final = (*range(5), 8, 10, 11, *range(14, 20))
"""MADV_NORMAL to MADV_DONTNEED, MADV_FREE, MADV_DONTFORK, MADV_DOFORK, MADV_HUGEPAGE to MADV_KEEPONFORK
(mman.h). Others act on pages that somebody else has, too, or say whether somebody has them (MADV_COLD,
MADV_PAGEOUT, MADV_COLLAPSE, MADV_MERGEABLE)."""
_FADVISE_REFUSED: Final = (4,)
"""POSIX_FADV_DONTNEED: takes a file out of everybody's memory."""
_FUTEX_PRIVATE: Final = 0x80
_FUTEX_COMMAND: Final = 0x7F
_FUTEX_WAITS: Final = (0, 9)
"""FUTEX_WAIT, FUTEX_WAIT_BITSET."""
_FUTEX_WAKES: Final = (1, 3, 4, 5, 10)
"""FUTEX_WAKE, FUTEX_REQUEUE, FUTEX_CMP_REQUEUE, FUTEX_WAKE_OP, FUTEX_WAKE_BITSET."""

_MACHINES: Final = {"x86_64": (0xC000_003E, 0), "aarch64": (0xC000_00B7, 1)}
"""AUDIT_ARCH_* (uapi audit.h) and the column of `_NUMBERS`."""
_FIRST_UNKNOWN: Final = 463
"""Calls from Linux 6.11 on, of which nobody has looked at what they tell; those of x32 are higher still."""

_LOAD, _IF_EQUAL, _IF_ANY_BIT, _IF_AT_LEAST, _AND, _RETURN = 0x20, 0x15, 0x45, 0x35, 0x54, 0x06
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
    load(program(platform.machine()))


def load(instructions: Sequence[Instruction]) -> None:
    """Put these over this process and all it starts, as one filter more."""
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
    """The filter for `machine` ("x86_64", "aarch64"), in order of its checks."""
    audit_name, column = _MACHINES[machine]
    code = [
        Instruction(_LOAD, 0, 0, _MACHINE_AT),
        Instruction(_IF_EQUAL, 1, 0, audit_name),
        _refuse(EPERM),
        Instruction(_LOAD, 0, 0, _NUMBER_AT),
    ]
    code += [Instruction(_IF_AT_LEAST, 0, 1, _FIRST_UNKNOWN), _refuse(ENOSYS)]
    for name, body in _bodies().items():
        number = _NUMBERS[name][column]
        if number is not None:
            code += [Instruction(_IF_EQUAL, 0, len(body), number), *body]
    return [*code, _ALLOWED]


def _bodies() -> dict[str, list[Instruction]]:
    """What is looked at for each call, the most frequent calls first."""
    often: dict[str, list[Instruction]] = {
        "futex": _futex(),
        "mmap": _mapping(),
        "madvise": _one_of(2, _MADVISE_ALLOWED, EINVAL),
        "fcntl": _one_of(1, _FCNTL_ALLOWED, EPERM),
        "ioctl": _one_of(1, _IOCTL_ALLOWED, ENOTTY),
    }
    often |= {name: _creating(flags) for name, flags in _CREATING_AT.items()}
    seldom = {
        "socket": _socket(),
        "getsockopt": _none_of(2, _COOKIES, ENOPROTOOPT),
        "wait4": _without(3),
        "waitid": _without(4),
        "fadvise64": _none_of(3, _FADVISE_REFUSED, EPERM),
        "clone": _no_bit_of(0, _NEW_NAMESPACES),
        # RWF_NOWAIT tells whether a page is in memory; no flag is needed by anybody.
        "preadv2": _one_of(5, (0,), EOPNOTSUPP),
        "pwritev2": _one_of(5, (0,), EOPNOTSUPP),
    }
    seldom |= {name: _no_bit_of(mode, _SET_ID_BITS) for name, mode in _MODE_AT.items()}
    seldom |= {name: [_refuse(ENOSYS)] for name in (*_NO_SUCH_CALL, *_UNCOUNTED)}
    rest = _NUMBERS.keys() - often.keys() - seldom.keys()
    return often | seldom | {name: [_refuse(EPERM)] for name in sorted(rest)}


def _futex() -> list[Instruction]:
    """Nobody waits at an address in a common file: such a wait returns at once, as it may at any time.

    Waits within the process are marked private. What is not marked, and legitimate, is a wait for a thread's
    end and for a semaphore of several processes: they look again, and burn processor time until their turn
    comes.
    """
    waits, wakes = len(_FUTEX_WAITS), len(_FUTEX_WAKES)
    return [
        _argument(1),
        Instruction(_IF_ANY_BIT, waits + wakes + 2, 0, _FUTEX_PRIVATE),
        Instruction(_AND, 0, 0, _FUTEX_COMMAND),
        *(Instruction(_IF_EQUAL, waits + wakes + 1 - i, 0, value) for i, value in enumerate(_FUTEX_WAITS)),
        *(Instruction(_IF_EQUAL, wakes - i, 0, value) for i, value in enumerate(_FUTEX_WAKES)),
        _refuse(ENOSYS),
        _ALLOWED,
        _refuse(EAGAIN),
    ]


def _mapping() -> list[Instruction]:
    """No memory that is shared without a file: what no process has mapped any more would still be there."""
    return [
        _argument(3),
        Instruction(_IF_ANY_BIT, 3, 0, _MAP_REFUSED),
        Instruction(_IF_ANY_BIT, 0, 1, _MAP_SHARED),
        Instruction(_IF_ANY_BIT, 1, 0, _MAP_ANONYMOUS),
        _ALLOWED,
        _refuse(EPERM),
    ]


def _socket() -> list[Instruction]:
    """Of netlink only protocol 0, routes, for the others' answers count over the whole machine."""
    families = _one_of(0, _SOCKET_FAMILIES, EAFNOSUPPORT)
    return [
        _argument(0),
        Instruction(_IF_EQUAL, 0, 3, _AF_NETLINK),
        _argument(2),
        Instruction(_IF_EQUAL, 1, 0, 0),
        _refuse(EAFNOSUPPORT),
        *families,
    ]


def _without(index: int) -> list[Instruction]:
    """A pointer must be null: nobody asks what a child has used."""
    high = Instruction(_LOAD, 0, 0, _ARGUMENTS_AT + 8 * index + 4)
    null = Instruction(_IF_EQUAL, 0, 3, 0)
    return [_argument(index), null, high, null._replace(if_false=1), _ALLOWED, _refuse(EPERM)]


def _creating(flags_at: int) -> list[Instruction]:
    """No new file gets a set-ID bit."""
    return [
        _argument(flags_at),
        Instruction(_IF_ANY_BIT, 0, 3, _O_CREATES),
        _argument(flags_at + 1),
        Instruction(_IF_ANY_BIT, 0, 1, _SET_ID_BITS),
        _refuse(EPERM),
        _ALLOWED,
    ]


def _argument(index: int) -> Instruction:
    """Load the low word of an argument: all but pointers that are looked at have 32 bits in the kernel."""
    return Instruction(_LOAD, 0, 0, _ARGUMENTS_AT + 8 * index)


def _refuse(error: int) -> Instruction:
    return Instruction(_RETURN, 0, 0, _REFUSE | error)


_ALLOWED: Final = Instruction(_RETURN, 0, 0, _ALLOW)


def _one_of(index: int, values: Sequence[int], error: int) -> list[Instruction]:
    count = len(values)
    tests = [Instruction(_IF_EQUAL, count - i, 0, value) for i, value in enumerate(values)]
    return [_argument(index), *tests, _refuse(error), _ALLOWED]


def _none_of(index: int, values: Sequence[int], error: int) -> list[Instruction]:
    count = len(values)
    tests = [Instruction(_IF_EQUAL, count - i, 0, value) for i, value in enumerate(values)]
    return [_argument(index), *tests, _ALLOWED, _refuse(error)]


def _no_bit_of(index: int, bits: int) -> list[Instruction]:
    return [_argument(index), Instruction(_IF_ANY_BIT, 0, 1, bits), _refuse(EPERM), _ALLOWED]
