"""Attacks on the rule that robots communicate by radio only: one or two for each layer that closes a way."""

import ctypes
import fcntl
import os
import pty
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from actors.installation.repository import REPOSITORY
from actors.runtime.lifecycle import linux
from tests.isolation.attacked_swarm import Attack, Layer, Note, Stage, SwarmMember, client

LIBC = ctypes.CDLL(None, use_errno=True)
COMMON_FILE = Path(__file__)
"""A file that every robot may read."""
R2_SENSES = "swarm/down/r2/senses"
WAIT_S = 0.3
IPC_CREAT = 0o1000
USER_KEYRING, KEYCTL_SEARCH = -4, 10
SYSCALLS = {"x86_64": (248, 250, 438), "aarch64": (217, 219, 438)}[os.uname().machine]
"""add_key, keyctl, pidfd_getfd."""
PTRACE_ATTACH, PTRACE_DETACH = 16, 17
NEST = """
import os
from contextlib import suppress
from pathlib import Path
from actors.runtime.lifecycle import linux
with suppress(OSError):
    user, group = os.getuid(), os.getgid()
    linux.unshare(linux.CLONE_NEWUSER | linux.CLONE_NEWNS)
    print("nested")
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
"""
"""Program: become root of a new user namespace, with all capabilities there."""
UNDO = """
import ctypes, sys
from contextlib import suppress
from pathlib import Path
from actors.runtime.lifecycle import linux
repository, token, out = sys.argv[1:]
for folder in (out, "/tmp", "/run"):
    if Path(repository).is_relative_to(folder):
        continue  # the file to be written would go with it
    ctypes.CDLL(None).umount2(folder.encode(), 2)
for folder in ("/", repository, "/tmp", "/run", out):
    with suppress(OSError):
        linux.mount(None, folder, None, linux.MS_REMOUNT | linux.MS_BIND | linux.mount_flags(folder))
with suppress(OSError):
    Path(repository, "." + token).write_text(token)
    print("written")
with suppress(OSError):
    print(Path(out, "r2", "credentials").read_text().split(":")[0])
"""
"""Program: undo the mounts, then write to the repository and read r2's password."""

Stages = tuple[Stage, ...]


# Router: forged and overheard messages, queries, sessions under other names.


def marked(speaker: str, listener: str, word: str) -> Stages:
    """`speaker` marks the end of its messages on an allowed key; the world passes the mark to `listener`."""

    def send(member: SwarmMember, note: Note) -> None:
        member.session.put(f"swarm/up/{member.name}/drive", f"{word} {note['token']}")

    def relay(member: SwarmMember, note: Note) -> Note:
        member.await_payload(f"{word} {note['token']}")
        reached = member.has_heard(note["token"])
        member.session.put(f"swarm/down/{listener}/senses", f"{word}, {note['token']}")
        return {"reached": reached}

    def check(member: SwarmMember, note: Note) -> Note:
        member.await_payload(f"{word}, {note['token']}")
        return {"reached": note["reached"] or member.has_heard(note["token"])}

    return ((speaker, send), ("world", relay), (listener, check))


def sending(send: Callable[[SwarmMember, str], Any]) -> Stages:
    """r2 subscribes to everything, r1 sends; reached if r2 or the world receives it."""
    return (
        ("r2", lambda member, _: member.listen("**")),
        *marked("r2", "r2", "listening"),
        ("r1", lambda member, note: send(member, note["token"]) and None),
        *marked("r1", "r2", "sent"),
    )


def put(key: str) -> Stages:
    """r1 puts on `key`."""
    return sending(lambda member, token: member.session.put(key, token))


def session_of(member: SwarmMember, **changed: Any) -> zenoh.Session:
    """Open a second session with the member's credentials, changed in part."""
    session: zenoh.Session = member.keep(zenoh.open(client(member.swarm, member.name, **changed)))
    return session


def put_as_peer(member: SwarmMember, token: str) -> None:
    """Put in a session of mode peer."""
    session = session_of(member, mode="peer")
    session.put(R2_SENSES, token)
    member.session.put("swarm/up/r1/transmit", token[::-1])


def overhear(key: str, secret_key: str, speaker: str) -> Stages:
    """r1 subscribes to `key`, then `speaker` sends the token on `secret_key`."""

    def check(member: SwarmMember, note: Note) -> Note:
        return {"reached": member.has_heard(note["token"])}

    return (
        ("r1", lambda member, _: member.listen(key)),
        *marked("r1", "r1", "listening"),
        (speaker, lambda member, note: member.session.put(secret_key, note["token"])),
        *(marked("r2", "r1", "spoken") if speaker == "r2" else marked("r1", "r1", "spoken")),
        ("r1", check),
    )


