"""The recordings of a run compared with one another and with its result: every message, sent and received."""

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.results.seal import Sealed, check_seal
from actors.messages import ROSTER
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Direction, Entry, Note, Reading, RecordingError, decoded
from actors.runtime.replay_bus import topic_of
from actors.runtime.shell import ActorDigest, MessageHash, carries_digest, run_digest

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
        if direction == way
        and not topic_of(key).is_from_outside
        and not topic_of(key).is_telemetry
        and not topic_of(key).is_recorded_only
    }


_LARGEST_RESULT: Final = 64 * 1024 * 1024


@dataclass(frozen=True)
class CheckReport:
    """What the files of a run say."""

    digest: str
    """Empty: nobody carries one, as robots on board run by their own clocks."""
    messages: int
    """Sent and taken, by all whose recordings there are."""
    complete: bool
    """False: at least one process left no final record, so the digest is that of what was written."""
    good_until: int | None
    """Where it is not complete: the step up to which every recording is there; None: not even the first."""
    unreceived: int
    """Messages that their receiver never took, because it had ended."""
    sealed: Sealed | None
    """What its seal says, with which everything agrees; None: it has none."""


def sentences(report: CheckReport) -> Iterator[str]:
    """What recordings say, for people, but for the seal."""
    digest = f"digest {report.digest}" if report.digest else "no digest without a recording of the world,"
    yield f"{digest} over {report.messages} messages"
    if report.unreceived:
        yield f"{report.unreceived} messages were taken by nobody: who they were for had ended"
    if not report.complete:
        until = "not even to the first step" if report.good_until is None else f"to step {report.good_until}"
        yield (
            "the run did not end as planned: this is the digest of what was recorded until then; every "
            f"recording is good up {until}"
        )


def check_recording(file: Path) -> tuple[dict[str, object], str]:
    """Compare one process's recording with its checksums; return what it is, for programs and in words.

    Raises RecordingError where it is damaged.
    """
    found = read_pass(file.stem, file, strict=True)
    count, state = found.digest.count, "whole" if found.whole else "cut"
    until = "" if found.step is None else f", good up to step {found.step}"
    said = f"the recording of {found.actor}: {count} digested messages, {state}{until}"
    told = {"actor": found.actor, "messages": count, "whole": found.whole, "good_until": found.step}
    return {"is": "recording", **told}, said


def check(out: Path, *, strict: bool = True) -> CheckReport:
    """Read all recordings of a run, and compare them, also with its result and its seal.

    `strict`: a damaged recording is a RecordingError, and one that was cut beside a result a CheckError;
    otherwise both are compared with the other recordings alone, as far as they go. Raises CheckError,
    RecordingError or SealError where files do not agree.
    """
    passes = [read_pass(actor, path, strict=strict) for actor, path in all_recordings(out).items()]
    blank = [told for told in passes if told.blank]
    if blank and all(told.final is not None for told in passes if not told.blank):
        raise CheckError(f"{blank[0].path}: ends before its first record")
    unreceived = sum(_compare(key, mesh) for mesh in _meshes(passes) for key in _keys(mesh))
    complete = all(told.final is not None and told.whole for told in passes)
    digest = (
        run_digest(told.digest for told in passes)
        if any(carries_digest(told.actor) for told in passes)
        else ""
    )
    compared = strict or complete
    if compared:
        _compare_result(out, digest, passes)
    return CheckReport(
        digest,
        sum(told.digest.count for told in passes),
        complete,
        min((told.step for told in passes if told.step is not None), default=None)
        if all(told.step is not None for told in passes)
        else None,
        unreceived,
        check_seal(out) if compared else None,
    )


def _meshes(passes: Sequence[Pass]) -> list[list[Pass]]:
    """The recordings of those who heard one another: all, or on board each robot's own three."""
    on_board = any(told.robot.endswith(".base") for told in passes)
    meshes = defaultdict[str, list[Pass]](list)
    for told in passes:
        meshes[told.robot.partition(".")[0] if on_board else ""].append(told)
    return [*meshes.values()]


