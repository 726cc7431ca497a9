"""The file from which the router's process learns whom it knows and where it listens for each."""

from pathlib import Path
from typing import Any, Final

import msgspec

from actors.runtime import typed_json
from actors.runtime.access.credentials import PRIVATE_KEY_FILE, Credentials, unnamed
from actors.runtime.errors import AcrcError

NAME: Final = "router.json"
"""In the folder of the router's process."""


def write(path: Path, issued: Credentials) -> None:
    """Write `issued` as JSON; the passwords themselves stay in the files that it names."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(issued, enc_hook=str)))


def read(path: Path) -> Credentials:
    """What `write` wrote; AcrcError where that cannot be read."""
    return typed_json.read(path, Credentials, "router file", hook=_path)


def remove(path: Path) -> None:
    """Remove the file and everything that it names: sockets, their locks, and the passwords of the run.

    AcrcError, once the rest is gone, where something else lies in the place of one.
    """
    if not path.exists():
        return
    issued = read(path)
    sockets = set(issued.sockets.values())
    hidden = {unnamed(socket) for socket in sockets}
    locks = {socket.with_name(f"{socket.name}.lock") for socket in hidden}
    foreign = []
    keys = () if issued.gate is None else (issued.gate.keys / PRIVATE_KEY_FILE,)
    secrets = (*issued.files.values(), issued.dictionary, *keys)
    for leftover in (*sorted(sockets | hidden | locks), *secrets, path):
        try:
            leftover.unlink(missing_ok=True)
        except OSError as error:  # a folder lies there, which is somebody else's
            foreign.append(f"{leftover} ({error.strerror})")
    if foreign:
        raise AcrcError(f"what the run has put there could not be removed: {', '.join(foreign)}")


def _path(kind: type[Any], value: object) -> Any:
    return kind(value)