def answer_queries(member: SwarmMember, note: Note) -> None:
    """Declare a queryable that answers with the token."""
    key, token = "swarm/up/r1/state", note["token"]
    member.keep(member.session.declare_queryable(key, lambda query: query.reply(query.key_expr, token)))


def query(member: SwarmMember, note: Note) -> Note:
    """Query, and check whether the token is the answer."""
    replies = [reply.ok for reply in member.session.get("swarm/up/r1/state", timeout=0.5)]
    return {"reached": any(r is not None and bytes(r.payload).decode() == note["token"] for r in replies)}


def open_session(**changed: Any) -> Stages:
    """r1 opens a session with these credentials."""

    def act(member: SwarmMember, _: Note) -> Note:
        session_of(member, **changed)
        return {"reached": True}

    return (("r1", act),)


# Network: sockets of every family, and Zenoh without the router.


def sockets(family: int, kind: int, address: Callable[[Note], Any]) -> Stages:
    """r2 listens at an address, r1 sends the token there."""

    def listen(member: SwarmMember, note: Note) -> Note:
        receiver = member.keep(socket.socket(family, kind))
        receiver.settimeout(WAIT_S)
        receiver.bind(address(note))
        if kind == socket.SOCK_STREAM:
            receiver.listen()
        port = receiver.getsockname()[1] if family == socket.AF_INET else 0
        path = {"litter": address(note)} if family == socket.AF_UNIX and address(note)[0] == "/" else {}
        return {"port": port, **path}

    def send(_: SwarmMember, note: Note) -> None:
        with socket.socket(family, kind) as sender:
            sender.settimeout(WAIT_S)
            sender.connect(address(note))
            sender.send(note["token"].encode())

    def receive(member: SwarmMember, note: Note) -> Note:
        source: socket.socket = member.kept[0]
        if kind == socket.SOCK_STREAM:
            source = member.keep(source.accept()[0])
        source.settimeout(WAIT_S)
        return {"reached": source.recv(100).decode() == note["token"]}

    return (("r2", listen), ("r1", send), ("r2", receive))


def loopback(kind: int) -> Stages:
    """r1 sends to a port of the loopback interface."""
    return sockets(socket.AF_INET, kind, lambda note: ("127.0.0.1", note.get("port", 0)))


def unix_socket(place: Callable[[Note], str]) -> Stages:
    """r1 connects to a Unix socket of r2."""
    return sockets(socket.AF_UNIX, socket.SOCK_STREAM, place)


def peer(endpoint: str, role: str) -> zenoh.Config:
    """Return the configuration of a Zenoh peer without a router."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"peer"'),
        ("scouting/multicast/enabled", "false"),
        ("transport/shared_memory/enabled", "false"),
        ("listen/endpoints", "[]"),
        ("connect/timeout_ms", "1500"),
        ("connect/exit_on_failure", "true"),
        (f"{role}/endpoints", f'["{endpoint}"]'),
    ):
        config.insert_json5(key, value)
    return config


def listen_as_peer(member: SwarmMember, _: Note) -> Note:
    """Open a Zenoh peer on a free port."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    member.listen("**", member.keep(zenoh.open(peer(endpoint, "listen"))))
    return {"endpoint": endpoint}


def connect_as_peer(member: SwarmMember, note: Note) -> None:
    """Connect to the other peer and put the token once it has subscribed."""
    session = member.keep(zenoh.open(peer(note["endpoint"], "connect")))
    publisher = member.keep(session.declare_publisher("hello"))
    for _ in range(500):
        if publisher.matching_status.matching:
            break
        time.sleep(0.01)
    publisher.put(note["token"])


def heard_by_peer(member: SwarmMember, note: Note) -> Note:
    """Receive the token past the router."""
    member.await_payload(note["token"])
    return {"reached": True}


def connect_to(place: Callable[[SwarmMember], str]) -> Stages:
    """r1 connects to a router's Unix socket."""

    def act(member: SwarmMember, _: Note) -> Note:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(place(member))
        return {"reached": True}

    return (("r1", act),)


def open_vsock(_: SwarmMember, __: Note) -> Note:
    """Open a socket of a family without network namespaces."""
    with socket.socket(socket.AF_VSOCK, socket.SOCK_STREAM):
        return {"reached": True}


# Files: shared folders, other robots' files, other runs, the scenario, descriptors, locks, devices.


