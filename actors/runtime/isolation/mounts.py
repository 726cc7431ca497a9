"""File tree of a sandboxed process: the system, Python, the code that it runs, and its own folder."""

import os
import stat
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from errno import EACCES, EINVAL, ENOENT
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime import linux
from actors.runtime.linux import MS_BIND, MS_NODEV, MS_NOSUID, MS_PRIVATE, MS_RDONLY, MS_REC, MS_REMOUNT

SCRATCH: Final = (Path("/tmp"), Path("/run"), Path("/var/tmp"), Path("/dev/shm"))
"""World-writable folders; each process gets private, empty ones."""
SYSTEM: Final = tuple(
    Path("/", name)
    for name in ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32", "etc", "opt", "nix", "gnu")
)
"""The operating system: programs, libraries, configuration."""

_STAGE: Final = Path("/dev")
"""Mount point of the new tree during its construction; exists on every system."""
_DEVICES: Final = tuple(Path("/dev", name) for name in ("null", "full", "random", "urandom"))
"""Visible devices. No terminals or disks: device files are writable on a read-only mount. Not zero: mapped
and shared, it is memory outside all limits."""
_STATIC: Final = (
    *(Path("/sys/devices/system/cpu", name) for name in ("online", "possible", "present", "kernel_max")),
    *(Path("/proc", name) for name in ("cpuinfo", "meminfo", "version", "sys/vm/overcommit_memory")),
)
"""Files about the machine that libraries read; shown as copies: procfs and sysfs would show other
processes."""
_SCRATCH_BYTES: Final = 64 * 1024 * 1024
"""Size of each scratch folder."""
_SCRATCH_FILES: Final = 10_000
"""Files and folders in each; one takes about 1 KB of kernel memory."""
_DEPTH: Final = 3
"""Folder levels searched for runs."""
_PROJECT: Final = Path(__file__).resolve().parents[3]
"""Folder of this project's packages."""
_SWARM_FOLDERS: Final = tuple(
    _PROJECT / name for name in ("acrc_testbed", "deploy", "scenarios", "fleets", "runs")
)
"""Project folders about whole swarms and runs, not single robots."""
_ROBOT_FOLDERS: Final = tuple(
    _PROJECT / name
    for name in (
        "actors",
        "cleaning",
        "deeco",
        "docs",
        "examples",
        "firmware_bridge",
        "logistics",
        "maps",
        "tests",
    )
)
"""Project folders that every robot sees."""
_runless: Final[set[Path]] = set()
"""Folders without runs; see `survey`."""


class FileView(NamedTuple):
    """Files visible to a process besides the system; absolute paths."""

    own: Path
    """The only folder that is writable and persistent."""
    homes: Sequence[Path]
    """Paths at which it is visible."""
    shown: Mapping[Path, Path]
    """Readable files and folders, by the path at which each is visible; missing ones are skipped."""


def file_view(
    own: Path, hidden: Collection[Path] = (), readable: Collection[Path] = (), code: Collection[Path] = ()
) -> FileView:
    """Return a view that keeps all paths.

    `hidden`: paths to omit from code folders: the run's folder, the scenario. `readable`: paths to show
    completely, also below a hidden folder. `code`: code folders besides those on Python's path.
    """
    installed = [Path(prefix) for prefix in dict.fromkeys((sys.prefix, sys.base_prefix))]
    folders = (*(Path(path).absolute() for path in sys.path if path), *code, _PROJECT)
    known = (*installed, *SYSTEM)
    excluded = (*hidden_paths(hidden), *SCRATCH, *map(Path, ("/proc", "/sys", "/dev")))
    entries = (code_entries(folder, excluded) for folder in folders if not _is_under(folder, known))
    shown_entries = (*installed, *readable, *(path for found in entries for path in found))
    return FileView(
        own, _path_variants(own), {place: path for path in shown_entries for place in _path_variants(path)}
    )


def survey() -> None:
    """Find the folders without runs among those that all robots see, so that forks need not search them.

    A search takes longer than the rest of a robot's sandbox. Other folders are not listed here, as forks have
    all names in their memory.
    """
    for path in _ROBOT_FOLDERS:
        if any(_listed(path)) and not (_is_run(path) or _holds_run(path, _DEPTH - 1)):
            _runless.add(path)


def hidden_paths(hidden: Collection[Path]) -> tuple[Path, ...]:
    """Return the paths hidden in code folders: `hidden`, and the project's runs and scenarios.

    With a scenario, its sibling files are hidden, too: a single missing file would reveal which one it is.
    """
    siblings = [other for path in hidden if path.is_file() for other in path.parent.glob("*.toml")]
    paths = (*hidden, *siblings, *_SWARM_FOLDERS)
    return tuple(dict.fromkeys((*paths, *(path.resolve() for path in paths))))


