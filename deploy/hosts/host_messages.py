"""What is said between the computer on which a run was started and a host of its robots."""

from typing import Annotated, Final

import msgspec

from actors.runtime.isolation.resource_limits import ProcessLimits
from observation.results.hosts_file import Id, Size, Sum

Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
"""Of a process that was asked for, counted over the run."""
Seconds = Annotated[float, msgspec.Meta(ge=0)]
Words = Annotated[str, msgspec.Meta(max_length=2000)]
PART: Final = 1 << 16
"""Bytes of a file that travel together at most."""


class FilePart(msgspec.Struct, frozen=True, tag=True):
    """What comes next in a file, either way."""

    path: Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
    """With `/`; from a host below the run's folder, to a host below its own."""
    data: Annotated[bytes, msgspec.Meta(max_length=PART)]


class Begin(msgspec.Struct, frozen=True, tag=True):
    """To a host, after the files of its robots: join the mesh."""

    robots: tuple[Id, ...]
    endpoint: str
    """Of the world's router."""
    spawn: str
    limits: ProcessLimits
    code: int
    """How many folders with the strategy's code lie in `code/`."""
    share: tuple[tuple[str, ...], ...]
    """What robots have in common, see `in_common` of the plan."""
    leave: bool
    """Recordings stay where they are."""


class StartRobot(msgspec.Struct, frozen=True, tag=True):
    """To a host: start a robot's process."""

    number: Number
    robot: Id
    setup: bytes
    """Its set-up, as it is written to its file."""


class Signal(msgspec.Struct, frozen=True, tag=True):
    """To a host: send a process a signal."""

    number: Number
    signal: int


class AskPulse(msgspec.Struct, frozen=True, tag=True):
    """To a host, every second: somebody is there, and wants a Pulse."""


class Finish(msgspec.Struct, frozen=True, tag=True):
    """To a host: send what has not been sent, and end."""


class Joined(msgspec.Struct, frozen=True, tag=True):
    """From a host: what its robots say is heard."""

    clock_s: float
    """What its clock shows, since the epoch."""
    folder: Words
    """Where its robots record."""


class Unlinked(msgspec.Struct, frozen=True, tag=True):
    """From a host: its link to the mesh broke, or the mesh has ended."""


class NotStarted(msgspec.Struct, frozen=True, tag=True):
    """From a host: a process that could not be started."""

    number: Number
    why: Words


class Gone(msgspec.Struct, frozen=True, tag=True):
    """From a host: a process has ended; what it has written follows."""

    number: Number


class LeftRecording(msgspec.Struct, frozen=True, tag=True):
    """From a host: the recording of a process that has ended, and stays there."""

    number: Number
    bytes: Size
    sha256: Sum
    notes: dict[str, Annotated[str, msgspec.Meta(max_length=1 << 20)]]
    """Of what its process has noted in it, the ends: `final`, `failure`."""


class EndedProcess(msgspec.Struct, frozen=True, tag=True):
    """From a host: all that a process that has ended had written has been sent."""

    number: Number
    code: Annotated[int, msgspec.Meta(ge=-64, le=255)]
    strays: Annotated[int, msgspec.Meta(ge=0)]
    cpu_s: Seconds


class Glimpse(msgspec.Struct, frozen=True, array_like=True):
    """One process on a host, as of `process_table`."""

    pid: Number
    parent: Number
    session: Number
    state: Annotated[str, msgspec.Meta(min_length=1, max_length=1)]
    cpu_s: Seconds
    queued_s: Seconds | None


class Pulse(msgspec.Struct, frozen=True, tag=True):
    """From a host, in answer to AskPulse."""

    processes: Annotated[tuple[Glimpse, ...], msgspec.Meta(max_length=100_000)]
    """The robots' processes, and what they have started."""
    started: dict[int, Number]
    """Their process ids by the numbers under which they were asked for."""


class Fault(msgspec.Struct, frozen=True, tag=True):
    """From a host: why the run cannot go on."""

    why: Words


class Done(msgspec.Struct, frozen=True, tag=True):
    """From a host: everything has been sent, nothing is left there."""


ToHost = FilePart | Begin | StartRobot | Signal | AskPulse | Finish
FromHost = (
    FilePart | Joined | Unlinked | NotStarted | Gone | LeftRecording | EndedProcess | Pulse | Fault | Done
)
