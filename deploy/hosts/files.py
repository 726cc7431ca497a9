"""Files of a run on its hosts: copied while the run goes on, or left there and fetched later."""

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final

import msgspec
from distributed import Client

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostPart, HostsFile, RemoteFile, Sha256, Size
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError, printable
from deploy.hosts.address import PAGE, host_and_port
from deploy.hosts.connection import PATIENCE_S, ClusterError, answer, connect, machines

PREFIX: Final = "acrc-"
"""Prefix of a run's folder in the temporary folder of a host."""
RUN: Final = "run"
"""In that folder: the robots' folders."""
TASK: Final = "task.json"
"""In that folder: the host's part of the run, with the run's id."""
PART: Final = 1 << 16
"""Bytes of a file that travel together at most."""
PIECE: Final = 4 << 20
"""Bytes of a file that are read at once."""
MOST: Final = 10_000
"""Files of one host."""
_ODD: Final = frozenset({"", ".", ".."})
_NAME: Final = re.compile(r"(?P<robot>[A-Za-z0-9_-]{1,32})/(?P=robot)(\.[0-9]{1,9})?\.(mcap|log)")


class FilePart(msgspec.Struct, frozen=True):
    """The next bytes of a file, in either direction."""

    path: Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
    """With `/`; from a host below the run's folder, to a host below its own."""
    data: Annotated[bytes, msgspec.Meta(max_length=PART)]


class _RunId(msgspec.Struct, frozen=True):
    """The part of TASK that is needed here."""

    run: str


class Listed(msgspec.Struct, frozen=True):
    """One file."""

    name: str
    """Below the run's folder: a recording, or the log beside it."""
    bytes: Size
    sha256: Sha256


def listed(folder: str, run: str) -> bytes:
    """The files there, as JSON; none where the folder is gone. Raises AcrcError."""
    found: list[Listed] = []
    if (place := _place(folder, run)) is None:
        return msgspec.json.encode(found)
    for path in sorted(place.glob("*/*")):
        name = path.relative_to(place).as_posix()
        if is_name(name) and path.is_file() and not path.is_symlink():
            found.append(Listed(name, *regular_file.size_and_sha256(path)))
    if len(found) > MOST:
        raise AcrcError(f"{place} has {len(found)} recordings and logs; at most {MOST} are fetched")
    return msgspec.json.encode(found)


def piece(folder: str, run: str, name: str, begin: int) -> bytes:
    """Return the bytes of one of them from `begin` on, PIECE bytes at most. Raises AcrcError."""
    place = _place(folder, run)
    if place is None or not is_name(name):
        raise AcrcError(f"{name[:200]!r} is no recording")
    with regular_file.open_regular(place / name, links=False) as file:
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
    if path.parent.resolve() != ours.resolve() or not path.name.startswith(PREFIX):
        raise AcrcError(
            f"{path} is no folder of a run; it would be {ours / PREFIX}…, by this worker's TMPDIR"
        )
    if path.is_symlink() or not path.is_dir():
        return None
    if typed_json.read(path / TASK, _RunId, "task of a run's host").run != run:
        raise AcrcError(f"{path} is another run's")
    return path / RUN


@dataclass(frozen=True)
class Fetched:
    """Fetched files."""

    files: int
    bytes: int


def fetch(out: Path, address: str, say: Callable[[str], None]) -> Fetched:
    """Bring into a run's folder what its hosts still have of it, and then remove it there.

    `address`: of the scheduler, as Dask spells it; empty: the one that the run had. What has come whole stays
    here, whatever happens then. Raises AcrcError.
    """
    told = seal.read_hosts(out)
    if told is None:
        raise AcrcError(f"{out}: no run over several computers: there is no {seal.HOSTS_FILE} in it")
    client = connect(address or told.cluster)
    try:
        ways = {host_and_port(worker)[0]: worker for worker in machines(client)}
        found = [_Host(client, name, part, told, ways, address) for name, part in told.hosts.items()]
        files = size = 0
        for host in found:
            came = [one.bytes for one in host.listed() if host.bring(out, one)]
            host.require_complete(seal.remote_recordings(out))
            host.remove()
            files, size = files + len(came), size + sum(came)
            say(f"host {host.name}: {len(came)} {'file' if len(came) == 1 else 'files'}, {sum(came)} B")
        return Fetched(files, size)
    finally:
        with suppress(Exception):  # whatever a lost cluster is to the library
            client.close(timeout=PATIENCE_S)


