"""Seal of a results folder (SHA-256 of every file), and the list of a run's hosts (hosts.json).

SHA256SUMS has the format of `sha256sum -c`; a comment at its end holds the checksum of its own lines. It
detects accidental changes and damage, not forgery: a user with write access can seal the folder again.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from actors.installation.usage import command_line
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError, printable

HOSTS_FILE: Final = "hosts.json"
_MAX_BYTES: Final = 16 << 20
PrintableText = Annotated[str, msgspec.Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f-\x9f]*\Z")]
"""Text without control characters, safe to print."""
Id = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}\Z")]
FileName = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}/[A-Za-z0-9_.-]{1,64}\Z")]
"""Path below a run's folder."""
Size = Annotated[int, msgspec.Meta(ge=0, le=1 << 50)]
Sha256 = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]


class HostLoad(msgspec.Struct, frozen=True):
    """Load of a host, from its reports once a second."""

    worked: NonNegative = 0.0
    """Mean number of processors used by its robots' processes."""
    waited: NonNegative = 0.0
    """Mean number of processes waiting for a processor."""
    answer_s: NonNegative = 0.0
    """Mean time to answer a query, network included, s."""
    slowest_s: NonNegative = 0.0
    """Longest time to answer, s."""


class HostPart(msgspec.Struct, frozen=True):
    """A host's robots in a run."""

    address: PrintableText
    """Address of the host's worker in its cluster."""
    cores: Annotated[int, msgspec.Meta(ge=1)]
    robots: tuple[Id, ...]
    folder: PrintableText
    """Folder of their recordings on the host; removed at the end of the run if empty."""
    load: HostLoad = HostLoad()


class RemoteFile(msgspec.Struct, frozen=True):
    """A recording that was still on its host at the end of the run."""

    host: Id
    bytes: Size
    sha256: Sha256


class HostsFile(msgspec.Struct, frozen=True):
    """The hosts of a run."""

    cluster: PrintableText
    """Address of the scheduler."""
    run: PrintableText
    """Random identifier of the run on its hosts."""
    hosts: dict[Id, HostPart]
    left: dict[FileName, RemoteFile] = {}
    """By name; the file may have been fetched since."""


def write_hosts(out: Path, hosts: HostsFile) -> None:
    """Write or replace hosts.json in a run's folder."""
    regular_file.write_atomically(out / HOSTS_FILE, typed_json.dump(hosts))


def read_hosts(out: Path) -> HostsFile | None:
    """Read hosts.json of a run; None if all robots ran on one computer. Raises AcrcError."""
    path = out / HOSTS_FILE
    return typed_json.read(path, HostsFile, "list of a run's hosts", _MAX_BYTES) if path.exists() else None


def remote_recordings(out: Path) -> Mapping[str, RemoteFile]:
    """Return the recordings of a run that are still on its hosts, by name. Raises AcrcError."""
    hosts = read_hosts(out)
    remote = {} if hosts is None else hosts.left
    return {name: one for name, one in remote.items() if not (out / name).exists()}


def fetch_sentence(out: Path, left: Mapping[str, RemoteFile]) -> str:
    """Return a sentence that names recordings still on hosts and the command to fetch them."""
    hosts = sorted({one.host for one in left.values()})
    first = next(iter(left))
    others = "1 more is" if len(left) == 2 else f"{len(left) - 1} more are"
    more = f" and {others}" if len(left) > 1 else " is"
    return (
        f"{out / first}{more} still on {'host' if len(hosts) == 1 else 'hosts'} {', '.join(hosts)}; "
        f"fetch with `{command_line('cluster', 'fetch', out)}`"
    )


