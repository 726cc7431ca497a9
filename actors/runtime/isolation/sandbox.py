"""Sandbox of a robot's process: only its own folder, with the router's socket, remains accessible.

Linux only: user, network, mount, IPC and process namespaces, no capabilities, and a system call filter. Works
for root and, where unprivileged user namespaces are allowed, for everyone. docs/trust.md lists the layers.
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
_TEST_PROGRAM: Final = """
import sys
from pathlib import Path
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import SandboxSetup, isolate
isolate(lambda: SandboxSetup(file_view(Path(sys.argv[1]))))
"""
_REFUSED: Final = 2
"""Exit code of a process that the system does not allow to isolate itself."""
MESSAGE_LIMIT: Final = 1 << 16
"""Most bytes of a message between keeper, sandboxed process and fork server."""
_SPENT: Final = struct.Struct("d")
"""First part of the message to the sandboxed process: CPU time of the keeper so far, s."""
NAMES: Final = "names.json"
"""File in the run's folder, for a run with the user's own strategy."""
FOLDER: Final = Path("/robot")
"""The robot's folder of the run, inside the sandbox."""
CODE: Final = Path("/code")
"""Parent, inside the sandbox, of the folders with strategy code: /code/1, /code/2, …"""
RECORDING: Final = 3
"""Descriptor of such a robot's open recording."""
ISOLATION_RISKS = (
    "each can read the others' passwords, files and memory, and communicate without the radio; results of an "
    "honest strategy are the same"
)


class SandboxSetup(NamedTuple):
    """View and data that the keeper prepares for the sandboxed process."""

    view: mounts.FileView
    message: bytes = b""
    descriptors: tuple[int, ...] = ()


def isolate(
    prepare: Callable[[], SandboxSetup],
    kept: Collection[int] = (0, 1, 2),
    *,
    parent: int | None = None,
    private: Collection[int] = (),
) -> tuple[bytes, list[int]]:
    """Continue in a sandboxed child; this process stays outside as its keeper (`linux.enter_namespace`).

    The keeper calls `prepare` and builds the view; the child returns the message and the descriptors, and
    never holds anything else that `prepare` knows. `kept`: descriptors of the child; all others become
    /dev/null. `private`: descriptors of the keeper. The keeper exits with `parent`, which must be its parent.

    Requires a single thread: call it before Zenoh and numpy start theirs. If the system refuses, the reason
    is written to standard error, and the process exits with code 2.
    """
    if sys.platform != "linux":
        _refuse(f"robots cannot be isolated on {sys.platform}; isolation requires Linux")
    if not syscall_filter.supported():
        _refuse(f"robots cannot be isolated on {os.uname().machine}, only on x86_64 and aarch64")
    if len(list(Path("/proc/self/task").iterdir())) > 1:
        raise RuntimeError("isolate() must be called before the process starts its second thread")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    _redirect_descriptors((*kept, ours.fileno(), theirs.fileno(), *private))
    os.chdir("/")  # the working directory must not lead to the former tree
    try:
        _enter_namespaces()
    except OSError as error:
        prepare()  # redirects standard error to the log
        _refuse(_reason(error))
    keep = partial(_serve, prepare, ours, theirs)
    linux.enter_namespace(parent, keep, (ours.fileno(), *private))
    ours.detach()
    message, descriptors, _, _ = socket.recv_fds(theirs, MESSAGE_LIMIT, 2)
    theirs.close()
    if not message:
        os._exit(1)
    linux.add_cpu_s(*_SPENT.unpack(message[: _SPENT.size]))
    try:
        linux.drop_capabilities()
        syscall_filter.install()
    except OSError as error:
        _refuse(_reason(error))
    return message[_SPENT.size :], descriptors


def _serve(prepare: Callable[[], SandboxSetup], ours: socket.socket, theirs: socket.socket) -> None:
    """In the keeper: build the view, and send message and descriptors to the sandboxed process."""
    theirs.close()
    try:
        handover = prepare()
        mounts.enter(handover.view)
    except OSError as error:
        _refuse(_reason(error))
    message = _SPENT.pack(time.process_time()) + handover.message
    with ours, suppress(BrokenPipeError):  # it was killed
        socket.send_fds(ours, [message], handover.descriptors)
    for descriptor in handover.descriptors:
        os.close(descriptor)


def _enter_namespaces() -> None:
    """Enter new namespaces of all kinds, with only this process's user."""
    user, group = os.getuid(), os.getgid()
    linux.unshare(_NAMESPACES)
    for name, text in (
        ("setgroups", "deny"),
        ("uid_map", f"{user} {user} 1"),
        ("gid_map", f"{group} {group} 1"),
    ):
        try:
            Path("/proc/self", name).write_text(text)
        except OSError as error:  # Python's error lacks the path
            raise OSError(error.errno, error.strerror, f"/proc/self/{name}") from error


