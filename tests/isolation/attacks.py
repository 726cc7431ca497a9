"""Attacks on the rule that robots communicate by radio only: one or two for each protection layer."""

import ctypes
import fcntl
import os
import pty
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from actors.installation.repository import REPOSITORY
from actors.runtime import linux
from tests.isolation.attacked_swarm import Attack, Layer, Note, Stage, SwarmMember, client

LIBC = ctypes.CDLL(None, use_errno=True)
COMMON_FILE = Path(__file__)
"""A file that every robot may read."""
R2_SENSES = "swarm/down/r2/senses"
WAIT_S = 0.3
IPC_CREAT = 0o1000
USER_KEYRING, KEYCTL_SEARCH = -4, 10
SYSCALLS = {"x86_64": (248, 250), "aarch64": (217, 219)}[os.uname().machine]
"""add_key, keyctl."""
NEST = """
import os
from contextlib import suppress
from pathlib import Path
from actors.runtime import linux
with suppress(OSError):
    user, group = os.getuid(), os.getgid()
    linux.unshare(linux.CLONE_NEWUSER | linux.CLONE_NEWNS)
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
"""
"""Program: become root of a new user namespace, with all capabilities there."""
UNDO = """
import ctypes, sys
from contextlib import suppress
from pathlib import Path
from actors.runtime import linux
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
with suppress(OSError):
    print(Path(out, "r2", "credentials").read_text().split(":")[0])
"""
"""Program: undo the mounts, then write to the repository and read r2's password."""

Stages = tuple[Stage, ...]
Place = Callable[[SwarmMember, Note], str | Path]


def marked(speaker: str, listener: str, word: str) -> Stages:

    def send(member: SwarmMember, note: Note) -> None:
        member.session.put(f"swarm/up/{member.name}/drive", f"{word} {note['token']}")

    def relay(member: SwarmMember, note: Note) -> bool:
        member.await_payload(f"{word} {note['token']}")
        reached = member.has_heard(note["token"])
        member.session.put(f"swarm/down/{listener}/senses", f"{word}, {note['token']}")
        return reached

    def check(member: SwarmMember, note: Note) -> bool:
        member.await_payload(f"{word}, {note['token']}")
        return note["reached"] or member.has_heard(note["token"])

    return ((speaker, send), ("world", relay), (listener, check))


def sending(send: Callable[[SwarmMember, str], Any]) -> Stages:
    return (
        ("r2", lambda member, _: member.listen("**")),
        *marked("r2", "r2", "listening"),
        ("r1", lambda member, note: send(member, note["token"]) and None),
        *marked("r1", "r2", "sent"),
    )


def put(key: str) -> Stages:
    return sending(lambda member, token: member.session.put(key, token))


def put_as_peer(member: SwarmMember, token: str) -> None:
    session_of(member, mode="peer").put(R2_SENSES, token)
    member.session.put("swarm/up/r1/transmit", token[::-1])


def session_of(member: SwarmMember, **changed: Any) -> zenoh.Session:
    session: zenoh.Session = member.keep(zenoh.open(client(member.swarm, member.name, **changed)))
    return session


def open_session(**changed: Any) -> Stage:
    return ("r1", lambda member, _: session_of(member, **changed) is not None)


def overhear(key: str, secret_key: str) -> Stages:
    return (
        ("r1", lambda member, _: member.listen(key)),
        *marked("r1", "r1", "listening"),
        ("world", lambda member, note: member.session.put(secret_key, note["token"])),
        *marked("r1", "r1", "spoken"),
        ("r1", lambda member, note: member.has_heard(note["token"])),
    )


def answer_queries(member: SwarmMember, note: Note) -> None:
    key, token = "swarm/up/r1/state", note["token"]
    member.keep(member.session.declare_queryable(key, lambda query: query.reply(query.key_expr, token)))


def query(member: SwarmMember, note: Note) -> bool:
    replies = [reply.ok for reply in member.session.get("swarm/up/r1/state", timeout=0.5)]
    return any(r is not None and bytes(r.payload).decode() == note["token"] for r in replies)


