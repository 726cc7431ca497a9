"""A robot's process shut off from its peers: what is left is its own folder, with the router's socket in it.

Linux only: user, network, mount, IPC and process namespaces, no capabilities, and a filter on system calls.
Works for root and, where unprivileged user namespaces are allowed, for everyone. docs/trust.md lists the
layers.
"""

import functools
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import msgspec

from actors.runtime import failure, linux
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import mounts, syscall_filter
from actors.runtime.linux import write_to

_NAMESPACES: Final = (
    linux.CLONE_NEWUSER | linux.CLONE_NEWNET | linux.CLONE_NEWNS | linux.CLONE_NEWIPC | linux.CLONE_NEWPID
)
_TRIAL: Final = "import sys; from actors.runtime.isolation.sandbox import trial; trial(sys.argv[1])"
_PROJECT: Final = Path(__file__).resolve().parents[3]
"""Where the packages of this project are."""
_NOT_ITS_CODE: Final = ("acrc_testbed", "deploy", "scenarios", "fleets", "runs")
"""What of the project is about the whole swarm, and about runs that have been."""
NAMES: Final = "names.json"
"""File in the folder of a run with a strategy of the user's own."""
FOLDER: Final = Path("/robot")
"""The robot's own folder of the run."""
CODE: Final = Path("/code")
"""Of the folders that its strategy is looked for in, the first is seen as /code/1, the next as /code/2, …"""
RECORDING: Final = 3
"""The descriptor at which such a robot finds its recording open."""
OPEN = (
    "each can read the others' passwords, files and memory, and reach them past the radio; "
    "a strategy that is not out to cheat gives the same result"
)


class IsolationError(AcrcError):
    """A robot's process cannot be shut off from its peers."""


@dataclass(frozen=True)
class Confinement:
    """What one robot's process keeps when it is isolated."""

    own: Path
    """The robot's own folder, the only one that it may write to. It stays writable at the same path."""
    hidden: tuple[Path, ...] = ()
    """Files and folders that must not be seen although they lie in a folder with code or in a readable one:
    the run's output folder, the scenario. What lies deeper and is named as own or readable is seen."""
    readable: tuple[Path, ...] = ()
    """Files and folders that the robot must read; seen whole. Python, system and this project always are."""
    code: tuple[Path, ...] = ()
    """Folders with the code that it runs, like those on Python's path: seen entry by entry, without runs."""
    log: Path | None = None
    """File in the own folder that stdout and stderr go to. None: they stay what they are, and then the
    starter must have given this robot ones of its own, for a shared pipe or terminal is a way to a peer."""
    descriptors: tuple[int, ...] = (1, 2)
    """Open descriptors to keep; none may be a folder. All others become /dev/null."""
    parent: int | None = None
    """End when this process ends, which must be the parent; None: outlive it."""


def isolate(plan: Confinement) -> None:
    """Shut this process off, for good; its working directory becomes `plan.own`.

    To be called with one thread only, so before Zenoh and numpy start theirs. The program goes on in a child
    of the process that called, with another process id, and whoever waits for the latter sees the child's end
    (`linux.enter_namespace`). Afterwards only `plan.own`, scratch folders and what is needed to run are seen,
    no process but its own children, there is no network, and file locks, watches and new namespaces are
    refused. Raises
    IsolationError where the system does not allow this; the process is then half shut off and must end.
    """
    if sys.platform != "linux":
        raise IsolationError(_sentence(f"isolation needs Linux, this is {sys.platform}"))
    if not syscall_filter.supported():
        raise IsolationError(_sentence(f"isolation knows x86_64 and aarch64, this is {os.uname().machine}"))
    check_threads()
    plan.own.resolve(strict=True)  # A missing folder is the caller's mistake and not the machine's.
    try:
        separate(plan)
        close_ways_out()
    except OSError as error:
        raise refusal(error) from error


def check_threads() -> None:
    """RuntimeError in a process with several: only one of them would be shut off."""
    if len(list(Path("/proc/self/task").iterdir())) > 1:
        raise RuntimeError("isolate() must be called before the process starts its second thread")


def close_ways_out() -> None:
    """The last part of `isolate`: drop all capabilities and install the filter."""
    linux.drop_capabilities()
    syscall_filter.install()


def separate(plan: Confinement) -> None:
    """The first part of `isolate`: own descriptors, namespaces and file tree; capabilities are kept."""
    view = file_view(plan)
    shed_descriptors(plan.descriptors)
    if plan.log is not None:
        write_to(os.open(plan.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600))
    enter_namespaces()
    linux.enter_namespace(plan.parent)
    mounts.enter(view)