SUMS: Final = "SHA256SUMS"
_TEMPORARY: Final = f"{SUMS}.new"
_OWN_FOLDER: Final = "own"
_MAX_OWN_BYTES: Final = 1_000_000_000
"""Size up to which a strategy's own folder is sealed, bytes; own choice: about a second of hashing."""
_MAX_OWN_FILES: Final = 10_000
_MAX_SEAL_BYTES: Final = 64 * 1024 * 1024
"""Upper limit of SHA256SUMS, bytes."""
_SHOWN: Final = 5
"""Files named in a sentence."""
_DERIVED: Final = re.compile(r"[^/]*\.rrd|report/[^/]+\.(html|png|svg|csv)")
"""Derived files, not sealed: views, traces, a campaign's report."""
_LINE: Final = re.compile(r"(\\?)([0-9a-f]{64})  (.+)")
_LEFT_OUT: Final = "# not sealed: "
_END: Final = "# SHA-256 of the lines above: "


class SealError(AcrcError):
    """A folder that differs from its seal."""


class SealReport(NamedTuple):
    """Report on a folder whose sealed files are unchanged."""

    files: int
    left_out: tuple[str, ...]
    """Entries not sealed: links, and strategies' own folders above the size limit."""
    added: tuple[str, ...]
    """Files added since, such as pictures."""


def checksum_lines(sums: Mapping[str, str], left_out: Iterable[str] = ()) -> bytes:
    """Return the content of SHA256SUMS; `sums`: by name relative to its folder."""
    text = b"".join(
        [_checksum_line(sums[name], name) for name in sorted(sums)]
        + [os.fsencode(f"{_LEFT_OUT}{_escaped(name)}\n") for name in sorted(left_out)]
    )
    return text + f"{_END}{hashlib.sha256(text).hexdigest()}\n".encode()


def seal(folder: Path, missing: Mapping[str, str] | None = None) -> None:
    """Write SHA256SUMS for all files in the folder, atomically. May raise OSError.

    `missing`: checksums by name of files that will be added later.
    """
    sums = dict(missing or {})
    left_out: list[str] = []
    for name, is_file in _entries(folder):
        checksum = _sha256_of(folder / name) if is_file else None
        if checksum is None:
            left_out.append(name)
        else:
            sums[name] = checksum
    regular_file.write_atomically(folder / SUMS, checksum_lines(sums, left_out))


def check_seal(folder: Path) -> SealReport | None:
    """Compare a folder with its seal; None if not sealed. Raises SealError for the first difference."""
    path = folder / SUMS
    if not os.path.lexists(path):
        return None
    sums, left_out = _read_seal(path)
    sums = {name: expected for name, expected in sums.items() if not _DERIVED.fullmatch(name)}
    present, remote = dict(_entries(folder)), remote_recordings(folder)
    for name, expected in sums.items():
        place = _shown_path(folder, name)
        if name in remote:
            raise SealError(fetch_sentence(folder, remote))
        if name not in present:
            raise SealError(f"{place}: missing; it is listed in {SUMS}")
        actual = _sha256_of(folder / name) if present[name] else None
        if actual is None:
            raise SealError(f"{place}: not a readable file; it is listed in {SUMS}")
        if actual != expected:
            raise SealError(f"{place}: changed; its SHA-256 differs from {SUMS}")
    parts = {name.partition("/")[0] for name in (*sums, *left_out) if "/" in name}
    added = []
    for name in present.keys() - sums.keys():
        if any(name == one or name.startswith(f"{one}/") for one in left_out):
            continue
        top, inside, _ = name.partition("/")
        if inside and (top in parts or name.endswith(".mcap")):
            raise SealError(
                f"{_shown_path(folder, name)}: added among the run's own files; not listed in {SUMS}"
            )
        added.append(name)
    return SealReport(len(sums), tuple(left_out), tuple(sorted(added)))