def _keys(passes: Sequence[Pass]) -> list[str]:
    """Every key that an actor with a recording sends and another one receives."""
    keys = {key for told in passes for _, key in told.trails} - {ROSTER.pattern}
    topics = {key: topic_of(key) for key in keys}
    return sorted(k for k, one in topics.items() if not (one.is_from_outside or one.is_recorded_only))


def _compare(key: str, passes: Sequence[Pass]) -> int:
    """Compare what was sent and what was received on a key; how many messages nobody took."""
    senders = [told for told in passes if ("out", key) in told.trails]
    receivers = defaultdict[str, list[Pass]](list)
    for told in passes:
        if ("in", key) in told.trails:
            receivers[told.robot].append(told)
    if not senders:
        return 0  # their recordings are not here
    sent = _trail(senders, "out", key)
    missing = 0
    for parts in receivers.values():
        took = _trail(parts, "in", key)
        if sent != took:
            missing += _compare_stamps(key, senders, parts, Counter(_stamps(sent)), took)
    return missing if receivers else len(sent) // STAMP.size


def _compare_stamps(
    key: str,
    senders: Sequence[Pass],
    receivers: Sequence[Pass],
    left: Counter[tuple[int, bytes]],
    took: bytes,
) -> int:
    """How many of the stamps that are `left` were not taken; CheckError if another one was."""
    known = min((_known(told) for told in senders), default=-1)
    for stamp in _stamps(took):
        step, _ = stamp
        if left[stamp] > 0:
            left[stamp] -= 1
        elif step <= known:
            names = " and ".join(told.actor for told in receivers)
            what = "other bytes than" if any(other == step for other, _ in left) else "nothing like what"
            raise CheckError(f"step {step}: {senders[0].actor} sent {what} {names} received on {key}")
    unread = sum(told.final.unread for told in receivers if told.final is not None)
    missing = left.total()
    if _ended_by_clock(senders, receivers) and missing:
        last = max((step for step, _ in _stamps(took)), default=-1)
        if min(step for step, _ in left.elements()) > last:
            return missing  # it was under way when its receiver ended
    if all(told.final is not None for told in (*senders, *receivers)) and missing > unread:
        names = " and ".join(told.actor for told in receivers)
        raise CheckError(
            f"{key}: {missing - unread} messages of {senders[0].actor} never came to {names}, "
            f"the first one of step {min(step for step, _ in left.elements())}"
        )
    return missing


def _ended_by_clock(senders: Sequence[Pass], receivers: Sequence[Pass]) -> bool:
    """True on board, where nobody waits for the last message."""
    return any("." in told.robot for told in (*senders, *receivers))


def _known(told: Pass) -> int:
    """The last step of which everything that was sent is known."""
    if told.final is not None:
        return 1 << 64
    return -1 if told.step is None else told.step


def _trail(passes: Sequence[Pass], way: Direction, key: str) -> bytes:
    return b"".join(told.trails[way, key] for told in passes)


def _stamps(trail: bytes) -> Iterator[tuple[int, bytes]]:
    yield from STAMP.iter_unpack(trail)


def _compare_result(out: Path, digest: str, passes: Sequence[Pass]) -> None:
    """A result stands only beside recordings that are whole, and has their digest."""
    result = out / "run.json"
    if not result.is_file():
        return
    with regular_file.opened(result) as file:
        text = file.read(_LARGEST_RESULT + 1)
    try:
        claimed = typed_json.decode(text, _Claim).digest
    except ValueError as error:
        raise RecordingError(f"{result}: no result of a run: {error}") from None
    cut = next((told for told in passes if told.final is None or not told.whole), None)
    if cut is not None:
        until = "its first step" if cut.step is None else f"step {cut.step}"
        raise CheckError(
            f"{cut.path}: ends after {until}, although the run has a result; it was cut or damaged"
        )
    if claimed != digest:
        raise CheckError(f"{result}: another digest than the recordings give, which is {digest}")


class _Claim(msgspec.Struct):
    """The part of a result that recordings can give again."""

    digest: str
