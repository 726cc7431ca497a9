"""Brings here what has stayed on the hosts of a run that is over."""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from distributed import Client

from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable
from deploy.clusters.address import PAGE, ClusterError, host_and_port
from deploy.clusters.connection import PATIENCE_S, answer, connect, machines
from deploy.hosts import left_files
from deploy.hosts.left_files import MOST, PIECE, Listed
from observation.results import hosts_file
from observation.results.hosts_file import HostPart, HostsFile, LeftFile


@dataclass(frozen=True)
class Fetched:
    """What has come."""

    files: int
    bytes: int


def fetch(out: Path, address: str, say: Callable[[str], None]) -> Fetched:
    """Bring into a run's folder what its hosts still have of it, and then remove it there.

    `address`: of the scheduler, as Dask spells it; empty: the one that the run had. What has come whole stays
    here, whatever happens then. Raises AcrcError.
    """
    told = hosts_file.read(out)
    if told is None:
        raise AcrcError(f"{out}: no run over several computers: there is no {hosts_file.NAME} in it")
    client = connect(address or told.cluster)
    try:
        ways = {host_and_port(worker)[0]: worker for worker in machines(client)}
        found = [_Host(client, name, part, told, ways, address) for name, part in told.hosts.items()]
        files = size = 0
        for host in found:
            came = [one.bytes for one in host.listed() if host.bring(out, one)]
            host.lacks_nothing(hosts_file.elsewhere(out))
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
        """What it has of its own robots. Raises ClusterError."""
        answer = self._ask(left_files.listed)
        try:
            files = msgspec.json.decode(answer, type=list[Listed])
        except (msgspec.MsgspecError, TypeError) as error:
            raise self._lie(f"no list of files: {error}") from None
        for one in files:
            robot = one.name.partition("/")[0]
            if not left_files.is_name(one.name) or robot not in self._part.robots or len(files) > MOST:
                raise self._lie(f"a file {one.name[:100]!r}, which is none of its own")
            known = self._told.left.get(one.name)
            if known is not None and (known.bytes, known.sha256) != (one.bytes, one.sha256):
                raise self._lie(f"another {one.name} than it had at the run's end")
        return files

    def bring(self, out: Path, one: Listed) -> bool:
        """Have the file here; False if it was. Raises ClusterError, and AcrcError where it cannot be kept."""
        path = out / one.name
        try:
            if path.is_file() and not path.is_symlink() and regular_file.summed(path)[1] == one.sha256:
                return False
            path.parent.mkdir(exist_ok=True)
            regular_file.no_link(path.parent)
            with regular_file.replaced(path) as part, part.open("wb") as file:
                done, digest = 0, hashlib.sha256()
                while done < one.bytes:
                    data = self._ask(left_files.piece, one.name, done)
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

    def lacks_nothing(self, left: Mapping[str, LeftFile]) -> None:
        """Raise ClusterError if a recording of this host is not here, once all that it has is."""
        gone = [name for name, one in left.items() if one.host == self.name]
        if gone:
            more = f", and {len(gone) - 1} more" if len(gone) > 1 else ""
            raise ClusterError(f"host {self.name} no longer has {gone[0]}{more}; it is not here either")

    def remove(self) -> None:
        """Have it removed there. Raises ClusterError."""
        self._ask(left_files.remove)

    def _ask(self, function: Callable[..., Any], *words: str | int) -> Any:
        """What the function says there. Raises ClusterError."""
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
