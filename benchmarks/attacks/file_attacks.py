"""Attacks over files: shared folders, the other's own files, locks and watches, devices, leftovers."""

import ctypes
import fcntl
import os
import pty
import socket
import stat
import struct
from pathlib import Path

from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.member import Note, Stage, SwarmMember
from benchmarks.attacks.network_attacks import TREE, folder_of, process

COMMON_FILE = Path(__file__)
"""Something that every robot may read."""
FILTER = "system call filter"
IN_OPEN = 0x20
F_SETLEASE = 1024
F_GET_RW_HINT, F_SET_RW_HINT = 1035, 1036


def in_folder(folder: str) -> tuple[Stage, ...]:
    """r1 leaves a file, r2 finds it."""

    def leave(member: SwarmMember, note: Note) -> Note:
        path = folder_of(member, folder) / f".{note['token']}"
        path.write_text(note["token"])
        return {"path": str(path), "litter": [str(path)]}

    def find(_: SwarmMember, note: Note) -> Note:
        return {"reached": Path(note["path"]).read_text() == note["token"]}

    return (("r1", leave), ("r2", find))


def keep_diary(member: SwarmMember, note: Note) -> Note:
    """Write the token to a file in one's own folder, as a recording would."""
    (member.folder / "recording.mcap").write_text(note["token"])
    return {"path": str(member.folder / "recording.mcap")}


def read_diary(_: SwarmMember, note: Note) -> Note:
    """Read it by its path."""
    return {"reached": Path(note["path"]).read_text() == note["token"]}


def read_file(name: str) -> tuple[Stage, ...]:
    """r1 reads a file of the run's output folder that is not its own."""

    def act(member: SwarmMember, _: Note) -> Note:
        return {"reached": "r2:" in Path(member.swarm.out, name).read_text()}

    return (("r1", act),)


def plant(member: SwarmMember, note: Note) -> None:
    """Write into the other's folder."""
    Path(member.swarm.robots["r2"], "planted").write_text(note["token"])


def find_planted(member: SwarmMember, note: Note) -> Note:
    """Look into one's own folder."""
    return {"reached": (member.folder / "planted").read_text() == note["token"]}


def read_relative(_: SwarmMember, __: Note) -> Note:
    """The members were started in the output folder: read from there."""
    return {"reached": Path("r2/credentials").read_text().startswith("r2:")}


def read_by_descriptor(member: SwarmMember, _: Note) -> Note:
    """Use an inherited descriptor of the output folder."""
    handle = os.open("r2/credentials", os.O_RDONLY, dir_fd=member.swarm.inherited["folder"])
    with os.fdopen(handle) as file:
        return {"reached": file.read().startswith("r2:")}


def write_to_pipe(member: SwarmMember, note: Note) -> None:
    """Use an inherited pipe that every robot has."""
    os.write(member.swarm.inherited["pipe_in"], note["token"].encode())


def read_from_pipe(member: SwarmMember, note: Note) -> Note:
    """Read the inherited pipe."""
    return {"reached": os.read(member.swarm.inherited["pipe_out"], 100).decode() == note["token"]}


def open_terminal(member: SwarmMember, note: Note) -> Note:
    """Make a pseudoterminal and type the token into it."""
    for handle in pty.openpty():
        member.keep(os.fdopen(handle, "r+b", buffering=0))
    os.write(member.kept[0].fileno(), note["token"].encode() + b"\n")
    return {"path": os.ttyname(member.kept[1].fileno())}


def read_terminal(_: SwarmMember, note: Note) -> Note:
    """Read what was typed."""
    handle = os.open(note["path"], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    with os.fdopen(handle, "rb", buffering=0) as terminal:
        return {"reached": note["token"].encode() in terminal.read(100)}


def open_disk(_: SwarmMember, __: Note) -> Note:
    """Open a disk as a device file."""
    disks = [path for path in Path("/dev").iterdir() if path.is_block_device()]
    for disk in disks:
        os.close(os.open(disk, os.O_RDONLY))
        return {"reached": True}
    raise FileNotFoundError("no disk in /dev")


def lock_whole(member: SwarmMember, _: Note) -> None:
    """Lock a file that everyone may read."""
    fcntl.flock(member.keep(COMMON_FILE.open()), fcntl.LOCK_EX | fcntl.LOCK_NB)


def meet_lock(_: SwarmMember, __: Note) -> Note:
    """Find it locked."""
    with COMMON_FILE.open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return {"reached": True}
    return {"reached": False}


def lock_bytes(member: SwarmMember, _: Note) -> None:
    """Lock a part of a file that everyone may read."""
    fcntl.lockf(member.keep(COMMON_FILE.open()), fcntl.LOCK_SH | fcntl.LOCK_NB, 1, 7)


def meet_byte_lock(_: SwarmMember, __: Note) -> Note:
    """Ask who would be in the way of a write lock (fcntl(2), F_GETLK)."""
    question = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 7, 1, 0)
    with COMMON_FILE.open() as file:
        answer = struct.unpack("hhqqi4x", fcntl.fcntl(file, fcntl.F_GETLK, question))
    return {"reached": answer[0] != fcntl.F_UNLCK}


def lease(_: SwarmMember, __: Note) -> Note:
    """A write lease is granted while nobody else has the file open."""
    with COMMON_FILE.open() as file:
        try:
            fcntl.fcntl(file, F_SETLEASE, fcntl.F_WRLCK)
        except BlockingIOError:
            return {"reached": True}
        fcntl.fcntl(file, F_SETLEASE, fcntl.F_UNLCK)
    return {"reached": False}


def hold_open(member: SwarmMember, _: Note) -> None:
    """Have the common file open."""
    member.keep(COMMON_FILE.open())