def enter_namespaces() -> None:
    """New namespaces of all kinds, with this process's user as the only one."""
    user, group = os.getuid(), os.getgid()
    linux.unshare(_NAMESPACES)
    for name, text in (
        ("setgroups", "deny"),
        ("uid_map", f"{user} {user} 1"),
        ("gid_map", f"{group} {group} 1"),
    ):
        try:
            Path("/proc/self", name).write_text(text)
        except OSError as error:  # Python does not say what it could not write
            raise OSError(error.errno, error.strerror, f"/proc/self/{name}") from error


def file_view(plan: Confinement) -> mounts.FileView:
    """What `plan` lets the process see."""
    return mounts.FileView(plan.own, (*plan.hidden, *_code(plan)), tuple(_shown(plan)))


@functools.cache
def available() -> str | None:
    """Return why a process cannot be isolated on this machine, in one sentence; None if it can.

    Tries it in a child process, once per process.
    """
    with tempfile.TemporaryDirectory() as folder:
        trial_run = subprocess.run(
            [sys.executable, "-P", "-c", _TRIAL, folder],
            # Nothing from the working directory, nor from what the user's environment says, is imported here.
            env={"PYTHONPATH": str(_PROJECT), **container_variables()},
            capture_output=True,
            text=True,
            check=False,
        )
    if trial_run.returncode == 0:
        return None
    return trial_run.stdout.strip() or _sentence(
        f"the trial of isolation ended with: {trial_run.stderr.strip()[-300:]}"
    )


def trial(folder: str) -> None:
    """Isolate this process in `folder`; on failure print the reason and exit with 1."""
    try:
        isolate(Confinement(own=Path(folder)))
    except IsolationError as error:
        sys.stdout.write(str(error))
        sys.exit(1)


def _shown(plan: Confinement) -> Iterator[Path]:
    """What is seen beside the system and the own folder: Python whole, folders with code entry by entry."""
    yield from _installed()
    own = unseen(plan.hidden)
    hidden = (*own, *mounts.SCRATCH, *mounts.NEVER)
    outside = _code(plan)
    for path in dict.fromkeys(plan.readable):
        if not any(one.is_relative_to(path.resolve()) for one in hidden):
            yield path
        elif path.resolve() not in hidden:
            outside.append(path)
    for folder in dict.fromkeys(outside):
        yield from code_entries(folder, hidden)


def unseen(hidden: Collection[Path]) -> tuple[Path, ...]:
    """What is not seen although it lies beside code: what is hidden, and the project's runs and scenarios.

    Of a scenario also the others beside it, for which of them is missing would tell which one it is.
    """
    beside = [other for path in hidden if path.is_file() for other in path.parent.glob("*.toml")]
    own = (*hidden, *beside, *(_PROJECT / name for name in _NOT_ITS_CODE))
    return tuple(dict.fromkeys((*own, *(path.resolve() for path in own))))