def shared_file(folder: Callable[[SwarmMember], str | Path]) -> Stages:
    """r1 writes a file, r2 reads it."""

    def write(member: SwarmMember, note: Note) -> Note:
        path = Path(folder(member)) / f".{note['token']}"
        path.write_text(note["token"])
        return {"litter": str(path)}

    def read(_: SwarmMember, note: Note) -> Note:
        return {"reached": Path(note["litter"]).read_text() == note["token"]}

    return (("r1", write), ("r2", read))


def read_file(place: Callable[[SwarmMember], Path]) -> Stages:
    """r1 reads a file that is not its own."""

    def act(member: SwarmMember, _: Note) -> Note:
        return {"reached": bool(place(member).read_text())}

    return (("r1", act),)


def start_run(member: SwarmMember, note: Note) -> None:
    """Make the folder of a run that starts after the robots."""
    out = Path(member.swarm.study, "runs", note["token"], "r9")
    out.mkdir(parents=True)
    (out / "r9.mcap").write_text(note["token"])


def read_by_descriptor(member: SwarmMember, _: Note) -> Note:
    """Use an inherited descriptor of the output folder."""
    handle = os.open("r2/credentials", os.O_RDONLY, dir_fd=member.swarm.inherited["folder"])
    with os.fdopen(handle) as file:
        return {"reached": file.read().startswith("r2:")}


def write_to_pipe(member: SwarmMember, note: Note) -> None:
    """Write to an inherited pipe."""
    os.write(member.swarm.inherited["pipe_in"], note["token"].encode())


def read_from_pipe(member: SwarmMember, note: Note) -> Note:
    """Read from the inherited pipe."""
    return {"reached": os.read(member.swarm.inherited["pipe_out"], 100).decode() == note["token"]}


def open_terminal(member: SwarmMember, note: Note) -> Note:
    """Open a pseudoterminal and type the token."""
    for handle in pty.openpty():
        member.keep(os.fdopen(handle, "r+b", buffering=0))
    os.write(member.kept[0].fileno(), note["token"].encode() + b"\n")
    return {"path": os.ttyname(member.kept[1].fileno())}


