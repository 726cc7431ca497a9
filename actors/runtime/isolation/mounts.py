"""The file tree as one robot sees it: the system, Python, the code it runs, and its own folder.

Everything here runs in a new mount namespace of a new user namespace, so nothing of it is seen outside.
"""

import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from errno import EACCES, EINVAL, ENOENT, ENOSYS
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from actors.runtime import linux
from actors.runtime.linux import (
    MS_BIND,
    MS_NODEV,
    MS_NOSUID,
    MS_PRIVATE,
    MS_RDONLY,
    MS_REC,
    MS_REMOUNT,
)

SCRATCH: Final = (Path("/tmp"), Path("/run"), Path("/var/tmp"), Path("/dev/shm"))
"""Folders that everyone may write to; each robot gets an empty one of its own."""
SYSTEM: Final = tuple(
    Path("/", name)
    for name in ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32", "etc", "opt", "nix", "gnu")
)
"""The operating system: programs, libraries, their settings."""
NEVER: Final = (Path("/proc"), Path("/sys"), Path("/dev"))
"""Trees with what all processes share; of each, little is shown."""

_STAGE: Final = Path("/dev")
"""Where the new tree is built; a folder that every system has."""
_DEVICES: Final = ("null", "full", "random", "urandom")
"""Not zero: mapped and shared, it is memory that nothing counts."""
_STATIC: Final = (
    *(f"/sys/devices/system/cpu/{name}" for name in ("online", "possible", "present", "kernel_max")),
    *(f"/proc/{name}" for name in ("cpuinfo", "meminfo", "version", "sys/vm/overcommit_memory")),
)
"""Files that libraries read about the machine. A robot gets copies: procfs and sysfs show other processes."""
_SCRATCH_BYTES: Final = 64 * 1024 * 1024
"""Size of each private scratch folder (/tmp, /var/tmp, /run, /dev/shm)."""
_SCRATCH_FILES: Final = 10_000
"""Files and folders in each; one takes the kernel about a kilobyte."""
_DEPTH: Final = 3
"""Folder levels that are searched for runs."""


class FileView(NamedTuple):
    """All that is seen beside the system; absolute paths, each seen where it is named and where it is."""

    own: Path
    """The only folder that can be written to and lasts."""
    sealed: Sequence[Path]
    """Folders of which only what is deeper and shown is seen; they cannot be written to, even in /tmp."""
    shown: Sequence[Path]
    """Files and folders that can be read; what is not there is left out."""
    home: Path | None = None
    """Where the own folder is seen instead."""
    renamed: Mapping[Path, Path] = MappingProxyType({})
    """By the place where each is seen, more files and folders that can be read."""


def enter(view: FileView) -> None:
    """Replace this process's file tree by `view`; needs mount and process namespaces of its own.

    Ends in the own folder, because a working directory from before would still show the former tree.
    """
    linux.mount(None, "/", None, MS_REC | MS_PRIVATE)
    links = {path: path.readlink() for path in SYSTEM if path.is_symlink()}
    handles = _handles(view, [path for path in SYSTEM if path not in links])
    linux.mount("tmpfs", _STAGE, "tmpfs", MS_NOSUID | MS_NODEV, f"size={_SCRATCH_BYTES},mode=0755")
    sealed = {place for path in view.sealed if _is_folder(path) for place in _places(path)}
    for folder in (*SCRATCH, *sorted(path for path in sealed - {*SCRATCH} if _is_under(path, SCRATCH))):
        _new(folder).mkdir(parents=True, exist_ok=True)
        options = f"size={_SCRATCH_BYTES},nr_inodes={_SCRATCH_FILES},mode=0755"
        linux.mount("tmpfs", _new(folder), "tmpfs", MS_NOSUID | MS_NODEV, options)
    for place in sorted(handles, key=lambda path: len(path.parts)):
        _bind(handles[place], _new(place))
        os.close(handles[place])
    for path, text in _machine().items():
        _new(path).parent.mkdir(parents=True, exist_ok=True)
        _new(path).write_text(text)
    for path, target in links.items():
        _new(path).symlink_to(target)
    make_readonly(_STAGE)
    for folder in (*SCRATCH, *_homes(view)):
        linux.mount(None, _new(folder), None, MS_REMOUNT | MS_BIND | linux.mount_flags(_new(folder)))
    linux.pivot_root(_STAGE)
    os.chdir(view.home or view.own)