def stream(family: int, address: Callable[[Note], Any]) -> Stages:

    def listen(member: SwarmMember, note: Note) -> Note:
        receiver = member.keep(socket.socket(family))
        receiver.settimeout(WAIT_S)
        receiver.bind(address(note))
        receiver.listen()
        return {"port": receiver.getsockname()[1] if family == socket.AF_INET else 0}

    def send(_: SwarmMember, note: Note) -> None:
        with socket.socket(family) as sender:
            sender.settimeout(WAIT_S)
            sender.connect(address(note))
            sender.send(note["token"].encode())

    def receive(member: SwarmMember, note: Note) -> bool:
        source: socket.socket = member.keep(member.kept[0].accept()[0])
        source.settimeout(WAIT_S)
        return bool(source.recv(100).decode() == note["token"])

    return (("r2", listen), ("r1", send), ("r2", receive))


def connect(member: SwarmMember, _: Note) -> bool:
    member.keep(socket.socket(socket.AF_UNIX)).connect(f"{member.swarm.out}/r2/router.sock")
    return True


def shared_file(folder: Callable[[SwarmMember], str | Path]) -> Stages:

    def write(member: SwarmMember, note: Note) -> Note:
        path = Path(folder(member)) / f".{note['token']}"
        path.write_text(note["token"])
        return {"litter": str(path)}

    return (("r1", write), ("r2", lambda _, note: Path(note["litter"]).read_text() == note["token"]))


def read_file(place: Place) -> Stage:
    return ("r1", lambda member, note: Path(place(member, note)).read_text() != "")


def start_run(member: SwarmMember, note: Note) -> None:
    out = Path(member.swarm.study, "runs", note["token"], "r9")
    out.mkdir(parents=True)
    (out / "r9.mcap").write_text(note["token"])


def read_by_descriptor(member: SwarmMember, _: Note) -> bool:
    with os.fdopen(os.open("r2/credentials", os.O_RDONLY, dir_fd=member.swarm.inherited)) as file:
        return file.read().startswith("r2:")


def open_terminal(member: SwarmMember, note: Note) -> Note:
    for handle in pty.openpty():
        member.keep(os.fdopen(handle, "r+b", buffering=0))
    os.write(member.kept[0].fileno(), note["token"].encode() + b"\n")
    return {"path": os.ttyname(member.kept[1].fileno())}


