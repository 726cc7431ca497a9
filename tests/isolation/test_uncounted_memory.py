"""Memory that no limit of a process counts: each way to some is tried, with and without isolation."""

import os
import platform
from pathlib import Path

import pytest

from tests.isolation.test_process import run_folder, said

__all__ = ["run_folder"]
NUMBERS = {
    # x86_64, aarch64
    "memfd_secret": (447, 447),
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
    "vmsplice": (278, 75),
    "splice": (275, 76),
    "tee": (276, 77),
    "landlock_create_ruleset": (444, 444),
}
PREPARED = """
import errno, mmap, resource
libc = ctypes.CDLL(None, use_errno=True)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
own, isolated, numbers = Path(sys.argv[1]), sys.argv[2] == "True", eval(sys.argv[3])

def call(name, *words):
    return checked(libc.syscall(numbers[name], *words))

def checked(result):
    if result in (-1, 2**64 - 1):
        raise OSError(ctypes.get_errno(), "")
    return result

def mapped(flags):
    return checked(libc.mmap(None, 1 << 20, mmap.PROT_READ | mmap.PROT_WRITE, flags, -1, 0))

def spliced(name):
    source, target = os.pipe(), os.pipe()
    os.write(source[1], b"page")
    return call(name, source[0], target[1], 4, 0) if name == "tee" else (
        call(name, source[0], None, target[1], None, 4, 0))

def poured():
    page = ctypes.create_string_buffer(b"page")
    vector = (ctypes.c_size_t * 2)(ctypes.addressof(page), 4)
    return call("vmsplice", os.pipe()[1], vector, 1, 0)

def sent():
    with open(own / "file", "wb+") as file:
        file.write(b"page")
        file.flush()
        return os.sendfile(os.pipe()[1], file.fileno(), 0, 4)

if isolated:
    isolate(Confinement(own=own, hidden=(own.parent,), scratch_files=500, scratch_bytes=1 << 20))
"""
WAYS = {
    # What is tried, and the error of an isolated robot.
    "a file in memory": ('os.memfd_create("hoard")', "ENOSYS"),
    "a secret file in memory": ('call("memfd_secret", 0)', "ENOSYS"),
    "a System V segment": ('call("shmget", 0, 1 << 20, 0o1600)', "ENOSYS"),
    "System V semaphores": ('call("semget", 0, 100, 0o1600)', "ENOSYS"),
    "a System V queue": ('call("msgget", 0, 0o1600)', "ENOSYS"),
    "a POSIX queue": ('checked(libc.mq_open(b"/hoard", os.O_CREAT | os.O_RDWR, 0o600, None))', "ENOSYS"),
    "shared memory without a name": ("mapped(mmap.MAP_SHARED | mmap.MAP_ANONYMOUS)", "EPERM"),
    "the same from Python": ("mmap.mmap(-1, 1 << 20)", "EPERM"),
    "a stack of one's own": ("mapped(mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x100)", "EPERM"),
    "zeros that are shared": ('open("/dev/zero", "rb+", 0)', "ENOENT"),
    "pages in a pipe by vmsplice": ("poured()", "ENOSYS"),
    "pages in a pipe by splice": ('spliced("splice")', "ENOSYS"),
    "pages in a pipe by tee": ('spliced("tee")', "ENOSYS"),
    "pages in a pipe by sendfile": ("sent()", "ENOSYS"),
    "files in /tmp": ('[Path("/tmp", f"hoard-acrc-{n}").touch() for n in range(600)]', "ENOSPC"),
    "links in /dev/shm": ('[os.symlink("x", f"/dev/shm/hoard-acrc-{n}") for n in range(600)]', "ENOSPC"),
    "bytes in /run": ('Path("/run/hoard-acrc").write_bytes(bytes(2 << 20))', "ENOSPC"),
}  # fmt: skip
CLEAN = 'for path in ("/tmp", "/dev/shm", "/run"): [f.unlink() for f in Path(path).glob("hoard-acrc*")]'
TRIED = f"""
try:
    {{}}
    print("got it")
except OSError as error:
    print(errno.errorcode[error.errno])
finally:
    {CLEAN}
"""
NOT_EVERYWHERE = ("a secret file in memory", "bytes in /run")
"""What a kernel need not offer, or an ordinary user not have, also without isolation."""


def attempt(way: str, own: Path, *, isolated: bool) -> list[str]:
    column = ("x86_64", "aarch64").index(platform.machine())
    numbers = {name: pair[column] for name, pair in NUMBERS.items()}
    return said(PREPARED + TRIED.format(WAYS[way][0]), own, isolated, numbers)


@pytest.mark.parametrize("way", WAYS)
def test_an_isolated_robot_has_no_memory_that_nobody_counts(way: str, run_folder: Path) -> None:
    assert attempt(way, run_folder / "r1", isolated=True) == [WAYS[way][1]]


@pytest.mark.parametrize("way", [way for way in WAYS if way not in NOT_EVERYWHERE])
def test_without_isolation_it_has(way: str, run_folder: Path) -> None:
    if way == "zeros that are shared" and not os.path.exists("/dev/zero"):  # noqa: PTH110
        pytest.skip("this machine shows none")
    assert attempt(way, run_folder / "r1", isolated=False) == ["got it"]


def test_what_libraries_do_with_such_calls_works_without_them(run_folder: Path) -> None:
    lines = said(
        """
        import shutil, tempfile
        from multiprocessing import shared_memory
        own = Path(sys.argv[1])
        isolate(Confinement(own=own, hidden=(own.parent,)))
        (own / "a").write_bytes(b"copied")
        shutil.copyfile(own / "a", own / "b")
        print((own / "b").read_text())
        print(ctypes.CFUNCTYPE(ctypes.c_int)(lambda: 42)())
        shared = shared_memory.SharedMemory(create=True, size=100)
        print(shared.size >= 100)
        shared.unlink()
        """,
        run_folder / "r1",
    )
    assert lines == ["copied", "42", "True"]