def read_terminal(_: SwarmMember, note: Note) -> Note:
    """Read from the pseudoterminal."""
    handle = os.open(note["path"], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    with os.fdopen(handle, "rb", buffering=0) as terminal:
        return {"reached": note["token"].encode() in terminal.read(100)}


def open_disk(_: SwarmMember, __: Note) -> Note:
    """Open a block device."""
    for disk in (path for path in Path("/dev").iterdir() if path.is_block_device()):
        os.close(os.open(disk, os.O_RDONLY))
        return {"reached": True}
    raise FileNotFoundError("no disk in /dev")


def lock(member: SwarmMember, _: Note) -> None:
    """Lock a file that every robot may read."""
    fcntl.flock(member.keep(COMMON_FILE.open()), fcntl.LOCK_EX | fcntl.LOCK_NB)


def find_lock(_: SwarmMember, __: Note) -> Note:
    """Check whether the file is locked."""
    with COMMON_FILE.open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return {"reached": True}
    return {"reached": False}


# Processes: IPC, key rings, signals, limits, memory, /proc, and ways out of the sandbox.


def checked(result: int, name: str) -> int:
    """Return the result of a C function or raise OSError."""
    if result == -1:
        raise OSError(ctypes.get_errno(), name)
    return result


def make_segment(_: SwarmMember, note: Note) -> Note:
    """Make a System V segment whose key follows from the token."""
    key = int(note["token"], 16) & 0x7FFF_FFFF
    return {"key": key, "segment": checked(LIBC.shmget(key, 4096, IPC_CREAT | 0o600), "shmget")}


def find_segment(_: SwarmMember, note: Note) -> Note:
    """Find the segment by its key and remove it."""
    LIBC.shmctl(checked(LIBC.shmget(note["key"], 4096, 0), "shmget"), 0, None)
    return {"reached": True}


def store_key(_: SwarmMember, note: Note) -> None:
    """Put the token into the user's key ring."""
    text = note["token"].encode()
    size = ctypes.c_size_t(len(text))
    checked(LIBC.syscall(SYSCALLS[0], b"user", text, text, size, USER_KEYRING), "add_key")


def find_key(_: SwarmMember, note: Note) -> Note:
    """Search the user's key ring."""
    words = (KEYCTL_SEARCH, USER_KEYRING, b"user", note["token"].encode(), 0)
    checked(LIBC.syscall(SYSCALLS[1], *words), "keyctl")
    return {"reached": True}


def await_signals(member: SwarmMember, _: Note) -> Note:
    """Collect signals."""
    signal.signal(signal.SIGUSR1, lambda got, _: member.signals.append(got))
    return {"pid": member.pid}


def kill(_: SwarmMember, note: Note) -> None:
    """Send a signal."""
    os.kill(note["pid"], signal.SIGUSR1)


def got_signal(member: SwarmMember, _: Note) -> Note:
    """Check whether a signal has come."""
    return {"reached": bool(member.signals)}


def set_limit(_: SwarmMember, note: Note) -> None:
    """Change a resource limit of the other process."""
    soft, hard = resource.prlimit(note["pid"], resource.RLIMIT_NOFILE)
    resource.prlimit(note["pid"], resource.RLIMIT_NOFILE, (soft - 1, hard))


def limits(member: SwarmMember, note: Note) -> Note:
    """Check whether the own resource limit has changed since the last call."""
    now = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return {"pid": member.pid, "limit": now, "reached": note.get("limit", now) != now}


def hold_secret(member: SwarmMember, note: Note) -> Note:
    """Hold the token in memory and in an open file."""
    path = member.folder / "diary"
    path.write_text(note["token"])
    text = ctypes.create_string_buffer(note["token"].encode())
    SECRETS.append(text)
    handle = member.keep(path.open("rb", buffering=0)).fileno()
    return {"pid": member.pid, "handle": handle, "address": ctypes.addressof(text), "path": str(path)}


SECRETS: list[ctypes.Array[ctypes.c_char]] = []
"""Keeps the buffers of `hold_secret` alive."""


def read_proc(entry: str) -> Stage:
    """r1 reads an entry of /proc about r2."""

    def act(_: SwarmMember, note: Note) -> Note:
        text = Path(f"/proc/{note['pid']}/{entry.format(**note)}").read_bytes().decode(errors="replace")
        return {"reached": any(word in text for word in (note["token"], "SECRET=", "attacked_swarm"))}

    return ("r1", act)


def take_descriptor(_: SwarmMember, note: Note) -> Note:
    """Take a descriptor by pidfd_getfd(2)."""
    process_handle = os.pidfd_open(note["pid"])
    handle = checked(LIBC.syscall(SYSCALLS[2], process_handle, note["handle"], 0), "pidfd_getfd")
    os.close(process_handle)
    with os.fdopen(handle, "rb", buffering=0) as file:
        return {"reached": file.read().decode() == note["token"]}


class IoVector(ctypes.Structure):
    """struct iovec."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def read_memory(_: SwarmMember, note: Note) -> Note:
    """Read memory by process_vm_readv(2)."""
    size = len(note["token"])
    buffer = ctypes.create_string_buffer(size)
    here, there = IoVector(ctypes.addressof(buffer), size), IoVector(note["address"], size)
    vectors = (ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
    checked(LIBC.process_vm_readv(note["pid"], *vectors), "process_vm_readv")
    return {"reached": buffer.raw.decode() == note["token"]}


def trace(_: SwarmMember, note: Note) -> Note:
    """Attach by ptrace(2)."""
    checked(LIBC.ptrace(PTRACE_ATTACH, note["pid"], None, None), "ptrace")
    os.waitpid(note["pid"], 0x4000_0000)
    LIBC.ptrace(PTRACE_DETACH, note["pid"], None, None)
    return {"reached": True}


def read_environment(_: SwarmMember, __: Note) -> Note:
    """Read the user's environment variables."""
    return {"reached": "SECRET" in os.environ}


def remount(_: SwarmMember, note: Note) -> Note:
    """Make the tree writable again, and write."""
    for folder in ("/", str(REPOSITORY)):
        try:
            linux.mount(None, folder, None, linux.MS_REMOUNT | linux.MS_BIND | linux.mount_flags(folder))
        except OSError:
            continue
    path = REPOSITORY / f".{note['token']}"
    path.write_text(note["token"])
    return {"litter": str(path), "reached": True}


def break_out(member: SwarmMember, note: Note) -> Note:
    """Undo the file tree in a nested user namespace."""
    ran = subprocess.run(
        [sys.executable, "-c", NEST + UNDO, str(REPOSITORY), note["token"], member.swarm.out],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=True,
    )
    reached = {"written", "r2"} & set(ran.stdout.split())
    return {"litter": str(REPOSITORY / f".{note['token']}"), "reached": bool(reached)}


def out_of(member: SwarmMember) -> Path:
    """The run's output folder."""
    return Path(member.swarm.out)


def study_of(member: SwarmMember) -> Path:
    """The folder with the robots' code."""
    return Path(member.swarm.study)


def rule(name: str, stages: Stages) -> Attack:
    """Return an attack that the router blocks."""
    return Attack(name, Layer.RULES, stages)


def process(name: str, *stages: Stage, root: bool = False, traces: bool = False) -> Attack:
    """Return an attack that only the sandbox blocks."""
    return Attack(name, Layer.PROCESS, stages, root, traces)


ATTACKS = (
    Attack("control: put on the own key", Layer.NONE, put("swarm/up/r1/drive")),
    Attack(
        "control: subscribe to the own key",
        Layer.NONE,
        overhear("swarm/down/r1/**", "swarm/down/r1/received", "world"),
    ),
    rule("put on a key of r2", put("swarm/up/r2/drive")),
    rule("put on r2's incoming key", put(R2_SENSES)),
    rule("put on a key of the world", put("swarm/infra/truth")),
    rule("put on a wildcard", put("swarm/**")),
    rule("put in a session of mode peer", sending(put_as_peer)),
    rule("subscribe to all, the world speaks", overhear("swarm/**", "swarm/down/r2/received", "world")),
    rule("subscribe to r2's keys", overhear("swarm/up/r2/**", "swarm/up/r2/transmit", "r2")),
    rule("query by r2", (("r1", answer_queries), *marked("r1", "r2", "declared"), ("r2", query))),
    rule("session with a wrong password", open_session(password="guessed")),
    rule("session without a password", open_session(user=None, password=None)),
    rule("session under r2's name", open_session(user="r2")),
    process("TCP over loopback", *loopback(socket.SOCK_STREAM)),
    process("abstract Unix socket", *unix_socket(lambda note: "\0" + note["token"])),
    process("Zenoh peers", ("r2", listen_as_peer), ("r1", connect_as_peer), ("r2", heard_by_peer)),
    process("router socket of r2", *connect_to(lambda member: f"{out_of(member)}/r2/router.sock")),
    process("vsock", ("r1", open_vsock)),
    process("file in /tmp", *shared_file(lambda _: "/tmp")),
    process("file in /dev/shm (POSIX shared memory)", *shared_file(lambda _: "/dev/shm")),
    process("file in the output folder", *shared_file(out_of)),
    process("file in the repository", *shared_file(lambda _: REPOSITORY)),
    process("password of r2", *read_file(lambda member: out_of(member) / "r2" / "credentials")),
    process("password of r2 by the working directory", *read_file(lambda _: Path("r2/credentials"))),
    process("recording of another run", *read_file(lambda m: study_of(m) / "runs/other/r9/r9.mcap")),
    process("scenario with the seed", *read_file(lambda member: study_of(member) / "scenario.toml")),
    process(
        "recording of a run that starts later",
        ("world", start_run),
        (
            "r1",
            lambda member, note: {
                "reached": bool((study_of(member) / "runs" / note["token"] / "r9/r9.mcap").read_text())
            },
        ),
    ),
    process("inherited descriptor of a folder", ("r1", read_by_descriptor)),
    process("inherited pipe", ("r1", write_to_pipe), ("r2", read_from_pipe)),
    process("pseudoterminal", ("r1", open_terminal), ("r2", read_terminal)),
    process("disk as a device file", ("r1", open_disk), root=True),
    process("lock on a common file", ("r1", lock), ("r2", find_lock)),
    process("System V shared memory", ("r1", make_segment), ("r2", find_segment)),
    process("key ring of the user", ("r1", store_key), ("r2", find_key)),
    process("signal", ("r2", await_signals), ("r1", kill), ("r2", got_signal)),
    process("resource limits of r2", ("r2", limits), ("r1", set_limit), ("r2", limits)),
    process("environment variables of the user", ("r1", read_environment)),
    process("command line of r2", ("r2", hold_secret), read_proc("cmdline")),
    process("environment of r2", ("r2", hold_secret), read_proc("environ"), traces=True),
    process("file of r2 by /proc", ("r2", hold_secret), read_proc("root{path}"), traces=True),
    process("descriptor of r2", ("r2", hold_secret), ("r1", take_descriptor), traces=True),
    process("memory of r2", ("r2", hold_secret), ("r1", read_memory), traces=True),
    process("tracing r2", ("r2", hold_secret), ("r1", trace), traces=True),
    process("remounting the file tree", ("r1", remount)),
    process("nested user namespace", ("r1", break_out)),
)
