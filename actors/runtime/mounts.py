"""The file tree as one robot sees it: readable, not writable, without its peers.

Everything here runs in a new mount namespace of a new user namespace, so nothing of it is seen outside.
"""

import os
import stat
from collections.abc import Iterable, Sequence
from contextlib import suppress
from errno import EACCES, EINVAL, ENOENT, ENOSYS
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime import linux
from actors.runtime.linux import (
    MS_BIND,
    MS_MOVE,
    MS_NODEV,
    MS_NOSUID,
    MS_PRIVATE,
    MS_RDONLY,
    MS_REC,
    MS_REMOUNT,
)

SCRATCH: Final = (Path("/tmp"), Path("/run"), Path("/var/tmp"))
"""Folders that everyone may write to; each robot gets an empty one of its own."""
HIDDEN: Final = (Path("/sys"),)
"""Folders with counters and switches of the whole machine; each robot gets an empty one."""
READABLE: Final = (Path("/sys/devices/system/cpu"),)
"""What libraries look up in HIDDEN: how many processors there are."""

_DEVICES: Final = ("null", "zero", "full", "random", "urandom")
_DEVICE_LINKS: Final = (("fd", "/proc/self/fd"), ("stdin", "fd/0"), ("stdout", "fd/1"), ("stderr", "fd/2"))
_PROC_FILES: Final = ("cpuinfo", "meminfo", "version", "sys/vm/overcommit_memory", "sys/kernel/cap_last_cap")
_PROC_LINKS: Final = (("mounts", "self/mounts"), ("net", "self/net"))


class View(NamedTuple):
    """Which folders differ from the common tree; all paths resolved, a deeper path overrides a higher one."""

    own: Path
    """The only folder that can be written to and lasts."""
    hidden: Sequence[Path]
    """Folders that appear empty and read-only."""
    readable: Sequence[Path]
    """Files and folders that stay readable although they lie under a hidden one."""
    scratch_bytes: int
    """Size of each private scratch folder, B."""


def enter(view: View) -> None:
    """Replace this process's file tree by `view`; needs a mount namespace of its own.

    Ends in the own folder, because a working directory from before would still show the former tree.
    """
    linux.mount(None, "/", None, MS_REC | MS_PRIVATE)
    hidden = {path for path in (*view.hidden, *HIDDEN) if _is_there(path)}
    scratch = {path for path in SCRATCH if _is_there(path)}
    shown = [p for p in (*view.readable, *READABLE) if _is_there(p) and _is_under(p, hidden | scratch)]
    handles = {path: os.open(path, os.O_PATH | os.O_CLOEXEC) for path in (*shown, view.own)}
    make_readonly()
    # At one depth: show, then hide, so that hiding wins where a folder is named twice.
    todo = sorted({(len(p.parts), 0, p) for p in shown} | {(len(p.parts), 1, p) for p in hidden | scratch})
    for _, hides, path in todo:
        if hides:
            path.mkdir(parents=True, exist_ok=True)
            linux.mount("tmpfs", path, "tmpfs", MS_NOSUID | MS_NODEV, f"size={view.scratch_bytes},mode=0755")
        else:
            _bind(handles[path], path)
    _bind(handles[view.own], view.own)
    linux.mount(None, view.own, None, MS_REMOUNT | MS_BIND | linux.mount_flags(view.own))
    for path in hidden:
        if path != view.own:
            linux.mount(None, path, None, MS_REMOUNT | MS_BIND | MS_RDONLY | linux.mount_flags(path))
    for handle in handles.values():
        os.close(handle)
    _build_dev(view.scratch_bytes)
    _build_proc()
    os.chdir(view.own)


def make_readonly() -> None:
    """Make the whole tree read-only, with one call where the kernel has it."""
    try:
        linux.set_tree_readonly("/")
    except OSError as error:
        if error.errno != ENOSYS:
            raise
        remount_readonly()


def remount_readonly() -> None:
    """Make the whole tree read-only mount by mount, for kernels before 5.12."""
    lines = Path("/proc/self/mountinfo").read_text().splitlines()
    for path in [_unescaped(line.split(" ")[4]) for line in lines]:
        try:
            linux.mount(None, path, None, MS_REMOUNT | MS_BIND | MS_RDONLY | linux.mount_flags(path))
        except OSError as error:
            # Covered by another mount or behind a folder that is closed to us: out of the robot's reach too.
            if error.errno not in {EACCES, EINVAL, ENOENT}:
                raise


def _unescaped(field: str) -> str:
    """A path from mountinfo, where blanks and backslashes are octal (proc_pid_mountinfo(5))."""
    head, *rest = field.split("\\")
    return head + "".join(chr(int(part[:3], 8)) + part[3:] for part in rest)


def _is_there(path: Path) -> bool:
    """False also where a closed folder is in the way, which stays in the robot's way."""
    return os.path.exists(path)  # noqa: PTH110 — Path.exists raises where access is denied


def _is_under(path: Path, folders: Iterable[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def _bind(handle: int, path: Path) -> None:
    """Show what `handle` refers to at `path`, which is made if it is missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            path.mkdir()
        else:
            path.touch()
    linux.mount(f"/proc/self/fd/{handle}", path, None, MS_BIND | MS_REC)


def _build_dev(size: int) -> None:
    """A /dev without terminals, disks and shared memory: device files can be written on a read-only mount."""
    handles = {name: os.open(f"/dev/{name}", os.O_PATH | os.O_CLOEXEC) for name in _DEVICES}
    linux.mount("tmpfs", "/dev", "tmpfs", MS_NOSUID, f"size={size},mode=0755")
    for name, handle in handles.items():
        _bind(handle, Path("/dev", name))
        os.close(handle)
    Path("/dev/shm").mkdir()
    for name, target in _DEVICE_LINKS:
        Path("/dev", name).symlink_to(target)


def _build_proc() -> None:
    """A /proc with this process only: the others' names and states would be a blackboard for everyone."""
    staging, pid = Path("/dev/.proc"), str(os.getpid())
    staging.mkdir()
    linux.mount("tmpfs", staging, "tmpfs", MS_NOSUID | MS_NODEV, "size=64k,mode=0755")
    for name in (pid, *_PROC_FILES):
        with suppress(FileNotFoundError):
            handle = os.open(f"/proc/{name}", os.O_PATH | os.O_CLOEXEC)
            _bind(handle, staging / name)
            os.close(handle)
    for name, target in (("self", pid), *_PROC_LINKS):
        (staging / name).symlink_to(target)
    linux.mount(str(staging), "/proc", None, MS_MOVE)
    linux.mount(None, "/proc", None, MS_REMOUNT | MS_BIND | MS_RDONLY | linux.mount_flags("/proc"))
    staging.rmdir()