def _handles(view: FileView, system: Sequence[Path]) -> dict[Path, int]:
    """By the place where it is to be seen, what is to be seen there."""
    shown = {place: path for path in view.shown for place in _places(path)}
    outside = {place: shown[place] for place in _outermost(shown) if not _is_under(place, SYSTEM)}
    own = dict.fromkeys(_homes(view), view.own)
    sources = dict(_devices()) | dict(zip(system, system, strict=True))
    sources |= {**outside, **view.renamed, **own}
    return {
        place: os.open(source, os.O_PATH | os.O_CLOEXEC)
        for place, source in sources.items()
        if _is_there(source)
    }


def _homes(view: FileView) -> tuple[Path, ...]:
    return _places(view.own) if view.home is None else (view.home,)


def _places(path: Path) -> tuple[Path, ...]:
    """Where a path leads to, and where it says so if there are links on the way, or none that ends."""
    return tuple(dict.fromkeys((path.absolute(), Path(os.path.realpath(path)))))


def _new(path: Path) -> Path:
    """Where `path` is while the tree is being built."""
    return _STAGE / path.relative_to("/")


def _devices() -> Iterator[tuple[Path, Path]]:
    """Neither terminals nor disks: device files can be written on a read-only mount."""
    return ((Path("/dev", name), Path("/dev", name)) for name in _DEVICES)


def _machine() -> dict[Path, str]:
    """What the machine is, as it is when the robot starts."""
    found = {Path(name): Path(name) for name in _STATIC if _is_there(Path(name))}
    return {place: path.read_text(errors="replace") for place, path in found.items()}


def make_readonly(tree: Path) -> None:
    """Make the mounts from `tree` on read-only, with one call where the kernel has it."""
    try:
        linux.set_tree_readonly(tree)
    except OSError as error:
        if error.errno != ENOSYS:
            raise
        remount_readonly(tree)


def remount_readonly(tree: Path) -> None:
    """Make the tree read-only mount by mount, for kernels before 5.12."""
    lines = Path("/proc/self/mountinfo").read_text().splitlines()
    for path in [_unescaped(line.split(" ")[4]) for line in lines]:
        if not Path(path).is_relative_to(tree):
            continue
        flags = MS_REMOUNT | MS_BIND | MS_RDONLY | MS_NOSUID
        try:
            linux.mount(None, path, None, flags | linux.mount_flags(path))
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


def _is_folder(path: Path) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 — Path.is_dir raises where access is denied


def _is_under(path: Path, folders: Iterable[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def _outermost(paths: Iterable[Path]) -> list[Path]:
    """The paths without those that lie in another one of them."""
    kept: list[Path] = []
    for path in sorted(set(paths)):
        if not _is_under(path, kept):
            kept.append(path)
    return kept


def _bind(handle: int, path: Path) -> None:
    """Show what `handle` refers to at `path`, which is made if it is missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            path.mkdir()
        else:
            path.touch()
    linux.mount(f"/proc/self/fd/{handle}", path, None, MS_BIND | MS_REC)


def code_entries(folder: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """Files and folders in `folder` that may be shown whole; `folder` itself if it is a file.

    Left out are what `hidden` names, names that begin with a dot, empty folders and every run's folder. A
    folder that holds such a thing is gone into.
    """
    if os.path.isfile(folder):  # noqa: PTH113 — Path.is_file raises where access is denied
        yield folder
    yield from _shown(folder, hidden, _DEPTH)


def is_run(folder: Path) -> bool:
    """True for a folder that a run writes to or has written to."""
    inside = [entry for entry in _listed(folder) if _is_subfolder(entry)]
    if (folder / "scenario.toml").is_file() and {"world", "laboratory"} & {entry.name for entry in inside}:
        return True
    return any(
        name.name.endswith(".mcap") or name.name == "setup.json" for one in inside for name in _listed(one)
    )


def _shown(folder: Path, hidden: Sequence[Path], depth: int) -> Iterator[Path]:
    for entry in sorted(_listed(folder), key=lambda entry: entry.name):
        path = folder / entry.name
        if entry.name.startswith(".") or path in hidden:
            continue
        if not _is_subfolder(entry):
            yield path
        elif not any(_listed(path)) or is_run(path):
            continue
        elif any(one.is_relative_to(path) for one in hidden) or _holds_run(path, depth - 1):
            yield from _shown(path, hidden, depth - 1)
        else:
            yield path


def _holds_run(folder: Path, depth: int) -> bool:
    if depth <= 0:
        return False
    inside = [
        folder / entry.name for entry in _listed(folder) if _is_subfolder(entry) and entry.name[0] != "."
    ]
    return any(is_run(path) or _holds_run(path, depth - 1) for path in inside)


def _listed(folder: str | os.PathLike[str]) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return list(found)
    except OSError:  # closed to us, or gone
        return []


def _is_subfolder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False
