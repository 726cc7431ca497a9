"""`hosts.json` in the folder of a run over several computers: who was where, and what has stayed there."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec

from actors.installation.usage import typed
from actors.runtime import regular_file, typed_json

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
    regular_file.write(out / NAME, msgspec.json.format(msgspec.json.encode(told)) + b"\n")


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
        f"`{typed('cluster', 'fetch', out)}` brings what has stayed there"
    )
