"""The credentials of one run: a random password per actor, each in a file that only its owner can read.

They are no part of a run's result: neither recorded nor in any digest, so they may differ from run to run.
"""

import os
import re
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

OTHERS: Final = ("radio", "observer", "operator")
"""The clients that are no robots."""

PRIVATE_KEY_FILE: Final = "key.pem"
"""A machine's own private key, in the folder with its certificate."""
_ID: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
_SOCKET_PATH_LIMIT: Final = 107
"""Bytes of a Unix socket's path on Linux: sun_path less the closing zero (unix(7))."""
_PASSWORD_BYTES: Final = 24
_LARGEST: Final = 1000
"""Bytes of a file with one name and one password."""


@dataclass(frozen=True)
class Gate:
    """Where a router lets hosts in: other computers, each with a router of its own for its robots."""

    endpoint: str
    """`tls/HOST:PORT`."""
    keys: Path
    """Folder with the router's own keys, see `tls.load_keys`."""
    robots: Mapping[str, tuple[str, ...]]
    """Each host's robots, by the common name of its certificate."""


@dataclass(frozen=True)
class Credentials:
    """The files with the credentials of one run, and the sockets at which the router listens."""

    robots: tuple[str, ...]
    others: tuple[str, ...]
    dictionary: Path
    """All names and passwords, for the router only."""
    files: Mapping[str, Path]
    """Each actor's `user:password`."""
    sockets: Mapping[str, Path]
    """The router's socket for each actor; the actors that are no robots share one."""
    gate: Gate | None = None
    """None: all actors are on this computer."""

    def endpoint(self, actor: str) -> str:
        """Return the address that `actor` connects to."""
        return unix_endpoint(self.sockets[actor])


def unnamed(socket: Path) -> Path:
    """Return where the router listens until `reveal` gives the socket its name."""
    return socket.with_suffix(".new")


def reveal(issued: Credentials) -> None:
    """Give the router's sockets their names, once its subscriptions are declared.

    The Ready of an actor that connects before would be lost.
    """
    for socket in sorted(set(issued.sockets.values())):
        unnamed(socket).rename(socket)


def unix_endpoint(socket: Path) -> str:
    """Return a Unix socket as Zenoh spells it."""
    return f"unixsock-stream/{socket}"


def issue(robot_folders: Mapping[str, Path], infra: Path, others: Sequence[str] = OTHERS) -> Credentials:
    """Draw new passwords and write them: one file per robot in its folder, all others in the folder `infra`.

    The folders must exist. Files are readable by their owner only and hold `user:password` on one line.
    Raises AcrcError for a name that cannot be part of a key or is used twice, and for a path that is too
    long for a socket.
    """
    _check_names([*robot_folders, *others])
    files = {robot: folder.resolve() / "credentials" for robot, folder in robot_folders.items()}
    files |= {other: infra.resolve() / f"{other}.credentials" for other in others}
    sockets = {actor: file.with_name("router.sock") for actor, file in files.items()}
    for socket in sockets.values():
        _check_length(socket)
    lines = {actor: f"{actor}:{secrets.token_urlsafe(_PASSWORD_BYTES)}" for actor in files}
    for actor, file in files.items():
        _write_secret(file, lines[actor])
    dictionary = infra.resolve() / "users"
    _write_secret(dictionary, "\n".join(lines.values()))
    return Credentials(tuple(robot_folders), tuple(others), dictionary, files, sockets)


def read(file: Path) -> tuple[str, str]:
    """The user and the password that `file` holds; AcrcError where it cannot be read or holds neither."""
    try:
        with regular_file.opened(file) as secret:
            user, _, password = secret.read(_LARGEST).decode("utf-8").strip().partition(":")
    except OSError as error:
        raise AcrcError(
            f"the credentials file {file} cannot be read ({error.strerror}); "
            "the start of the run should have written it"
        ) from error
    except ValueError:
        user = password = ""  # no UTF-8
    if not (user and password):
        raise AcrcError(f"the credentials file {file} should hold one line user:password, but does not")
    return user, password


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if not _ID.fullmatch(name):
            raise AcrcError(
                f"the actor id {name!r} cannot be part of a key; "
                "letters, digits, '-' and '_' would have been right, a letter or a digit first"
            )
        if names.count(name) > 1:
            raise AcrcError(f"the actor id {name!r} is used twice; every actor needs its own")


def _check_length(socket: Path) -> None:
    length = len(os.fsencode(socket))
    if length > _SOCKET_PATH_LIMIT:
        raise AcrcError(
            f"the path of the router's socket {socket} has {length} bytes, but Linux allows "
            f"{_SOCKET_PATH_LIMIT}; a shorter output folder would have been right"
        )


def _write_secret(file: Path, text: str) -> None:
    """Write a new file for the owner's eyes; never through a link that somebody laid there."""
    file.unlink(missing_ok=True)
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as out:
        out.write(text + "\n")


ROUTER_FILE: Final = "router.json"
"""File in the folder of the router's process: whom it knows, and where it listens for each."""


def write_router_file(path: Path, issued: Credentials) -> None:
    """Write `issued` as JSON; the passwords themselves stay in the files that it names."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(issued, enc_hook=str)))


def read_router_file(path: Path) -> Credentials:
    """What `write_router_file` wrote; AcrcError where that cannot be read."""
    return typed_json.read(path, Credentials, "router file", hook=lambda kind, value: kind(value))


def remove_router_file(path: Path) -> None:
    """Remove the file and everything that it names: sockets, their locks, and the passwords of the run.

    AcrcError, once the rest is gone, where something else lies in the place of one.
    """
    if not path.exists():
        return
    issued = read_router_file(path)
    sockets = sorted(set(issued.sockets.values()))
    hidden = [unnamed(socket) for socket in sockets]
    locks = [socket.with_name(f"{socket.name}.lock") for socket in hidden]
    keys = [] if issued.gate is None else [issued.gate.keys / PRIVATE_KEY_FILE]
    foreign = []
    for leftover in (*sockets, *hidden, *locks, *issued.files.values(), issued.dictionary, *keys, path):
        try:
            leftover.unlink(missing_ok=True)
        except OSError as error:  # a folder lies there, which is somebody else's
            foreign.append(f"{leftover} ({error.strerror})")
    if foreign:
        raise AcrcError(f"what the run has put there could not be removed: {', '.join(foreign)}")
