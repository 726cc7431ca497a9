"""The sandbox of a robot's process: what is left is its own folder, with the router's socket in it.

Linux only: user, network, mount, IPC and process namespaces, no capabilities, and a filter on system calls.
Works for root and, where unprivileged user namespaces are allowed, for everyone. docs/trust.md lists the
layers.
"""

import functools
import os
import resource
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final, NamedTuple, NoReturn

import msgspec

from actors.runtime import failure, linux
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import mounts, syscall_filter

_NAMESPACES: Final = (
    linux.CLONE_NEWUSER | linux.CLONE_NEWNET | linux.CLONE_NEWNS | linux.CLONE_NEWIPC | linux.CLONE_NEWPID
)
_TRIAL: Final = """
import sys
from pathlib import Path
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import Handover, isolate
isolate(lambda: Handover(file_view(Path(sys.argv[1]))))
"""
_REFUSED: Final = 2
"""Exit code of a process that the system does not let isolate itself."""
MESSAGE_LIMIT: Final = 1 << 16
"""Bytes of one message between keeper, sandboxed process and fork server."""
_SPENT: Final = struct.Struct("d")
"""CPU time of the keeper until then, s: what a message to the sandboxed process begins with."""
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


class Handover(NamedTuple):
    """What the keeper prepares for the sandboxed process."""

    view: mounts.FileView
    message: bytes = b""
    descriptors: tuple[int, ...] = ()


def isolate(
    prepare: Callable[[], Handover],
    kept: Collection[int] = (0, 1, 2),
    *,
    parent: int | None = None,
    private: Collection[int] = (),
) -> tuple[bytes, list[int]]:
    """Go on in a sandboxed child; this process stays outside as its keeper (`linux.enter_namespace`).

    The keeper calls `prepare` and builds the view; the child returns the message and the descriptors. So the
    child holds nothing of what only `prepare` knows. `kept`: descriptors of the child; all others become
    /dev/null. `private`: descriptors of the keeper. The keeper ends with `parent`, which must be its parent.

    Requires a single thread, so call it before Zenoh and numpy start theirs. Where the system refuses, a
    sentence on standard error says why, and the process ends with exit code 2.
    """
    if sys.platform != "linux":
        _refuse(f"isolation needs Linux, this is {sys.platform}")
    if not syscall_filter.supported():
        _refuse(f"isolation knows x86_64 and aarch64, this is {os.uname().machine}")
    if len(list(Path("/proc/self/task").iterdir())) > 1:
        raise RuntimeError("isolate() must be called before the process starts its second thread")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    _shed_descriptors((*kept, ours.fileno(), theirs.fileno(), *private))
    os.chdir("/")  # no working directory shows the former tree
    try:
        _enter_namespaces()
    except OSError as error:
        prepare()  # from here on standard error leads to the log
        _refuse(_reason(error))
    keep = partial(_serve, prepare, ours, theirs)
    linux.enter_namespace(parent, keep, (ours.fileno(), *private))
    ours.detach()
    message, descriptors, _, _ = socket.recv_fds(theirs, MESSAGE_LIMIT, 2)
    theirs.close()
    if not message:
        os._exit(1)
    linux.add_spent(*_SPENT.unpack(message[: _SPENT.size]))
    try:
        linux.drop_capabilities()
        syscall_filter.install()
    except OSError as error:
        _refuse(_reason(error))
    return message[_SPENT.size :], descriptors


def _serve(prepare: Callable[[], Handover], ours: socket.socket, theirs: socket.socket) -> None:
    """In the keeper: build the view, and hand over what the sandboxed process needs."""
    theirs.close()
    try:
        handover = prepare()
        mounts.enter(handover.view)
    except OSError as error:
        _refuse(_reason(error))
    message = _SPENT.pack(time.process_time()) + handover.message
    with ours, suppress(BrokenPipeError):  # it has been ended
        socket.send_fds(ours, [message], handover.descriptors)
    for descriptor in handover.descriptors:
        os.close(descriptor)


def _enter_namespaces() -> None:
    """Enter new namespaces of all kinds, with this process's user as the only one."""
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


def _shed_descriptors(kept: Collection[int]) -> None:
    """Turn inherited descriptors into /dev/null.

    Closing would free the numbers, and an object that still owns one would close another's file.
    """
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in [int(entry.name) for entry in Path("/proc/self/fd").iterdir()]:
        with suppress(OSError):  # the listing's own, closed by now
            if number not in kept and number != nothing and os.fstat(number):
                os.dup2(nothing, number, inheritable=number < 3)
    os.close(nothing)


