"""One reading of one recording, for comparisons: what it sent and took, by key, and whether it agrees with
what its process said of itself."""

import struct
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.errors import AcrcError
from actors.runtime.message_counts import ActorDigest, MessageHash
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Direction, Entry, Note, Reading, decoded

STAMP: Final = struct.Struct("<Q32s")
"""A message in a trail: its step, and the sha256 of its bytes."""
_TOGETHER: Final = 256
"""Messages that wait to be hashed in one go."""


class CheckError(AcrcError):
    """Recordings that contradict one another or the run's result."""


@dataclass
class Pass:
    """What one recording holds, as far as it is good."""

    actor: str
    """By the file's name."""
    path: Path
    trails: dict[tuple[Direction, str], bytearray] = field(default_factory=lambda: defaultdict(bytearray))
    """A stamp for each message, by direction and key."""
    digest: ActorDigest = field(default_factory=lambda: MessageHash().digest(""))
    final: FinalNote | None = None
    """None: the process did not end as planned."""
    step: int | None = None
    """Up to this one everything is there; None: not even the first one."""
    whole: bool = False
    """True: the file was closed. False: it was cut."""
    blank: bool = False
    """True: it was cut before its first record."""

    @property
    def robot(self) -> str:
        """The actor without the number of its start."""
        return self.path.parent.name


def read_pass(actor: str, path: Path, *, strict: bool = False) -> Pass:
    """Read a recording once. Raises CheckError where it contradicts itself, RecordingError: see Reading."""
    told, running, reading = Pass(actor, path), MessageHash(), Reading(path, strict=strict)
    first = True
    for item in reading:
        if first:
            _check_first(actor, path, item)
            first = False
        elif isinstance(item, Note):
            if item.name == "final":
                told.final = decoded(path, "final", item.json, FinalNote)
        else:
            _follow(told, running, item)
    told.blank = first
    told.step, told.whole = reading.step, reading.whole
    told.digest = running.digest(actor)
    _check_final(told)
    return told


def _check_first(actor: str, path: Path, item: Entry | Note) -> None:
    if not isinstance(item, Note) or item.name != "run":
        raise CheckError(f"{path}: does not begin with the record 'run'")
    run = decoded(path, "run", item.json, RunNote)
    if run.actor != actor and not path.parent.name.endswith(f".{run.actor}"):
        raise CheckError(f"{path}: is a recording of {run.actor[:40]!r}, and should be one of {actor!r}")


def _follow(told: Pass, running: MessageHash, entry: Entry) -> None:
    trail = told.trails[entry.direction, entry.key]
    number = len(trail) // STAMP.size
    topic = topic_of(entry.key)
    if entry.sequence != number:
        raise CheckError(
            f"{told.path}: step {entry.step}: message {number} on {entry.key} has the number {entry.sequence}"
        )
    if not 0 <= entry.step < 1 << 64:
        raise CheckError(f"{told.path}: a message on {entry.key} is of step {entry.step}")
    trail += STAMP.pack(entry.step, entry.sha256)
    if topic.is_digested:
        running.waiting += ((entry.key, entry.step, entry.sequence, entry.sha256),)
        if len(running.waiting) > _TOGETHER:
            running.settle()


def _check_final(told: Pass) -> None:
    """What the process itself counted must be what stands in its file."""
    final = told.final
    if final is None:
        return
    counted, held = final.digest, told.digest  # on board a process calls itself "base", its file "r1.base"
    if (counted.count, counted.sha256) != (held.count, held.sha256):
        raise CheckError(
            f"{told.path}: holds {told.digest.count} messages of {told.actor} with hash "
            f"{told.digest.sha256[:12]}; the process itself counted {final.digest.count} with hash "
            f"{final.digest.sha256[:12]}"
        )
    sent, took = _counted(told, "out"), _counted(told, "in")
    if dict(final.sent) != sent or final.published != sum(sent.values()):
        raise CheckError(f"{told.path}: does not hold as many sent messages as its process counted")
    lost = {key for key in took if took[key] > final.arrived.get(key, 0)}
    unread = sum(final.arrived.values()) - sum(took.values())
    if lost or not 0 <= unread <= final.unread:
        raise CheckError(f"{told.path}: does not hold as many received messages as its process counted")


def _counted(told: Pass, way: Direction) -> dict[str, int]:
    return {
        key: len(trail) // STAMP.size
        for (direction, key), trail in told.trails.items()
        if direction == way and not topic_of(key).is_from_outside and not topic_of(key).is_telemetry
    }