class _Host:
    """One of a run's hosts, by a worker of its cluster."""

    def __init__(
        self, client: Client, name: str, part: HostPart, told: HostsFile, ways: dict[str, str], address: str
    ) -> None:
        self.name = name
        self._client, self._part, self._told = client, part, told
        self._address = address or told.cluster
        self._on = f"--on {self._address}"
        if part.address not in ways:
            raise ClusterError(
                f"{self._on}: has no worker at {part.address}, where host {name} has recordings in "
                f"{part.folder}; must have one, such as by ./acrc cluster join there ({PAGE})"
            )
        self._worker = ways[part.address]

    def listed(self) -> Iterable[Listed]:
        """Return the files of its own robots. Raises ClusterError."""
        answer = self._ask(listed)
        try:
            files = msgspec.json.decode(answer, type=list[Listed])
        except (msgspec.MsgspecError, TypeError) as error:
            raise self._lie(f"no list of files: {error}") from None
        for one in files:
            robot = one.name.partition("/")[0]
            if not is_name(one.name) or robot not in self._part.robots or len(files) > MOST:
                raise self._lie(f"a file {one.name[:100]!r}, which is none of its own")
            known = self._told.left.get(one.name)
            if known is not None and (known.bytes, known.sha256) != (one.bytes, one.sha256):
                raise self._lie(f"another {one.name} than it had at the run's end")
        return files

    def bring(self, out: Path, one: Listed) -> bool:
        """Have the file here; False if it was. Raises ClusterError, and AcrcError where it cannot be kept."""
        path = out / one.name
        try:
            if (
                path.is_file()
                and not path.is_symlink()
                and regular_file.size_and_sha256(path)[1] == one.sha256
            ):
                return False
            path.parent.mkdir(exist_ok=True)
            regular_file.check_no_link(path.parent)
            with regular_file.atomic_replacement(path) as part, part.open("wb") as file:
                done, digest = 0, hashlib.sha256()
                while done < one.bytes:
                    data = self._ask(piece, one.name, done)
                    if not isinstance(data, bytes) or not 0 < len(data) <= min(PIECE, one.bytes - done):
                        raise self._lie(f"another piece of {one.name} than it was asked for")
                    file.write(data)
                    digest.update(data)
                    done += len(data)
                if digest.hexdigest() != one.sha256:
                    raise self._lie(f"{one.name} with another SHA-256 than it had said")
        except OSError as error:
            raise AcrcError(
                f"{path}: cannot be written: {error.strerror}; it stays on host {self.name}"
            ) from None
        return True

    def require_complete(self, left: Mapping[str, RemoteFile]) -> None:
        """Raise ClusterError if a recording of this host is not here, once all that it has is."""
        gone = [name for name, one in left.items() if one.host == self.name]
        if gone:
            more = f", and {len(gone) - 1} more" if len(gone) > 1 else ""
            raise ClusterError(f"host {self.name} no longer has {gone[0]}{more}; it is not here either")

    def remove(self) -> None:
        """Have it removed there. Raises ClusterError."""
        self._ask(remove)

    def _ask(self, function: Callable[..., Any], *words: str | int) -> Any:
        """Return the function's result there. Raises ClusterError."""
        future = self._client.submit(
            function, self._part.folder, self._told.run, *words,
            workers=[self._worker], allow_other_workers=False, pure=False,
        )  # fmt: skip
        try:
            return answer(self._client, self._address, self._worker, future)
        except ClusterError:
            raise
        except Exception as error:  # whatever it raised there, or a lost worker is to the library
            told = str(error).splitlines()
            reason = printable(told[0][:300] if told else repr(error))
            raise ClusterError(f"{self._on}: host {self.name}: {reason} ({PAGE})") from None

    def _lie(self, what: str) -> ClusterError:
        return ClusterError(printable(f"{self._on}: host {self.name} has sent {what}"))


class FilePartError(AcrcError):
    """A part of a file that is refused."""


class IncomingFiles:
    """Writes received parts of files below `folder`, in allowed folders only, up to `most` bytes."""

    def __init__(self, folder: Path, allows: Callable[[str], bool], most: int, limit: str) -> None:
        """`folder`: without links. `allows`: takes the name of a folder in it. `limit`: names `most`."""
        self._folder = folder
        self._allows = allows
        self._most = self._left = most
        self._limit = limit

    def take(self, part: FilePart) -> None:
        """Append it to its file. Raises FilePartError, and OSError."""
        words = part.path.split("/")
        if len(words) < 2 or not self._allows(words[0]) or _ODD & {*words} or "\0" in part.path:
            raise FilePartError(f"a file {part.path[:200]!r}, which is none of its own")
        self._left -= len(part.data)
        if self._left < 0:
            raise FilePartError(f"more than {self._most} B of files, {self._limit}")
        path = self._folder.joinpath(*words)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._check(path)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(path, flags, 0o644), "ab") as file:
            file.write(part.data)

    def _check(self, path: Path) -> None:
        """Raise FilePartError where a link leads elsewhere."""
        if path.parent.resolve() != path.parent or not path.parent.is_relative_to(self._folder):
            raise FilePartError(f"a file {path}, to which a link leads")


class GrowingFile:
    """One file that is read while it grows."""

    def __init__(self, path: Path, name: str) -> None:
        self._path, self._name = path, name
        self._file: BinaryIO | None = None
        self._begun = False

    def part(self) -> FilePart | None:
        """Return the next bytes; None if there are none. The first part of an empty file is empty."""
        if self._file is None:
            try:
                self._file = regular_file.open_regular(self._path, links=False)
            except OSError:
                return None
        data = self._file.read(PART)
        if not data and self._begun:
            return None
        self._begun = True
        return FilePart(self._name, data)

    def close(self) -> None:
        """Close it."""
        if self._file is not None:
            self._file.close()


def read_files(files: Iterable[tuple[Path, str]]) -> Iterator[FilePart]:
    """Return the parts of files, given with their names, in order; links are left out."""
    for path, name in files:
        file = GrowingFile(path, name)
        yield from iter(file.part, None)
        file.close()


def files_below(folder: Path, base: Path, prefix: str = "") -> Iterator[tuple[Path, str]]:
    """Return all regular files below a folder, and their names as of `base`."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.is_symlink():
            yield path, prefix + path.relative_to(base).as_posix()
