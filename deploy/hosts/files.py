"""Files of a run on its hosts: copied during the run, or fetched later."""

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final

import msgspec
from distributed import Client

from acrc_testbed.results import seal
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError, printable
from deploy.hosts.address import PAGE, host_and_port
from deploy.hosts.connection import ClusterError, await_result, connected, error_line, host_workers

PREFIX: Final = "acrc-"
"""Prefix of a run's folder in the temporary folder of a host."""
RUN: Final = "run"
"""Subfolder with the robots' folders."""
TASK: Final = "task.json"
"""File in the run's folder with the host's task and the run's id."""
MAX_PART_BYTES: Final = 1 << 16
"""Maximum size of a part of a file in a message, bytes."""
MAX_PIECE_BYTES: Final = 4 << 20
"""Maximum size of a part of a fetched file, bytes."""
MAX_FILES: Final = 10_000
"""Maximum number of files of a host."""
_INVALID_NAMES: Final = frozenset({"", ".", ".."})
_NAME: Final = re.compile(r"(?P<robot>[A-Za-z0-9_-]{1,32})/(?P=robot)(\.[0-9]{1,9})?\.(mcap|log)")


class FilePart(msgspec.Struct, frozen=True):
    """The next bytes of a file, in either direction."""

    path: Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
    """Relative path with `/`: below the run's folder here for parts from a host, else below the host's."""
    data: Annotated[bytes, msgspec.Meta(max_length=MAX_PART_BYTES)]


class _RunId(msgspec.Struct, frozen=True):
    """Required part of TASK."""

    run: str


class HostFile(msgspec.Struct, frozen=True):
    """A file on a host."""

    name: str
    """Path of a recording or log, relative to the run's folder."""
    bytes: seal.Size
    sha256: seal.Sha256


def list_files(folder: str, run: str) -> bytes:
    """Return the list of HostFiles in a run's folder, as JSON; empty without folder. Raises AcrcError."""
    found: list[HostFile] = []
    if (home := _robots_folder(folder, run)) is None:
        return msgspec.json.encode(found)
    for path in sorted(home.glob("*/*")):
        name = path.relative_to(home).as_posix()
        if is_recording_name(name) and path.is_file() and not path.is_symlink():
            found.append(HostFile(name, *regular_file.size_and_sha256(path)))
    if len(found) > MAX_FILES:
        raise AcrcError(f"{home} has {len(found)} recordings and logs; at most {MAX_FILES} are fetched")
    return msgspec.json.encode(found)


def read_piece(folder: str, run: str, name: str, offset: int) -> bytes:
    """Return up to MAX_PIECE_BYTES of a file from `offset` on. Raises AcrcError."""
    home = _robots_folder(folder, run)
    if home is None or not is_recording_name(name):
        raise AcrcError(f"{name[:200]!r} is not a recording")
    with regular_file.open_regular(home / name, links=False) as file:
        file.seek(offset)
        return file.read(MAX_PIECE_BYTES)


def remove_folder(folder: str, run: str) -> None:
    """Remove the run's folder if it exists. Raises AcrcError."""
    if home := _robots_folder(folder, run):
        shutil.rmtree(home.parent)


def is_recording_name(name: str) -> bool:
    """Return whether a name is that of a recording or log below a run's folder."""
    return _NAME.fullmatch(name) is not None


def _robots_folder(folder: str, run: str) -> Path | None:
    """Return the folder with the robots' folders; None if missing. Raises AcrcError for another run's."""
    path, temporary = Path(folder), Path(tempfile.gettempdir())
    if path.parent.resolve() != temporary.resolve() or not path.name.startswith(PREFIX):
        raise AcrcError(
            f"{path} is not a run's folder, which this worker has at {temporary / PREFIX}… (TMPDIR)"
        )
    if path.is_symlink() or not path.is_dir():
        return None
    if typed_json.read(path / TASK, _RunId, "task of a run's host").run != run:
        raise AcrcError(f"{path} belongs to another run")
    return path / RUN


@dataclass(frozen=True)
class FetchedFiles:
    """Number and size of fetched files."""

    files: int
    bytes: int


def fetch(out: Path, address: str, say: Callable[[str], None]) -> FetchedFiles:
    """Fetch the files that a run has left on its hosts, then remove them there.

    `address`: of the scheduler, in Dask's form; empty: that of the run. After an error, complete files stay.
    Raises AcrcError.
    """
    hosts_file = seal.read_hosts(out)
    if hosts_file is None:
        raise AcrcError(f"{out}: not a run on several computers: no {seal.HOSTS_FILE}")
    address = address or hosts_file.cluster
    with connected(address) as client:
        workers = {host_and_port(worker)[0]: worker for worker in host_workers(client)}
        found = [_Host(client, name, hosts_file, workers, address) for name in hosts_file.hosts]
        files = size = 0
        for host in found:
            sizes = [one.bytes for one in host.list_files() if host.fetch_file(out, one)]
            left = seal.remote_recordings(out).items()
            if missing := [name for name, one in left if one.host == host.name]:
                more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
                raise ClusterError(
                    f"host {host.name} no longer has {missing[0]}{more}, and there is no copy here"
                )
            host.remove_folder()
            files, size = files + len(sizes), size + sum(sizes)
            say(f"host {host.name}: {len(sizes)} {'file' if len(sizes) == 1 else 'files'}, {sum(sizes)} B")
        return FetchedFiles(files, size)