def read_terminal(_: SwarmMember, note: Note) -> bool:
    handle = os.open(note["path"], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    with os.fdopen(handle, "rb", buffering=0) as terminal:
        return note["token"].encode() in terminal.read(100)


def lock(member: SwarmMember, _: Note) -> None:
    fcntl.flock(member.keep(COMMON_FILE.open()), fcntl.LOCK_EX | fcntl.LOCK_NB)


def find_lock(member: SwarmMember, note: Note) -> bool:
    try:
        lock(member, note)
    except BlockingIOError:
        return True
    return False


def checked(result: int, name: str) -> int:
    if result == -1:
        raise OSError(ctypes.get_errno(), name)
    return result


def make_segment(_: SwarmMember, note: Note) -> Note:
    key = int(note["token"], 16) & 0x7FFF_FFFF
    checked(LIBC.shmget(key, 4096, IPC_CREAT | 0o600), "shmget")
    return {"key": key}


def find_segment(_: SwarmMember, note: Note) -> bool:
    LIBC.shmctl(checked(LIBC.shmget(note["key"], 4096, 0), "shmget"), 0, None)
    return True


def store_key(_: SwarmMember, note: Note) -> None:
    text = note["token"].encode()
    size = ctypes.c_size_t(len(text))
    checked(LIBC.syscall(SYSCALLS[0], b"user", text, text, size, USER_KEYRING), "add_key")


def find_key(_: SwarmMember, note: Note) -> bool:
    words = (KEYCTL_SEARCH, USER_KEYRING, b"user", note["token"].encode(), 0)
    return checked(LIBC.syscall(SYSCALLS[1], *words), "keyctl") != -1


def await_signals(member: SwarmMember, _: Note) -> Note:
    signal.signal(signal.SIGUSR1, lambda got, _: member.signals.append(got))
    return {"pid": member.pid}


def hold_secret(member: SwarmMember, note: Note) -> Note:
    text = ctypes.create_string_buffer(note["token"].encode())
    SECRETS.append(text)
    return {"pid": member.pid, "address": ctypes.addressof(text)}


SECRETS: list[ctypes.Array[ctypes.c_char]] = []
"""Keeps the buffers of `hold_secret` alive."""


def read_environment(_: SwarmMember, note: Note) -> bool:
    return b"SECRET=" in Path(f"/proc/{note['pid']}/environ").read_bytes()


class IoVector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def read_memory(_: SwarmMember, note: Note) -> bool:
    size = len(note["token"])
    buffer = ctypes.create_string_buffer(size)
    here, there = IoVector(ctypes.addressof(buffer), size), IoVector(note["address"], size)
    vectors = (ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
    checked(LIBC.process_vm_readv(note["pid"], *vectors), "process_vm_readv")
    return bool(buffer.raw.decode() == note["token"])


def remount(_: SwarmMember, note: Note) -> Note:
    for folder in ("/", str(REPOSITORY)):
        try:
            linux.mount(None, folder, None, linux.MS_REMOUNT | linux.MS_BIND | linux.mount_flags(folder))
        except OSError:
            continue
    path = REPOSITORY / f".{note['token']}"
    path.write_text(note["token"])
    return {"litter": str(path)}


def find_litter(_: SwarmMember, note: Note) -> bool:
    return bool(note.get("password")) or Path(note["litter"]).exists()


def break_out(member: SwarmMember, note: Note) -> Note:
    ran = subprocess.run(
        [sys.executable, "-c", NEST + UNDO, str(REPOSITORY), note["token"], str(member.swarm.out)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=True,
    )
    return {"litter": str(REPOSITORY / f".{note['token']}"), "password": "r2" in ran.stdout.split()}


def rule(name: str, *stages: Stage) -> Attack:
    return Attack(name, Layer.RULES, stages)


def process(name: str, *stages: Stage, traces: bool = False) -> Attack:
    return Attack(name, Layer.PROCESS, stages, traces)


ATTACKS = (
    Attack("control: put on the own key", Layer.NONE, put("swarm/up/r1/drive")),
    Attack("control: own key", Layer.NONE, overhear("swarm/down/r1/**", "swarm/down/r1/received")),
    rule("put on a key of r2", *put("swarm/up/r2/drive")),
    rule("put on a key of the world", *put("swarm/infra/truth")),
    rule("put on a wildcard", *put("swarm/**")),
    rule("put in a session of mode peer", *sending(put_as_peer)),
    rule("subscribe to all, the world speaks", *overhear("swarm/**", "swarm/down/r2/received")),
    rule("query by r2", ("r1", answer_queries), *marked("r1", "r2", "declared"), ("r2", query)),
    rule("session without a password", open_session(user=None, password=None)),
    rule("session under r2's name", open_session(user="r2")),
    process("TCP over loopback", *stream(socket.AF_INET, lambda note: ("127.0.0.1", note.get("port", 0)))),
    process("abstract Unix socket", *stream(socket.AF_UNIX, lambda note: "\0" + note["token"])),
    process("router socket of r2", ("r1", connect)),
    process("vsock", ("r1", lambda member, _: member.keep(socket.socket(socket.AF_VSOCK)) is not None)),
    process("file in /tmp", *shared_file(lambda _: "/tmp")),
    process("file in /dev/shm (POSIX shared memory)", *shared_file(lambda _: "/dev/shm")),
    process("file in the output folder", *shared_file(lambda member: member.swarm.out)),
    process("file in the repository", *shared_file(lambda _: REPOSITORY)),
    process("password of r2", read_file(lambda member, _: f"{member.swarm.out}/r2/credentials")),
    process("recording of another run", read_file(lambda m, _: f"{m.swarm.study}/runs/other/r9/r9.mcap")),
    process("scenario with the seed", read_file(lambda member, _: f"{member.swarm.study}/scenario.toml")),
    process(
        "recording of a run that starts later",
        ("world", start_run),
        read_file(lambda member, note: f"{member.swarm.study}/runs/{note['token']}/r9/r9.mcap"),
    ),
    process("inherited descriptor of a folder", ("r1", read_by_descriptor)),
    process("pseudoterminal", ("r1", open_terminal), ("r2", read_terminal)),
    process("lock on a common file", ("r1", lock), ("r2", find_lock)),
    process("System V shared memory", ("r1", make_segment), ("r2", find_segment)),
    process("key ring of the user", ("r1", store_key), ("r2", find_key)),
    process(
        "signal",
        ("r2", await_signals),
        ("r1", lambda _, note: os.kill(note["pid"], signal.SIGUSR1)),
        ("r2", lambda member, _: bool(member.signals)),
    ),
    process("environment variables of the user", ("r1", lambda _, __: "SECRET" in os.environ)),
    process("environment of r2", ("r2", hold_secret), ("r1", read_environment), traces=True),
    process("memory of r2", ("r2", hold_secret), ("r1", read_memory), traces=True),
    process("remounting the file tree", ("r1", remount), ("r2", find_litter)),
    process("nested user namespace", ("r1", break_out), ("r2", find_litter)),
)