def seal_sentence(folder: Path, sealed: SealReport | None) -> str:
    """Return the result of `check_seal` as one sentence."""
    if sealed is None:
        return (
            f"not sealed: {folder} has no {SUMS}, as after a killed run or one of an older version; "
            "changes to files other than recordings cannot be detected"
        )
    text = f"sealed: all {sealed.files} files match {SUMS}"
    for label, names in (("not sealed", sealed.left_out), ("added since", sealed.added)):
        if names:
            more = ", …" if len(names) > _SHOWN else ""
            text += f"; {label}: {len(names)} ({printable(', '.join(map(_escaped, names[:_SHOWN])))}{more})"
    return text


def _read_seal(path: Path) -> tuple[dict[str, str], list[str]]:
    """Return the checksums and the entries not sealed. Raises SealError for a damaged file."""
    content = _seal_content(path)
    body, mark, end = content.rpartition(_END.encode())
    if not mark or end != f"{hashlib.sha256(body).hexdigest()}\n".encode():
        raise SealError(f"{path}: damaged or truncated: the checksum of its own lines does not match")
    sums: dict[str, str] = {}
    left_out = []
    for line in os.fsdecode(body).split("\n")[:-1]:
        entry = _LINE.fullmatch(line)
        if entry:
            sums[_unescaped(entry[3]) if entry[1] else entry[3]] = entry[2]
        elif line.startswith(_LEFT_OUT):
            left_out.append(_unescaped(line.removeprefix(_LEFT_OUT)))
        else:
            raise SealError(f"{path}: invalid line {printable(line[:80])!r}")
    return sums, left_out


def _seal_content(path: Path) -> bytes:
    with suppress(OSError), regular_file.open_regular(path, links=False) as file:
        content = file.read(min(os.fstat(file.fileno()).st_size, _MAX_SEAL_BYTES) + 1)
        if len(content) <= _MAX_SEAL_BYTES:
            return content
    raise SealError(f"{path}: must be a regular file of at most {_MAX_SEAL_BYTES} bytes")


def _entries(folder: Path) -> Iterator[tuple[str, bool]]:
    """Yield the relative name of everything to seal, and whether it is a file.

    Excludes folders, SHA256SUMS and derived files. A strategy's own folder above the limits is one entry.
    """
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        try:
            with os.scandir(folder / inside) as listed:
                entries = sorted(listed, key=lambda entry: entry.name)
        except OSError:  # unreadable or deleted
            yield inside, False
            continue
        for entry in entries:
            name = f"{inside}/{entry.name}" if inside else entry.name
            if not entry.is_dir(follow_symlinks=False):
                if name not in (SUMS, _TEMPORARY) and not _DERIVED.fullmatch(name):
                    yield name, entry.is_file(follow_symlinks=False)
            elif entry.name == _OWN_FOLDER and name.count("/") == 1 and _is_too_large(folder / name):
                yield name, False
            else:
                waiting.append(name)


def _is_too_large(folder: Path) -> bool:
    size = files = 0
    waiting = [folder]
    while waiting and size <= _MAX_OWN_BYTES and files <= _MAX_OWN_FILES:
        with suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                files += 1
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(Path(entry.path))
                elif entry.is_file(follow_symlinks=False):
                    size += entry.stat(follow_symlinks=False).st_size
                if files > _MAX_OWN_FILES:
                    break
    return size > _MAX_OWN_BYTES or files > _MAX_OWN_FILES


def _sha256_of(path: Path) -> str | None:
    """Return a file's SHA-256; None if it cannot be read."""
    with suppress(OSError):
        return regular_file.size_and_sha256(path)[1]
    return None


def _shown_path(folder: Path, name: str) -> str:
    return printable(f"{folder}/{_escaped(name)}")


def _checksum_line(checksum: str, name: str) -> bytes:
    """Return a line in the format of sha256sum."""
    escaped = _escaped(name)
    return os.fsencode(f"{'' if escaped == name else chr(92)}{checksum}  {escaped}\n")


def _escaped(name: str) -> str:
    return name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")


def _unescaped(name: str) -> str:
    signs = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}
    return re.sub(r"\\[\\nr]", lambda found: signs[found.group()], name)