class _Host:
    """A host of a run, accessed through a worker of its cluster."""

    def __init__(
        self,
        client: Client,
        name: str,
        hosts_file: seal.HostsFile,
        workers: dict[str, str],
        address: str,
    ) -> None:
        self.name = name
        self._client, self._hosts_file, self._address = client, hosts_file, address
        self._part = part = hosts_file.hosts[name]
        self._on = f"--on {self._address}"
        if part.address not in workers:
            raise ClusterError(
                f"{self._on}: has no worker at {part.address}, where host {name} has recordings in "
                f"{part.folder}; start one there with ./acrc cluster join ({PAGE})"
            )
        self._worker = workers[part.address]

    def list_files(self) -> Iterable[HostFile]:
        """Return the host's files of the run, checked. Raises ClusterError."""
        answer = self._call(list_files)
        try:
            files = msgspec.json.decode(answer, type=list[HostFile])
        except (msgspec.MsgspecError, TypeError) as error:
            raise self._protocol_error(f"an invalid list of files: {error}") from None
        for one in files:
            robot = one.name.partition("/")[0]
            if not is_recording_name(one.name) or robot not in self._part.robots or len(files) > MAX_FILES:
                raise self._protocol_error(f"a file {one.name[:100]!r}, which is not its own")
            known = self._hosts_file.left.get(one.name)
            if known is not None and (known.bytes, known.sha256) != (one.bytes, one.sha256):
                raise self._protocol_error(f"a different {one.name} than at the run's end")
        return files

    def fetch_file(self, out: Path, one: HostFile) -> bool:
        """Fetch a file; return False if an equal one is here already. Raises ClusterError and AcrcError."""
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
                    data = self._call(read_piece, one.name, done)
                    if not isinstance(data, bytes) or not 0 < len(data) <= min(
                        MAX_PIECE_BYTES, one.bytes - done
                    ):
                        raise self._protocol_error(f"a wrong part of {one.name}")
                    file.write(data)
                    digest.update(data)
                    done += len(data)
                if digest.hexdigest() != one.sha256:
                    raise self._protocol_error(f"{one.name} with a wrong SHA-256")
        except OSError as error:
            raise AcrcError(
                f"{path}: cannot be written: {error.strerror}; it stays on host {self.name}"
            ) from None
        return True

    def remove_folder(self) -> None:
        """Remove the run's folder on the host. Raises ClusterError."""
        self._call(remove_folder)

    def _call(self, function: Callable[..., Any], *words: str | int) -> Any:
        """Call a function on the host. Raises ClusterError."""
        future = self._client.submit(
            function, self._part.folder, self._hosts_file.run, *words,
            workers=[self._worker], allow_other_workers=False, pure=False,
        )  # fmt: skip
        try:
            return await_result(self._client, self._address, self._worker, future)
        except ClusterError:
            raise
        except Exception as error:  # raised there, or by the library about a lost worker
            raise ClusterError(f"{self._on}: host {self.name}: {error_line(error)} ({PAGE})") from None

    def _protocol_error(self, what: str) -> ClusterError:
        return ClusterError(printable(f"{self._on}: host {self.name} has sent {what}"))


class FilePartError(AcrcError):
    """A rejected part of a file."""


class IncomingFiles:
    """Writer of received files to allowed subfolders of `folder`, up to `max_bytes` in total."""

    def __init__(self, folder: Path, is_allowed: Callable[[str], bool], max_bytes: int, limit: str) -> None:
        """`folder`: without links. `is_allowed`: of a subfolder's name. `limit`: describes `max_bytes`."""
        self._folder = folder
        self._is_allowed = is_allowed
        self._max_bytes = self._remaining_bytes = max_bytes
        self._limit = limit

    def append(self, part: FilePart) -> None:
        """Append a part to its file. Raises FilePartError and OSError."""
        words = part.path.split("/")
        if len(words) < 2 or not self._is_allowed(words[0]) or _INVALID_NAMES & {*words} or "\0" in part.path:
            raise FilePartError(f"a file {part.path[:200]!r}, which is not its own")
        self._remaining_bytes -= len(part.data)
        if self._remaining_bytes < 0:
            raise FilePartError(f"more than {self._max_bytes} B of files, {self._limit}")
        path = self._folder.joinpath(*words)
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.parent.resolve() != path.parent or not path.parent.is_relative_to(self._folder):
            raise FilePartError(f"a file {path}, which is behind a link")
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(path, flags, 0o644), "ab") as file:
            file.write(part.data)


class GrowingFile:
    """A file that is read while it grows."""

    def __init__(self, path: Path, name: str) -> None:
        self._path, self._name = path, name
        self._file: BinaryIO | None = None
        self._begun = False

    def part(self) -> FilePart | None:
        """Return the next part; None if there is none. The first part of an empty file is empty."""
        if self._file is None:
            try:
                self._file = regular_file.open_regular(self._path, links=False)
            except OSError:
                return None
        data = self._file.read(MAX_PART_BYTES)
        if not data and self._begun:
            return None
        self._begun = True
        return FilePart(self._name, data)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def read_files(files: Iterable[tuple[Path, str]]) -> Iterator[FilePart]:
    """Yield the parts of files, given as path and name, in order; skip symbolic links."""
    for path, name in files:
        file = GrowingFile(path, name)
        yield from iter(file.part, None)
        file.close()


def files_below(folder: Path, base: Path, prefix: str = "") -> Iterator[tuple[Path, str]]:
    """Yield all regular files below a folder, with their paths relative to `base`."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.is_symlink():
            yield path, prefix + path.relative_to(base).as_posix()