def _reason(error: OSError) -> str:
    said = f"{error.strerror} ({error.filename})" if error.filename else str(error.strerror)
    return f"robots cannot be isolated on this machine: {said}"


def _refuse(reason: str) -> NoReturn:
    sys.stderr.write(f"{_sentence(reason)}\n")
    sys.stderr.flush()
    os._exit(_REFUSED)


def _sentence(reason: str) -> str:
    return f"{reason}; {advice()}"


@functools.cache
def available() -> str | None:
    """Return why a process cannot be isolated on this machine, in one sentence; None if it can.

    Tries it in a child process, once per process.
    """
    with tempfile.TemporaryDirectory() as folder:
        trial = subprocess.run(
            [sys.executable, "-P", "-c", _TRIAL, folder],
            # Nothing from the working directory, nor from what the user's environment says, is imported here.
            env={"PYTHONPATH": str(Path(__file__).resolve().parents[3]), **container_variables()},
            capture_output=True,
            text=True,
            check=False,
        )
    said = trial.stderr.strip()
    if trial.returncode in (0, _REFUSED):
        return said or None
    return _sentence(f"the trial of isolation ended with: {said[-300:]}")


class StrategyFolders(msgspec.Struct, frozen=True):
    """Folders that sandboxed robots saw under other names; absolute paths at the time of the run."""

    out: str
    """The run's folder."""
    code: tuple[str, ...] = ()
    """The folders that the strategy's module was looked for in."""


@dataclass(frozen=True)
class Names:
    """Paths outside the sandbox that have other names inside."""

    folder: str
    """The robot's folder of the run; its part `own` is writable."""
    record: str
    """The new file of its recording."""
    code: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    """Paths beside the code that the robot must not see: the run's folder, the scenario."""

    def places(self) -> Iterator[tuple[Path, str]]:
        """Yield each folder's path inside, and its path outside."""
        yield FOLDER, self.folder
        yield from zip(code_places(len(self.code)), self.code, strict=True)

    def outside_paths(self, text: str) -> str:
        """Replace the sandbox's paths in a robot's output by those outside."""
        for inside, outside in self.places():
            text = text.replace(f"{inside}/", f"{outside}/")
        return text

    def view(self) -> mounts.FileView:
        """Return the robot's file tree."""
        (_, folder), *code = ((inside, Path(outside)) for inside, outside in self.places())
        hidden = (*map(Path, self.hidden), folder.parent)
        plain, not_seen = mounts.file_view(own_folder(folder), hidden), mounts.unseen(hidden)
        shown = {**plain.shown, FOLDER: folder}
        for inside, outside in code:
            shown |= {
                inside / path.relative_to(outside): path for path in mounts.code_entries(outside, not_seen)
            }
        return mounts.FileView(plain.own, (own_folder(FOLDER),), shown)


def own_folder(folder: Path) -> Path:
    """Return the part of an actor's folder that is writable for it, and that no other process uses.

    Recordings and logs lie beside it: the actor keeps them open and cannot replace them.
    """
    return folder / "own"


def code_places(count: int) -> tuple[Path, ...]:
    """Return the paths inside the sandbox of so many folders with code."""
    return tuple(CODE / str(number) for number in range(1, count + 1))


@dataclass(frozen=True)
class IsolationChoice:
    """Whether robots are sandboxed."""

    isolate: bool
    warning: str = ""
    """Sentence about the missing sandbox; empty if there is one."""


def choose(wanted: bool | None, *, debugged: bool = False, elsewhere: str | None = None) -> IsolationChoice:
    """Decide whether to sandbox robots; `wanted` None: if the machine allows it.

    `debugged`: a debugger must reach the process. `elsewhere`: why another computer of the run has no
    sandbox. Raises AcrcError where a sandbox is wanted and impossible.
    """
    if wanted is False or (wanted is None and debugged):
        option = "--no-isolate" if wanted is False else "--debugpy"
        return IsolationChoice(False, f"{option}: robots run as plain processes; {OPEN}")
    reason = available() or elsewhere
    if reason is None:
        return IsolationChoice(True)
    if wanted:
        raise AcrcError(reason)
    cause = reason.removesuffix(f"; {advice()}")
    helps = f"; {remedy()}" if container_kind() and cause != reason else ""
    return IsolationChoice(False, f"robots run as plain processes, because {cause}; {OPEN}{helps}")