def code_entries(folder: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """Yield the files and folders in `folder` that may be shown completely; `folder` itself if it is a file.

    Skipped: `hidden` paths, names that begin with a dot, empty folders and runs. A folder that contains one
    of these is searched recursively. Nothing in a hidden folder is shown, except below scratch folders.
    """
    if _is_under(folder.resolve(), [path for path in hidden if path not in SCRATCH]):
        return
    if os.path.isfile(folder):  # noqa: PTH113 — Path.is_file raises where access is denied
        yield folder
    yield from _entries(folder, hidden, _DEPTH)


def _entries(folder: Path, hidden: Sequence[Path], depth: int) -> Iterator[Path]:
    for entry in sorted(_listed(folder), key=lambda entry: entry.name):
        path = folder / entry.name
        if entry.name.startswith(".") or path in hidden:
            continue
        if not _is_subfolder(entry):
            yield path
        elif path not in _runless and (not any(_listed(path)) or _is_run(path)):
            continue
        elif _contains(path, hidden) or (path not in _runless and _holds_run(path, depth - 1)):
            yield from _entries(path, hidden, depth - 1)
        else:
            yield path


def _is_run(folder: Path) -> bool:
    """Return True for the folder of a current or finished run."""
    inside = [entry for entry in _listed(folder) if _is_subfolder(entry)]
    if (folder / "scenario.toml").is_file() and {"world", "laboratory"} & {entry.name for entry in inside}:
        return True
    files = (file.name for entry in inside for file in _listed(entry))
    return any(name.endswith(".mcap") or name == "setup.json" for name in files)


def _holds_run(folder: Path, depth: int) -> bool:
    subfolders = (e for e in _listed(folder) if depth > 0 and _is_subfolder(e) and not e.name.startswith("."))
    return any(_is_run(Path(entry)) or _holds_run(Path(entry), depth - 1) for entry in subfolders)


def _listed(folder: str | os.PathLike[str]) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return list(found)
    except OSError:  # not readable, or gone
        return []


def _is_subfolder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _is_under(path: Path, folders: Iterable[Path]) -> bool:
    return _prefix(path).startswith(tuple(map(_prefix, folders)))


def _contains(folder: Path, paths: Iterable[Path]) -> bool:
    prefix = _prefix(folder)
    return any(_prefix(path).startswith(prefix) for path in paths)


def _prefix(folder: Path) -> str:
    """Return the beginning of all paths in a folder, with that of the folder itself; pathlib is slower."""
    return os.path.join(folder, "")  # noqa: PTH118


def _path_variants(path: Path) -> tuple[Path, ...]:
    """Return the absolute path, and the path with links resolved."""
    return tuple(dict.fromkeys((path.absolute(), Path(os.path.realpath(path)))))


def enter(view: FileView) -> None:
    """Replace this process's file tree by `view`; requires new user and mount namespaces."""
    linux.mount(None, "/", None, MS_REC | MS_PRIVATE)
    links = {path: path.readlink() for path in SYSTEM if path.is_symlink()}
    handles = _handles(view, [path for path in SYSTEM if path not in links])
    machine = {path: path.read_text(errors="replace") for path in _STATIC if _exists(path)}
    linux.mount("tmpfs", _STAGE, "tmpfs", MS_NOSUID | MS_NODEV, f"size={_SCRATCH_BYTES},mode=0755")
    for folder in SCRATCH:
        _staged(folder).mkdir(parents=True, exist_ok=True)
        options = f"size={_SCRATCH_BYTES},nr_inodes={_SCRATCH_FILES},mode=0755"
        linux.mount("tmpfs", _staged(folder), "tmpfs", MS_NOSUID | MS_NODEV, options)
    for place in sorted(handles, key=lambda path: len(path.parts)):
        _bind(handles[place], _staged(place))
        os.close(handles[place])
    for path, text in machine.items():
        _staged(path).parent.mkdir(parents=True, exist_ok=True)
        _staged(path).write_text(text)
    for path, target in links.items():
        _staged(path).symlink_to(target)
    _make_readonly({_staged(folder) for folder in (*SCRATCH, *view.homes)})
    linux.pivot_root(_STAGE)


def _handles(view: FileView, system: Iterable[Path]) -> dict[Path, int]:
    """Open all visible files and folders; return the descriptors by place in the new tree."""
    outermost: list[Path] = []
    for place in sorted(view.shown):
        if not _is_under(place, (*outermost, *SYSTEM)):
            outermost.append(place)
    sources = {path: path for path in (*_DEVICES, *system)}
    sources |= {place: view.shown[place] for place in outermost} | dict.fromkeys(view.homes, view.own)
    return {
        place: os.open(source, os.O_PATH | os.O_CLOEXEC)
        for place, source in sources.items()
        if _exists(source)
    }


def _exists(path: Path) -> bool:
    return os.path.exists(path)  # noqa: PTH110 — Path.exists raises where access is denied


def _staged(path: Path) -> Path:
    """Return the place of `path` while the tree is being built."""
    return _STAGE / path.relative_to("/")


def _bind(handle: int, path: Path) -> None:
    """Bind-mount the file or folder `handle` at `path`, which is created if missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            path.mkdir()
        else:
            path.touch()
    linux.mount(f"/proc/self/fd/{handle}", path, None, MS_BIND | MS_REC)


def _make_readonly(writable: Collection[Path]) -> None:
    """Make all other mounts of the new tree read-only."""
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        path = Path(_unescaped(line.split(" ")[4]))
        if path in writable or not path.is_relative_to(_STAGE):
            continue
        try:
            flags = MS_REMOUNT | MS_BIND | MS_RDONLY | MS_NOSUID | linux.mount_flags(path)
            linux.mount(None, path, None, flags)
        except OSError as error:
            # Covered by another mount, or in a folder without access: unreachable in the sandbox, too.
            if error.errno not in {EACCES, EINVAL, ENOENT}:
                raise


def _unescaped(field: str) -> str:
    """Decode a path of mountinfo, where blanks and backslashes are octal (proc_pid_mountinfo(5))."""
    head, *rest = field.split("\\")
    return head + "".join(chr(int(part[:3], 8)) + part[3:] for part in rest)
