"""What has stayed on a worker's computer of a run that is over: a worker lists it, reads it, removes it.

The folder is one that `host_task.serve` has made for that run, or nothing is done: a list of hosts that
somebody else has written names no other.
"""

import re
import shutil
import tempfile
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from deploy.hosts.host_program import ERRAND, RUN, HostErrand
from deploy.hosts.host_task import FOLDER
from observation.results.hosts_file import Size, Sum

PIECE: Final = 4 << 20
"""Bytes of a file that are read at once."""
MOST: Final = 10_000
"""Files of one host."""
_NAME: Final = re.compile(r"(?P<robot>[A-Za-z0-9_-]{1,32})/(?P=robot)(\.[0-9]{1,9})?\.(mcap|log)")


class Listed(msgspec.Struct, frozen=True):
    """One file."""

    name: str
    """Below the run's folder: a recording, or the log beside it."""
    bytes: Size
    sha256: Sum


def listed(folder: str, run: str) -> bytes:
    """The files there, as JSON; none where the folder is gone. Raises AcrcError."""
    found: list[Listed] = []
    if (place := _place(folder, run)) is None:
        return msgspec.json.encode(found)
    for path in sorted(place.glob("*/*")):
        name = path.relative_to(place).as_posix()
        if is_name(name) and path.is_file() and not path.is_symlink():
            found.append(Listed(name, *regular_file.summed(path)))
    if len(found) > MOST:
        raise AcrcError(f"{place} has {len(found)} recordings and logs; at most {MOST} are fetched")
    return msgspec.json.encode(found)


def piece(folder: str, run: str, name: str, begin: int) -> bytes:
    """What stands in one of them from byte `begin` on, PIECE bytes at most. Raises AcrcError."""
    place = _place(folder, run)
    if place is None or not is_name(name):
        raise AcrcError(f"{name[:200]!r} is no recording")
    with regular_file.opened(place / name, links=False) as file:
        file.seek(begin)
        return file.read(PIECE)


def remove(folder: str, run: str) -> None:
    """Remove all that has stayed there, if anything has. Raises AcrcError."""
    if place := _place(folder, run):
        shutil.rmtree(place.parent)


def is_name(name: str) -> bool:
    """True for the name of a recording or a log below a run's folder."""
    return _NAME.fullmatch(name) is not None


def _place(folder: str, run: str) -> Path | None:
    """The part of the run in the folder; None if it is gone. Raises AcrcError where it is not that run's."""
    path, ours = Path(folder), Path(tempfile.gettempdir())
    if path.parent.resolve() != ours.resolve() or not path.name.startswith(FOLDER):
        raise AcrcError(
            f"{path} is no folder of a run; it would be {ours / FOLDER}…, by this worker's TMPDIR"
        )
    if path.is_symlink() or not path.is_dir():
        return None
    if typed_json.read(path / ERRAND, HostErrand, "errand of a run's host").run != run:
        raise AcrcError(f"{path} is another run's")
    return path / RUN