def _redirect_descriptors(kept: Collection[int]) -> None:
    """Redirect inherited descriptors to /dev/null.

    Closed numbers would be reused, and an object that still owns one would close another object's file.
    """
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in [int(entry.name) for entry in Path("/proc/self/fd").iterdir()]:
        with suppress(OSError):  # the closed descriptor of the listing
            if number not in kept and number != nothing and os.fstat(number):
                os.dup2(nothing, number, inheritable=number < 3)
    os.close(nothing)


def _reason(error: OSError) -> str:
    message = f"{error.strerror} ({error.filename})" if error.filename else str(error.strerror)
    return f"robots cannot be isolated on this machine: {message}"


def _refuse(reason: str) -> NoReturn:
    sys.stderr.write(f"{_sentence(reason)}\n")
    sys.stderr.flush()
    os._exit(_REFUSED)


def _sentence(reason: str) -> str:
    return f"{reason}; {advice()}"


@functools.cache
def isolation_fault() -> str | None:
    """Return why processes cannot be isolated on this machine, as a sentence; None if they can.

    Tries it in a child process, once per process.
    """
    with tempfile.TemporaryDirectory() as folder:
        trial = subprocess.run(
            [sys.executable, "-P", "-c", _TEST_PROGRAM, folder],
            # Import nothing from the working directory or the user's PYTHONPATH.
            env={"PYTHONPATH": str(Path(__file__).resolve().parents[3]), **container_variables()},
            capture_output=True,
            text=True,
            check=False,
        )
    message = trial.stderr.strip()
    if trial.returncode in (0, _REFUSED):
        return message or None
    return _sentence(f"robots cannot be isolated on this machine: the test failed with: {message[-300:]}")


class StrategyFolders(msgspec.Struct, frozen=True):
    """Folders with other names inside the sandbox; absolute paths at the time of the run."""

    out: str
    """The run's folder."""
    code: tuple[str, ...] = ()
    """Folders searched for the strategy's module."""


class SandboxPaths(msgspec.Struct, frozen=True):
    """Paths outside the sandbox that differ from those inside."""

    folder: str
    """The robot's folder of the run; its subfolder `own` is writable."""
    record: str
    """Path of its new recording."""
    code: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    """Paths to hide in code folders: the run's folder, the scenario."""

    def places(self) -> Iterator[tuple[Path, str]]:
        """Yield each folder's path inside and its path outside."""
        yield FOLDER, self.folder
        yield from zip(code_paths(len(self.code)), self.code, strict=True)

    def outside_paths(self, text: str) -> str:
        """Replace sandbox paths in a robot's output by the paths outside."""
        for inside, outside in self.places():
            text = text.replace(f"{inside}/", f"{outside}/")
        return text

    def view(self) -> mounts.FileView:
        """Return the robot's file tree."""
        (_, folder), *code = ((inside, Path(outside)) for inside, outside in self.places())
        hidden = (*map(Path, self.hidden), folder.parent)
        plain, hidden_paths = mounts.file_view(own_folder(folder), hidden), mounts.hidden_paths(hidden)
        shown = {**plain.shown, FOLDER: folder}
        for inside, outside in code:
            shown |= {
                inside / path.relative_to(outside): path
                for path in mounts.code_entries(outside, hidden_paths)
            }
        return mounts.FileView(plain.own, (own_folder(FOLDER),), shown)


def own_folder(folder: Path) -> Path:
    """Return the writable subfolder of an actor's folder, which no other process uses.

    Recordings and logs lie beside it: the actor has them open and cannot replace them.
    """
    return folder / "own"


def code_paths(count: int) -> tuple[Path, ...]:
    """Return the paths inside the sandbox of this many code folders."""
    return tuple(CODE / str(number) for number in range(1, count + 1))


class IsolationChoice(msgspec.Struct, frozen=True):
    """Decision whether robots are sandboxed."""

    isolate: bool
    warning: str = ""
    """Warning about the missing sandbox; empty if there is one."""