def watch(member: SwarmMember, _: Note) -> None:
    """Watch the common file (inotify(7))."""
    libc = ctypes.CDLL(None, use_errno=True)
    handle = libc.inotify_init1(os.O_NONBLOCK)
    if handle == -1:
        raise OSError(ctypes.get_errno(), "inotify_init1")
    member.keep(os.fdopen(handle, "rb", buffering=0))
    if libc.inotify_add_watch(handle, os.fsencode(COMMON_FILE), IN_OPEN) == -1:
        raise OSError(ctypes.get_errno(), "inotify_add_watch")


def see_event(member: SwarmMember, _: Note) -> Note:
    """See that it was opened."""
    return {"reached": bool(member.kept[0].read(100))}


def read_beside(name: str) -> tuple[Stage, ...]:
    """r1 reads what lies in the folder with its code but is none of its business."""

    def act(member: SwarmMember, _: Note) -> Note:
        return {"reached": bool(Path(member.swarm.study, name).read_text())}

    return (("r1", act),)


def connect_to_other(member: SwarmMember, _: Note) -> Note:
    """Connect to the router of another run."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(f"{member.swarm.other}/world/router.sock")
    return {"reached": True}


def begin_later(place: str) -> Stage:
    """Another run begins while this one goes on."""

    def act(member: SwarmMember, note: Note) -> None:
        out = Path(member.swarm.study, place, note["token"])
        (out / "r9").mkdir(parents=True)
        (out / "r9" / "r9.mcap").write_text(note["token"])

    return ("world", act)


def read_later(place: str) -> Stage:
    """r1 reads that run's recording."""

    def act(member: SwarmMember, note: Note) -> Note:
        path = Path(member.swarm.study, place, note["token"], "r9", "r9.mcap")
        return {"reached": path.read_text() == note["token"]}

    return ("r1", act)


def set_hint(member: SwarmMember, _: Note) -> None:
    """Say how long what is written to the common file will be needed (fcntl(2), F_SET_RW_HINT)."""
    with COMMON_FILE.open() as file:
        fcntl.fcntl(file, F_SET_RW_HINT, struct.pack("=Q", 4))


def get_hint(_: SwarmMember, __: Note) -> Note:
    """Read the hint, and clear it."""
    with COMMON_FILE.open() as file:
        (hint,) = struct.unpack("=Q", fcntl.fcntl(file, F_GET_RW_HINT, bytes(8)))
        fcntl.fcntl(file, F_SET_RW_HINT, bytes(8))
    return {"reached": hint == 4}


def write_note(member: SwarmMember, note: Note) -> None:
    """A file of r1's own for the next process to find, with the set-user-ID bit."""
    path = member.folder / "program"
    path.write_text(note["token"])
    path.chmod(0o4755)


def create_note(member: SwarmMember, _: Note) -> None:
    """The same in one go."""
    mask = os.umask(0)
    os.close(os.open(member.folder / "program", os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o4755))
    os.umask(mask)


def find_set_id(member: SwarmMember, _: Note) -> Note:
    """Whether a program of the user's is there that anybody can run in his name."""
    path = Path(member.swarm.robots["r1"], "program")
    mode = path.stat().st_mode if path.exists() else 0
    path.unlink(missing_ok=True)
    return {"reached": bool(mode & stat.S_ISUID)}


FILE_ATTACKS = (
    *(
        process(f"file in {place}", TREE, *in_folder(folder), folder=folder)
        for folder, place in (
            ("/tmp", "/tmp"),
            ("/var/tmp", "/var/tmp"),
            ("/run", "/run"),
            ("/dev/shm", "/dev/shm (POSIX shared memory)"),
            ("out", "the run's output folder"),
            ("repository", "the repository"),
            ("home", "the home folder"),
        )
    ),
    process("recording of r2", TREE, ("r2", keep_diary), ("r1", read_diary)),
    process("password of r2", TREE, *read_file("r2/credentials")),
    process("the router's passwords", TREE, *read_file("infra/users")),
    process("writing into r2's folder", TREE, ("r1", plant), ("r2", find_planted)),
    process("former working directory", TREE, ("r1", read_relative)),
    process("inherited descriptor of a folder", "closed descriptors", ("r1", read_by_descriptor)),
    process("inherited pipe", "closed descriptors", ("r1", write_to_pipe), ("r2", read_from_pipe)),
    process("pseudoterminal", TREE, ("r1", open_terminal), ("r2", read_terminal)),
    Attack("disk as a device file", Layer.PROCESS, TREE, (("r1", open_disk),), root=True),
    process("recording of another run", TREE, *read_beside("runs/other/r9/r9.mcap")),
    process(
        "operator's password of another run", TREE, *read_beside("runs/other/world/operator.credentials")
    ),
    process("router socket of another run", TREE, ("r1", connect_to_other)),
    process("recording of a run that begins later", TREE, begin_later("runs"), read_later("runs")),
    process("run that begins later beside the code", TREE, begin_later("."), read_later(".")),
    process("scenario beside the code", TREE, *read_beside("scenario.toml")),
    process("set-user-ID bit on a file", FILTER, ("r1", write_note), ("world", find_set_id)),
    process("set-user-ID bit on a new file", FILTER, ("r1", create_note), ("world", find_set_id)),
    process("hint on a common file", FILTER, ("r1", set_hint), ("r2", get_hint)),
    process("lock on a common file", FILTER, ("r1", lock_whole), ("r2", meet_lock)),
    process("lock on a part of a common file", FILTER, ("r1", lock_bytes), ("r2", meet_byte_lock)),
    process("lease on a common file", FILTER, ("r2", lease), ("r1", hold_open), ("r2", lease)),
    process("watch on a common file", FILTER, ("r2", watch), ("r1", hold_open), ("r2", see_event)),
)
