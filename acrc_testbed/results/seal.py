"""The seal of a folder with results: the SHA-256 of every file that was in it when it was finished.

SHA256SUMS has the form that `sha256sum -c` reads, and a comment at its end with the sum of its own lines. It
shows that nothing was changed by mistake, in part, or on the way; whoever can write to the folder can seal
it anew.
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

NAME: Final = "hosts.json"
_LARGEST: Final = 16 << 20
Words = Annotated[str, msgspec.Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f-\x9f]*\Z")]
"""What may be shown on a terminal, whoever wrote it."""
Id = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}\Z")]
FileName = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}/[A-Za-z0-9_.-]{1,64}\Z")]
"""Below a run's folder."""
Size = Annotated[int, msgspec.Meta(ge=0, le=1 << 50)]
Sum = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
Share = Annotated[float, msgspec.Meta(ge=0)]


class HostLoad(msgspec.Struct, frozen=True):
    """How much a host had to do, by what it told once a second."""

    worked: Share = 0.0
    """Processors that its robots' processes kept busy, on average."""
    waited: Share = 0.0
    """Processes that waited for a processor, on average."""
    answer_s: Share = 0.0
    """How long it took to answer, on average, s: there and back, and a look at its processes."""
    slowest_s: Share = 0.0
    """The longest of these, s."""


class HostPart(msgspec.Struct, frozen=True):
    """One host's part of a run."""

    address: Words
    """Of the computer, as its cluster knows it."""
    cores: Annotated[int, msgspec.Meta(ge=1)]
    robots: tuple[Id, ...]
    folder: Words
    """Where they record there; it is removed at the run's end if nothing is left in it."""
    load: HostLoad = HostLoad()


class LeftFile(msgspec.Struct, frozen=True):
    """A recording that stayed on its host when the run ended."""

    host: Id
    bytes: Size
    sha256: Sum


class HostsFile(msgspec.Struct, frozen=True):
    """The hosts of a run."""

    cluster: Words
    """Address of its scheduler."""
    run: Words
    """What the hosts know the run by, drawn for it."""
    hosts: dict[Id, HostPart]
    left: dict[FileName, LeftFile] = {}
    """By name; where such a file is by now is to be seen there."""


def write(out: Path, told: HostsFile) -> None:
    """Write it into a run's folder, in place of one from before."""
    regular_file.write_atomically(out / NAME, typed_json.dump(told))


def read(out: Path) -> HostsFile | None:
    """That of a run; None where there is none, for its robots were on one computer. Raises AcrcError."""
    path = out / NAME
    return typed_json.read(path, HostsFile, "list of a run's hosts", _LARGEST) if path.exists() else None


def elsewhere(out: Path) -> Mapping[str, LeftFile]:
    """The recordings of a run that are still on its hosts, by name below its folder. Raises AcrcError."""
    told = read(out)
    left = {} if told is None else told.left
    return {name: one for name, one in left.items() if not (out / name).exists()}


def where(out: Path, left: Mapping[str, LeftFile]) -> str:
    """One sentence on what is still elsewhere, and how it comes here."""
    hosts = sorted({one.host for one in left.values()})
    some = next(iter(left))
    others = "1 more is" if len(left) == 2 else f"{len(left) - 1} more are"
    more = f" and {others}" if len(left) > 1 else " is"
    return (
        f"{out / some}{more} still on {'host' if len(hosts) == 1 else 'hosts'} {', '.join(hosts)}; "
        f"`{command_line('cluster', 'fetch', out)}` brings what has stayed there"
    )


SUMS: Final = "SHA256SUMS"
_NEW: Final = f"{SUMS}.new"
_OWN: Final = "own"
_OWN_BYTES: Final = 1_000_000_000
"""What a robot's strategy may leave in its own folder to be sealed, bytes; own choice: a second's hashing."""
_OWN_FILES: Final = 10_000
_SEAL_LARGEST: Final = 64 * 1024 * 1024
"""Of a file with sums, bytes."""
_NAMED: Final = 5
"""So many files are named in a sentence."""
_MADE_ANEW: Final = re.compile(r"[^/]*\.rrd|report/[^/]+\.(html|png|svg|csv)")
"""Views in a run's folder, traces beside recordings, a campaign's report: they come of what is sealed."""
_LINE: Final = re.compile(r"(\\?)([0-9a-f]{64})  (.+)")
_LEFT_OUT: Final = "# not sealed: "
_END: Final = "# SHA-256 of the lines above: "


class SealError(AcrcError):
    """A folder that is not as it was when it was sealed."""


class Sealed(NamedTuple):
    """A folder in which every sealed file is as it was."""

    files: int
    left_out: tuple[str, ...]
    """What was there and not sealed: links, and what a strategy left that is too large."""
    added: tuple[str, ...]
    """Files that came later, such as pictures."""


def lines(sums: Mapping[str, str], left_out: Iterable[str] = ()) -> bytes:
    """The content of SHA256SUMS for these sums by name, relative to its folder."""
    text = b"".join(
        [_line(sums[name], name) for name in sorted(sums)]
        + [os.fsencode(f"{_LEFT_OUT}{_escaped(name)}\n") for name in sorted(left_out)]
    )
    return text + f"{_END}{hashlib.sha256(text).hexdigest()}\n".encode()


def seal(folder: Path, missing: Mapping[str, str] | None = None) -> None:
    """Write SHA256SUMS over all that lies in the folder now, whole or not at all. May raise OSError.

    `missing`: sums of files that are to come into it later, by name.
    """
    sums = dict(missing or {})
    left_out: list[str] = []
    for name, is_file in _entries(folder):
        found = _sum(folder / name) if is_file else None
        if found is None:
            left_out.append(name)
        else:
            sums[name] = found
    regular_file.write_atomically(folder / SUMS, lines(sums, left_out))