def warn(choice_warning: str) -> None:
    """Print a warning on standard error."""
    if choice_warning:
        from actors.console import screen  # noqa: PLC0415 — robots' processes do not need it

        screen(stderr=True).print(f"acrc: {choice_warning}", style="yellow")


class _Container(NamedTuple):
    """A kind of container, how to recognise it, and what its system call filter must allow."""

    kind: str
    variables: tuple[str, ...]
    file: str
    remedy: str


# Docker's own filter refuses the namespaces, and with `--cap-add SYS_ADMIN` still pivot_root(2).
_DOCKER: Final = (
    "start it with --security-opt seccomp=deploy/container/seccomp.json, where AppArmor is on also with "
    "--security-opt apparmor=unconfined"
)
_KUBERNETES: Final = (
    "give it securityContext.seccompProfile.type: Unconfined, where AppArmor is on also "
    "appArmorProfile.type: Unconfined"
)
_APPTAINER: Final = "allow unprivileged user namespaces on the machine that it runs on"
_CONTAINERS: Final = (
    _Container("Apptainer", ("APPTAINER_CONTAINER", "SINGULARITY_CONTAINER"), ".singularity.d", _APPTAINER),
    _Container("Kubernetes", ("KUBERNETES_SERVICE_HOST",), "", _KUBERNETES),
    _Container("Podman", (), "run/.containerenv", _DOCKER),
    _Container("Docker", (), ".dockerenv", _DOCKER),
)
_KIND: Final = "container"
"""Variable with the container's kind, by systemd's Container Interface."""


def container_kind(environment: Mapping[str, str] = os.environ, root: Path = Path("/")) -> str:
    """Return the kind of this container; empty: no known one."""
    for kind, variables, file, _ in _CONTAINERS:
        if any(map(environment.get, variables)) or (file and (root / file).exists()):
            return kind
    named = environment.get(_KIND, "")
    return next((one.kind for one in _CONTAINERS if one.kind.lower() == named), named)


def container_variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the variables that name it, for a process with no others."""
    names = (_KIND, *(name for one in _CONTAINERS for name in one.variables))
    return {name: environment[name] for name in names if name in environment}


def remedy() -> str:
    """Return what lets robots be isolated here."""
    if not (kind := container_kind()):
        return "allow unprivileged user namespaces on this machine"
    remedies = {one.kind: one.remedy for one in _CONTAINERS}
    return f"this is a container ({kind}): {remedies.get(kind, 'let it make user namespaces and mounts')}"


def advice() -> str:
    """Return the end of each sentence about missing isolation."""
    return f"{remedy()}, or run with --no-isolate"


_MB: Final = 1_000_000
_STACK_BYTES: Final = 64 * 1024 * 1024
"""Stack of the first thread; own choice, eight times what most systems give."""

Amount = Annotated[int, msgspec.Meta(ge=1, lt=10**9)]


class ProcessLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Resource limits of one robot's process; own choices, far above what a strategy needs."""

    memory_mb: Amount = 4096
    """Data, MB (RLIMIT_DATA); beyond it, the strategy's line raises MemoryError. A robot itself has about
    300. The sum of all its processes is checked twice a second."""
    open_files: Amount = 256
    """Open files (RLIMIT_NOFILE)."""
    file_mb: Amount = 16_384
    """Each file that it writes, its log and its recording among them, MB (RLIMIT_FSIZE)."""
    disk_mb: Amount = 32_768
    """All files in its folder together, MB; checked twice a second. One that it has deleted and keeps open
    is not counted, nor what an open robot writes elsewhere."""
    disk_files: Amount = 100_000
    """Files and folders there."""
    processes: Amount = 64
    """Processes and threads (RLIMIT_NPROC, which root does not have; checked twice a second); isolated robots
    only, for else the system counts all of the user's."""


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
    """Lower a limit; new threads' stacks are as large as the stack's soft limit, so a smaller one stays."""
    soft, hard = resource.getrlimit(kind)
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    keeps = kind == resource.RLIMIT_STACK and soft != resource.RLIM_INFINITY
    resource.setrlimit(kind, (min(soft, allowed) if keeps else allowed, allowed))