def code_entries(folder: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """What is seen of a folder with code; nothing of one that is hidden itself."""
    if not any(folder.resolve().is_relative_to(path) for path in hidden if path not in mounts.SCRATCH):
        yield from mounts.code_entries(folder, hidden)


def _installed() -> list[Path]:
    """Where Python and its packages are."""
    return [Path(prefix) for prefix in dict.fromkeys((sys.prefix, sys.base_prefix))]


def _code(plan: Confinement) -> list[Path]:
    """Folders with code that is neither installed nor the system's."""
    folders = [*(Path(path).absolute() for path in sys.path if path), *plan.code, _PROJECT]
    return [
        path for path in folders if not any(path.is_relative_to(p) for p in (*_installed(), *mounts.SYSTEM))
    ]


def shed_descriptors(kept: Collection[int]) -> None:
    """Turn what was inherited into /dev/null.

    Closing would free the numbers, and an object that still believes to own one would close another's file.
    """
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in [int(entry.name) for entry in Path("/proc/self/fd").iterdir()]:
        if number not in kept and number != nothing and _is_open(number):
            os.dup2(nothing, number, inheritable=number < 3)
    os.close(nothing)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def refusal(error: OSError) -> IsolationError:
    """What the user is told where the system does not allow it."""
    said = f"{error.strerror} ({error.filename})" if error.filename else str(error.strerror)
    return IsolationError(_sentence(f"robots cannot be isolated on this machine: {said}"))


def _sentence(reason: str) -> str:
    return f"{reason}; {advice()}"


class StrategyFolders(msgspec.Struct, frozen=True):
    """Folders that isolated robots saw under other names; absolute paths at the time of the run."""

    out: str
    """The run's folder; a robot's own lies in it."""
    code: tuple[str, ...] = ()
    """The folders that a strategy was looked for in."""


@dataclass(frozen=True)
class Names:
    """Paths outside the sandbox that have other names inside."""

    folder: str
    """The robot's own folder of the run; its part `own` can be written to."""
    record: str
    """The new file of its recording."""
    code: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    """Paths beside the code that the robot must not see: the run's folder, the scenario."""


def own_folder(folder: Path) -> Path:
    """In the folder of an actor, the part that it may write to, and that no other process writes to or reads.

    What others rely on lies beside it: recordings and logs, which the actor keeps open and cannot replace.
    """
    return folder / "own"


def code_places(count: int) -> tuple[Path, ...]:
    """Return the paths inside the sandbox of so many folders with code."""
    return tuple(CODE / str(number) for number in range(1, count + 1))


def outside_paths(text: str, names: Names) -> str:
    """Replace the sandbox's paths in a robot's output by those outside."""
    for seen, path in ((FOLDER, names.folder), *zip(code_places(len(names.code)), names.code, strict=True)):
        text = text.replace(f"{seen}/", f"{path}/")
    return text


def robot_view(names: Names) -> mounts.FileView:
    """Return the file tree of a robot whose folders have other names inside."""
    folder = Path(names.folder)
    own, hidden = own_folder(folder), (*map(Path, names.hidden), folder.parent)
    plain = file_view(Confinement(own=own, hidden=hidden))
    not_seen = unseen(hidden)
    entries = {
        seen / found.relative_to(path): found
        for seen, path in zip(code_places(len(names.code)), map(Path, names.code), strict=True)
        for found in code_entries(path, not_seen)
    }
    sealed = [path for path in plain.sealed if path not in hidden]
    return plain._replace(sealed=sealed, home=own_folder(FOLDER), renamed={FOLDER: folder, **entries})


@dataclass(frozen=True)
class IsolationChoice:
    """Whether robots are sandboxed."""

    isolate: bool
    warning: str = ""
    """Sentence about the missing sandbox; empty if there is one."""


def choose(wanted: bool | None, *, debugged: bool = False, elsewhere: str | None = None) -> IsolationChoice:
    """Decide whether to sandbox robots; `wanted` None: if the machine allows it.

    `debugged`: a debugger must reach the process. `elsewhere`: why another computer of the run has no
    sandbox. Raises IsolationError where a sandbox is wanted and impossible.
    """
    if wanted is False or (wanted is None and debugged):
        option = "--no-isolate" if wanted is False else "--debugpy"
        return IsolationChoice(False, f"{option}: robots run as plain processes; {OPEN}")
    reason = available() or elsewhere
    if reason is None:
        return IsolationChoice(True)
    if wanted:
        raise IsolationError(reason)
    cause = reason.removesuffix(f"; {advice()}")
    helps = f"; {remedy()}" if container_kind() and cause != reason else ""
    return IsolationChoice(False, f"robots run as plain processes, because {cause}; {OPEN}{helps}")


def warn(choice_warning: str) -> None:
    """Print a warning on standard error."""
    if choice_warning:
        from actors.console import screen  # noqa: PLC0415 — robots' processes do not need it

        screen(stderr=True).print(f"acrc: {choice_warning}", style="yellow")


# A container's own filter on system calls comes first: Docker's refuses the namespaces, and with `--cap-add
# SYS_ADMIN` still pivot_root(2). docs/trust.md has a table.
_DOCKER: Final = (
    "start it with --security-opt seccomp=deploy/container/seccomp.json, where AppArmor is on also with "
    "--security-opt apparmor=unconfined"
)
_REMEDIES: Final = {
    "Apptainer": "allow unprivileged user namespaces on the machine that it runs on",
    "Kubernetes": "give it securityContext.seccompProfile.type: Unconfined, where AppArmor is on also "
    "appArmorProfile.type: Unconfined",
    "Podman": _DOCKER,
    "Docker": _DOCKER,
}
_OTHERWISE: Final = "let it make user namespaces and mounts"
_CONTAINER_VARIABLES: Final = {
    "APPTAINER_CONTAINER": "Apptainer",
    "SINGULARITY_CONTAINER": "Apptainer",
    "KUBERNETES_SERVICE_HOST": "Kubernetes",
}
_CONTAINER_FILES: Final = {
    ".singularity.d": "Apptainer",
    "run/.containerenv": "Podman",
    ".dockerenv": "Docker",
}
_NAMED_IN: Final = "container"
"""Variable with the container's kind, as systemd's Container Interface has it."""
_OWN_WORDS: Final = {"docker": "Docker", "podman": "Podman", "kubernetes": "Kubernetes"}
_ON_THE_MACHINE: Final = "allow unprivileged user namespaces on this machine"


def container_kind(environment: Mapping[str, str] = os.environ, root: Path = Path("/")) -> str:
    """What sort of container this is; empty: none that is known."""
    for name, sort in _CONTAINER_VARIABLES.items():
        if environment.get(name):
            return sort
    for name, sort in _CONTAINER_FILES.items():
        if (root / name).exists():
            return sort
    named = environment.get(_NAMED_IN, "")
    return _OWN_WORDS.get(named, named)


def container_variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The variables that tell it, for a process that is told nothing else."""
    return {name: environment[name] for name in (*_CONTAINER_VARIABLES, _NAMED_IN) if name in environment}


def remedy() -> str:
    """What lets robots be isolated here."""
    sort = container_kind()
    return f"this is a container ({sort}): {_REMEDIES.get(sort, _OTHERWISE)}" if sort else _ON_THE_MACHINE


def advice() -> str:
    """The same, or the way round; how each IsolationError's sentence ends."""
    return f"{remedy()}, or run with --no-isolate"


_MB: Final = 1_000_000
_STACK_BYTES: Final = 64 * 1024 * 1024
"""What the first thread's stack may grow to, B; own choice, eight times what most systems give."""

Amount = Annotated[int, msgspec.Meta(ge=1, lt=10**9)]


class LimitError(AcrcError):
    """A limit that is none."""


class ProcessLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How much one robot's process may have; own choices, far above what a strategy needs."""

    memory_mb: Amount = 4096
    """Its data, MB (RLIMIT_DATA); what it asks for beyond is a MemoryError in the strategy's line. A robot
    itself has about 300. All its processes together are looked at twice a second."""
    open_files: Amount = 256
    """Open files (RLIMIT_NOFILE)."""
    file_mb: Amount = 16_384
    """Each file that it writes, its log and its recording among them, MB (RLIMIT_FSIZE)."""
    disk_mb: Amount = 32_768
    """All files in its folder together, MB; looked at twice a second. One that it has deleted and keeps open
    is not counted, nor what an open robot writes elsewhere."""
    disk_files: Amount = 100_000
    """Files and folders there."""
    processes: Amount = 64
    """Processes and threads (RLIMIT_NPROC, which is none for root; looked at twice a second); isolated robots
    only, for else the system counts all of the user's."""


def limits(words: tuple[str, ...]) -> ProcessLimits:
    """The limits with these set, each as `name=number`. Raises LimitError."""
    known = ProcessLimits.__struct_fields__
    found = ProcessLimits()
    for word in words:
        name, _, number = word.partition("=")
        if (
            name not in known
            or not number.isascii()
            or not number.isdigit()
            or not 0 < int(number[:10]) < 10**9
        ):
            raise LimitError(
                f'--limit: {word}; must be one of {", ".join(known)}, "=" and a number from 1 to 999999999'
            )
        found = msgspec.structs.replace(found, **{name: int(number[:10])})
    return found


def enforce(chosen: ProcessLimits, *, isolated: bool) -> None:
    """Hold this process, and what it starts, to the limits from now on."""
    _lower(resource.RLIMIT_DATA, chosen.memory_mb * _MB)
    _lower(resource.RLIMIT_NOFILE, chosen.open_files)
    _lower(resource.RLIMIT_FSIZE, chosen.file_mb * _MB)
    failure.keep_room_in_files()
    _lower(resource.RLIMIT_CORE, 0)
    _lower(resource.RLIMIT_STACK, _STACK_BYTES)  # it is not among the data
    if isolated and hasattr(resource, "RLIMIT_NPROC"):
        _lower(resource.RLIMIT_NPROC, chosen.processes)


def _lower(kind: int, most: int) -> None:
    """New threads' stacks are as large as the soft limit of the stack, so that one stays where it is less."""
    soft, hard = resource.getrlimit(kind)
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    keeps = kind == resource.RLIMIT_STACK and soft != resource.RLIM_INFINITY
    resource.setrlimit(kind, (min(soft, allowed) if keeps else allowed, allowed))