def check_seal(folder: Path) -> Sealed | None:
    """Compare the folder with its seal; None if it has none. Raises SealError, which names the first file."""
    path = folder / SUMS
    if not os.path.lexists(path):
        return None
    sums, left_out = _read(path)
    sums = {name: was for name, was in sums.items() if not _MADE_ANEW.fullmatch(name)}
    present, away = dict(_entries(folder)), elsewhere(folder)
    for name, was in sums.items():
        place = _place(folder, name)
        if name in away:
            raise SealError(where(folder, away))
        if name not in present:
            raise SealError(f"{place}: is missing; it was there when {SUMS} was written")
        found = _sum(folder / name) if present[name] else None
        if found is None:
            raise SealError(f"{place}: is no file that can be read; it was one when {SUMS} was written")
        if found != was:
            raise SealError(f"{place}: was changed; its SHA-256 is not the one in {SUMS}")
    parts = {name.partition("/")[0] for name in (*sums, *left_out) if "/" in name}
    added = []
    for name in present.keys() - sums.keys():
        if any(name == one or name.startswith(f"{one}/") for one in left_out):
            continue
        top, inside, _ = name.partition("/")
        if inside and (top in parts or name.endswith(".mcap")):
            raise SealError(
                f"{_place(folder, name)}: was added; {SUMS} does not list it, and it lies among the "
                "run's own files"
            )
        added.append(name)
    return Sealed(len(sums), tuple(left_out), tuple(sorted(added)))


def sentence(folder: Path, sealed: Sealed | None) -> str:
    """What `check_seal` has found, in one line."""
    if sealed is None:
        return (
            f"not sealed: {folder} has no {SUMS}, as after a run that was killed or is of an older version; "
            "changes to files beside the recordings cannot be seen"
        )
    told = f"sealed: all {sealed.files} files are as they were when {SUMS} was written"
    for words, names in (("not sealed", sealed.left_out), ("added since", sealed.added)):
        if names:
            more = ", …" if len(names) > _NAMED else ""
            told += f"; {words}: {len(names)} ({printable(', '.join(map(_escaped, names[:_NAMED])))}{more})"
    return told


def _read(path: Path) -> tuple[dict[str, str], list[str]]:
    """The sums, and what was left out. Raises SealError for what `lines` would not have written."""
    content = _content(path)
    body, mark, end = content.rpartition(_END.encode())
    if not mark or end != f"{hashlib.sha256(body).hexdigest()}\n".encode():
        raise SealError(f"{path}: is damaged or was cut: the sum of its own lines, at its end, is another")
    sums: dict[str, str] = {}
    left_out = []
    for line in os.fsdecode(body).split("\n")[:-1]:
        entry = _LINE.fullmatch(line)
        if entry:
            sums[_plain(entry[3]) if entry[1] else entry[3]] = entry[2]
        elif line.startswith(_LEFT_OUT):
            left_out.append(_plain(line.removeprefix(_LEFT_OUT)))
        else:
            raise SealError(f"{path}: has a line that is none of a sum: {printable(line[:80])!r}")
    return sums, left_out


def _content(path: Path) -> bytes:
    with suppress(OSError), regular_file.open_regular(path, links=False) as file:
        content = file.read(min(os.fstat(file.fileno()).st_size, _SEAL_LARGEST) + 1)
        if len(content) <= _SEAL_LARGEST:
            return content
    raise SealError(f"{path}: should be a file of at most {_SEAL_LARGEST} bytes, and no link")


def _entries(folder: Path) -> Iterator[tuple[str, bool]]:
    """Everything below the folder but folders, SHA256SUMS and views, by relative name; True for files.

    A strategy's own folder that is too large, or has more than can be looked at, is one entry.
    """
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        try:
            with os.scandir(folder / inside) as listed:
                entries = sorted(listed, key=lambda entry: entry.name)
        except OSError:  # closed, or gone
            yield inside, False
            continue
        for entry in entries:
            name = f"{inside}/{entry.name}" if inside else entry.name
            if not entry.is_dir(follow_symlinks=False):
                if name not in (SUMS, _NEW) and not _MADE_ANEW.fullmatch(name):
                    yield name, entry.is_file(follow_symlinks=False)
            elif entry.name == _OWN and name.count("/") == 1 and _is_too_large(folder / name):
                yield name, False
            else:
                waiting.append(name)


def _is_too_large(folder: Path) -> bool:
    size = files = 0
    waiting = [folder]
    while waiting and size <= _OWN_BYTES and files <= _OWN_FILES:
        with suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                files += 1
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(Path(entry.path))
                elif entry.is_file(follow_symlinks=False):
                    size += entry.stat(follow_symlinks=False).st_size
                if files > _OWN_FILES:
                    break
    return size > _OWN_BYTES or files > _OWN_FILES


def _sum(path: Path) -> str | None:
    """The file's SHA-256; None if it is none that can be read."""
    with suppress(OSError):
        return regular_file.size_and_sha256(path)[1]
    return None


def _place(folder: Path, name: str) -> str:
    return printable(f"{folder}/{_escaped(name)}")


def _line(found: str, name: str) -> bytes:
    """As sha256sum writes it."""
    escaped = _escaped(name)
    return os.fsencode(f"{'' if escaped == name else chr(92)}{found}  {escaped}\n")


def _escaped(name: str) -> str:
    return name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")


def _plain(name: str) -> str:
    signs = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}
    return re.sub(r"\\[\\nr]", lambda found: signs[found.group()], name)
