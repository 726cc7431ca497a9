"""Credentials of one run: a random password per actor, in a file that only its owner can read.

They are not part of a run's result: not recorded, not in a digest, different in each run.
"""

import os
import re
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

NON_ROBOTS: Final = ("radio", "observer", "operator")
"""Clients that are not robots."""

PRIVATE_KEY_FILE: Final = "key.pem"
"""A machine's private key, in the folder with its certificate."""
PACKET_KEY_FILE: Final = "packets.key"
"""The key of all packets of a fleet, in the folders of its robots."""
_PACKET_KEY: Final = re.compile(rb"[0-9a-fA-F]{32}\n?")
_ID: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
_SOCKET_PATH_LIMIT: Final = 107
"""Most bytes of a Unix socket's path on Linux: sun_path without the final zero (unix(7))."""
_PASSWORD_BYTES: Final = 24
_MAX_BYTES: Final = 1000
"""Most bytes of a file with one name and one password."""


class HostGateway(msgspec.Struct, frozen=True):
    """A router's endpoint for hosts: computers with their own router for their robots."""

    endpoint: str
    """`tls/HOST:PORT`."""
    keys: Path
    """Folder with the router's keys, see `tls.load_keys`."""
    robots: Mapping[str, tuple[str, ...]]
    """Each host's robots, by the common name of its certificate."""


class Credentials(msgspec.Struct, frozen=True):
    """Credential files of one run, and the router's sockets."""

    robots: tuple[str, ...]
    others: tuple[str, ...]
    dictionary: Path
    """File with all names and passwords, for the router only."""
    files: Mapping[str, Path]
    """File with each actor's `user:password`."""
    sockets: Mapping[str, Path]
    """The router's socket for each actor; actors other than robots share one."""
    gate: HostGateway | None = None
    """None: all actors are on this computer."""

    def endpoint(self, actor: str) -> str:
        """Return the address that `actor` connects to."""
        return unix_endpoint(self.sockets[actor])


def hidden_path(socket: Path) -> Path:
    """Return the socket's path until `publish_sockets` renames it."""
    return socket.with_suffix(".new")


def publish_sockets(issued: Credentials) -> None:
    """Rename the router's sockets to their final names, once its subscriptions are declared.

    The Ready of an actor that connected earlier would be lost.
    """
    for socket in sorted(set(issued.sockets.values())):
        hidden_path(socket).rename(socket)


def unix_endpoint(socket: Path) -> str:
    """Return a Unix socket's endpoint in Zenoh's notation."""
    return f"unixsock-stream/{socket}"


def issue(robot_folders: Mapping[str, Path], infra: Path, others: Sequence[str] = NON_ROBOTS) -> Credentials:
    """Generate new passwords and write them: each robot's in its folder, all others in the folder `infra`.

    The folders must exist. Files are readable by their owner only and contain `user:password` on one line.
    Raises AcrcError for a name that is duplicate or cannot be part of a key, and for a path that is too long
    for a socket.
    """
    _check_names([*robot_folders, *others])
    files = {robot: folder.resolve() / "credentials" for robot, folder in robot_folders.items()}
    files |= {other: infra.resolve() / f"{other}.credentials" for other in others}
    sockets = {actor: file.with_name("router.sock") for actor, file in files.items()}
    for socket in sockets.values():
        _check_length(socket)
    lines = {actor: f"{actor}:{secrets.token_urlsafe(_PASSWORD_BYTES)}" for actor in files}
    for actor, file in files.items():
        write_secret(file, lines[actor])
    dictionary = infra.resolve() / "users"
    write_secret(dictionary, "\n".join(lines.values()))
    return Credentials(tuple(robot_folders), tuple(others), dictionary, files, sockets)


def read(file: Path) -> tuple[str, str]:
    """Return user and password from `file`. Raises AcrcError if it is unreadable or invalid."""
    try:
        with regular_file.open_regular(file) as secret:
            user, _, password = secret.read(_MAX_BYTES).decode("utf-8").strip().partition(":")
    except OSError as error:
        raise AcrcError(
            f"the credentials file {file} cannot be read: {error.strerror}; "
            "it is created at the start of the run"
        ) from error
    except ValueError:
        user = password = ""  # not UTF-8
    if not (user and password):
        raise AcrcError(f"the credentials file {file} must contain one line user:password")
    return user, password


def read_packet_key(file: Path) -> str:
    """Return the key of a fleet's packets. Raises AcrcError for an unreadable, invalid or public file."""
    try:
        with regular_file.open_regular(file) as secret:
            key, mode = secret.read(_MAX_BYTES), os.fstat(secret.fileno()).st_mode
    except OSError as error:
        raise AcrcError(
            f"{file} cannot be read ({error.strerror}); it is the key of the fleet's packets: copy it from a "
            "robot's folder of `acrc fleet keys`"
        ) from None
    if not _PACKET_KEY.fullmatch(key):
        raise AcrcError(f"{file} is damaged; must contain 32 hexadecimal digits")
    if mode & 0o077:
        raise AcrcError(f"{file} is readable by other users; run `chmod 600 {file}`")
    return key.decode().strip()


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if not _ID.fullmatch(name):
            raise AcrcError(
                f"the actor id {name!r} is invalid; use "
                "letters, digits, '-' and '_', with a letter or digit first"
            )
        if names.count(name) > 1:
            raise AcrcError(f"the actor id {name!r} is used twice; ids must be unique")


def _check_length(socket: Path) -> None:
    length = len(os.fsencode(socket))
    if length > _SOCKET_PATH_LIMIT:
        raise AcrcError(
            f"the path of the router's socket {socket} has {length} bytes; the limit is "
            f"{_SOCKET_PATH_LIMIT}: choose an output folder with a shorter path"
        )


def write_secret(file: Path, text: str) -> None:
    """Create a file that only the owner can read; never follow a link."""
    file.unlink(missing_ok=True)
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as out:
        out.write(text + "\n")


ROUTER_FILE: Final = "router.json"
"""File in the router's folder: its clients, and the socket of each."""


def write_router_file(path: Path, issued: Credentials) -> None:
    """Write `issued` as JSON; it names the password files, without the passwords."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(issued, enc_hook=str)))


def read_router_file(path: Path) -> Credentials:
    """Read the file of `write_router_file`. Raises AcrcError."""
    return typed_json.read(path, Credentials, "router file", hook=lambda kind, value: kind(value))


def remove_router_file(path: Path) -> None:
    """Remove the router file and everything it names: sockets, their locks, and the run's passwords.

    Raises AcrcError, after removing the rest, if another object has the place of one.
    """
    if not path.exists():
        return
    issued = read_router_file(path)
    sockets = sorted(set(issued.sockets.values()))
    hidden = [hidden_path(socket) for socket in sockets]
    locks = [socket.with_name(f"{socket.name}.lock") for socket in hidden]
    keys = [] if issued.gate is None else [issued.gate.keys / PRIVATE_KEY_FILE]
    foreign = []
    for leftover in (*sockets, *hidden, *locks, *issued.files.values(), issued.dictionary, *keys, path):
        try:
            leftover.unlink(missing_ok=True)
        except OSError as error:  # an unrelated folder
            foreign.append(f"{leftover} ({error.strerror})")
    if foreign:
        raise AcrcError(f"files of the run could not be removed: {', '.join(foreign)}")