def choose_isolation(
    wanted: bool | None, *, debugged: bool = False, elsewhere: str | None = None
) -> IsolationChoice:
    """Decide whether to sandbox robots; `wanted` None: if the machine allows it.

    `debugged`: a debugger must reach the process. `elsewhere`: why another computer of the run cannot
    sandbox. Raises AcrcError if a sandbox is wanted and impossible.
    """
    if wanted is False or (wanted is None and debugged):
        option = "--no-isolate" if wanted is False else "--debugpy"
        return IsolationChoice(False, f"{option}: robots run as plain processes; {ISOLATION_RISKS}")
    reason = isolation_fault() or elsewhere
    if reason is None:
        return IsolationChoice(True)
    if wanted:
        raise AcrcError(reason)
    cause = reason.removesuffix(f"; {advice()}")
    hint = f"; {remedy()}" if container_kind() and cause != reason else ""
    return IsolationChoice(False, f"robots run as plain processes, because {cause}; {ISOLATION_RISKS}{hint}")


def print_warning(choice_warning: str) -> None:
    """Print a warning on standard error."""
    if choice_warning:
        from actors.console import create_console  # noqa: PLC0415 — not needed in robots' processes

        create_console(stderr=True).print(f"acrc: {choice_warning}", style="yellow")


class _Container(NamedTuple):
    """A kind of container: how to detect it, and how to allow isolation in it."""

    kind: str
    variables: tuple[str, ...]
    file: str
    remedy: str


# Docker's default filter blocks namespaces, and with `--cap-add SYS_ADMIN` still pivot_root(2).
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
"""Variable with the kind of container, per systemd's Container Interface."""


def container_kind(environment: Mapping[str, str] = os.environ, root: Path = Path("/")) -> str:
    """Return the kind of this container; "" if there is none."""
    for kind, variables, file, _ in _CONTAINERS:
        if any(map(environment.get, variables)) or (file and (root / file).exists()):
            return kind
    declared = environment.get(_KIND, "")
    return next((one.kind for one in _CONTAINERS if one.kind.lower() == declared), declared)


def container_variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the variables that identify the container, for a process without other variables."""
    names = (_KIND, *(name for one in _CONTAINERS for name in one.variables))
    return {name: environment[name] for name in names if name in environment}


def remedy() -> str:
    """Return how to allow isolation here."""
    if not (kind := container_kind()):
        return "allow unprivileged user namespaces on this machine"
    remedies = {one.kind: one.remedy for one in _CONTAINERS}
    return f"this is a container ({kind}): {remedies.get(kind, 'allow user namespaces and mounts in it')}"


def advice() -> str:
    """Return the fix that ends each sentence about missing isolation."""
    return f"{remedy()}, or run with --no-isolate"


_MB: Final = 1_000_000
_STACK_BYTES: Final = 64 * 1024 * 1024
"""Stack of the first thread; own choice, eight times the default of most systems."""

Amount = Annotated[int, msgspec.Meta(ge=1, lt=10**9)]


class ProcessLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Resource limits of one robot's process; own choices, far above a strategy's needs."""

    memory_mb: Amount = 4096
    """Data, MB (RLIMIT_DATA); beyond it, the strategy's current line raises MemoryError. A robot itself uses
    about 300. The sum over all its processes is checked twice per second."""
    open_files: Amount = 256
    """Open files (RLIMIT_NOFILE)."""
    file_mb: Amount = 16_384
    """Size of each written file, including log and recording, MB (RLIMIT_FSIZE)."""
    disk_mb: Amount = 32_768
    """Total size of the files in its folder, MB, checked twice per second. Not counted: deleted files that it
    keeps open, and files that a robot without isolation writes elsewhere."""
    disk_files: Amount = 100_000
    """Files and folders there."""
    processes: Amount = 64
    """Processes and threads (RLIMIT_NPROC, which root ignores; also checked twice per second); only for
    isolated robots: otherwise the system counts all processes of the user."""


def enforce_limits(chosen: ProcessLimits, *, isolated: bool) -> None:
    """Apply the limits to this process and its future children."""
    _lower_limit(resource.RLIMIT_DATA, chosen.memory_mb * _MB)
    _lower_limit(resource.RLIMIT_NOFILE, chosen.open_files)
    _lower_limit(resource.RLIMIT_FSIZE, chosen.file_mb * _MB)
    failure.reserve_file_size()
    _lower_limit(resource.RLIMIT_CORE, 0)
    _lower_limit(resource.RLIMIT_STACK, _STACK_BYTES)  # not included in RLIMIT_DATA
    if isolated and hasattr(resource, "RLIMIT_NPROC"):
        _lower_limit(resource.RLIMIT_NPROC, chosen.processes)


def _lower_limit(kind: int, most: int) -> None:
    """Lower a limit; a smaller soft stack limit is kept, because it sets the size of new threads' stacks."""
    soft, hard = resource.getrlimit(kind)
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    keeps_soft = kind == resource.RLIMIT_STACK and soft != resource.RLIM_INFINITY
    resource.setrlimit(kind, (min(soft, allowed) if keeps_soft else allowed, allowed))
