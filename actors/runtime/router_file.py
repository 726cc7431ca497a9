"""The file from which the router's process learns whom it knows and where it listens for each."""

from pathlib import Path
from typing import Any

import msgspec

from actors.runtime.credentials import AccessError, Credentials, unnamed


def write(path: Path, issued: Credentials) -> None:
    """Write `issued` as JSON; the passwords themselves stay in the files that it names."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(issued, enc_hook=str)))


def read(path: Path) -> Credentials:
    """What `write` wrote; AccessError where that cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Credentials, dec_hook=_path)
    except (OSError, msgspec.DecodeError) as error:
        raise AccessError(f"{path}: no router file: {error}") from None


def remove(path: Path) -> None:
    """Remove the file and everything that it names: sockets, their locks, and the passwords of the run."""
    if not path.exists():
        return
    issued = read(path)
    sockets = set(issued.sockets.values())
    hidden = {unnamed(socket) for socket in sockets}
    locks = {socket.with_name(f"{socket.name}.lock") for socket in hidden}
    for leftover in (*sorted(sockets | hidden | locks), *issued.files.values(), issued.dictionary, path):
        leftover.unlink(missing_ok=True)


def _path(kind: type[Any], value: object) -> Any:
    return kind(value)
