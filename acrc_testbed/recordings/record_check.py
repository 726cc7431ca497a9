"""Comparison of a run's recordings with each other, with its result and its seal."""

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.results.seal import SealReport, check_seal
from actors.messages import ROSTER
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Direction, Entry, Note, RecordingError, RecordingReader, decode_note
from actors.runtime.replay_bus import topic_of
from actors.runtime.shell import ActorDigest, MessageHash, is_in_run_digest, run_digest

STAMP: Final = struct.Struct("<Q32s")
"""A message in a trail: its step and the sha256 of its bytes."""
_HASH_BATCH: Final = 256
"""Messages that are hashed in one batch."""


class CheckError(AcrcError):
    """Recordings that contradict one another or the run's result."""


@dataclass
class RecordingContents:
    """Contents of one recording up to its first damage."""

    actor: str
    """Name of the file."""
    path: Path
    trails: dict[tuple[Direction, str], bytearray] = field(default_factory=lambda: defaultdict(bytearray))
    """Concatenated stamps of the messages, by direction and key."""
    digest: ActorDigest = field(default_factory=lambda: MessageHash().digest(""))
    final: FinalNote | None = None
    """None: the process did not end as planned."""
    step: int | None = None
    """Last complete step; None: none."""
    whole: bool = False
    """True: the file was closed; False: it is truncated."""
    blank: bool = False
    """True: the file is truncated before its first record."""

    @property
    def robot(self) -> str:
        """The actor without its restart number."""
        return self.path.parent.name


def read_contents(actor: str, path: Path, *, strict: bool = False) -> RecordingContents:
    """Read a recording. Raises CheckError if it is inconsistent, RecordingError as `RecordingReader` does."""
    contents, running, reading = (
        RecordingContents(actor, path),
        MessageHash(),
        RecordingReader(path, strict=strict),
    )
    first = True
    for item in reading:
        if first:
            _check_first(actor, path, item)
            first = False
        elif isinstance(item, Note):
            if item.name == "final":
                contents.final = decode_note(path, "final", item.json, FinalNote)
        else:
            _add_message(contents, running, item)
    contents.blank = first
    contents.step, contents.whole = reading.step, reading.whole
    contents.digest = running.digest(actor)
    _check_final(contents)
    return contents


def _check_first(actor: str, path: Path, item: Entry | Note) -> None:
    if not isinstance(item, Note) or item.name != "run":
        raise CheckError(f"{path}: does not begin with the record 'run'")
    run = decode_note(path, "run", item.json, RunNote)
    if run.actor != actor and not path.parent.name.endswith(f".{run.actor}"):
        raise CheckError(f"{path}: recording of {run.actor[:40]!r} instead of {actor!r}")


def _add_message(contents: RecordingContents, running: MessageHash, entry: Entry) -> None:
    trail = contents.trails[entry.direction, entry.key]
    number = len(trail) // STAMP.size
    topic = topic_of(entry.key)
    if entry.sequence != number:
        raise CheckError(
            f"{contents.path}: step {entry.step}: message {number} on {entry.key} has number {entry.sequence}"
        )
    if not 0 <= entry.step < 1 << 64:
        raise CheckError(f"{contents.path}: a message on {entry.key} has step {entry.step}")
    trail += STAMP.pack(entry.step, entry.sha256)
    if topic.is_digested:
        running.waiting += ((entry.key, entry.step, entry.sequence, entry.sha256),)
        if len(running.waiting) > _HASH_BATCH:
            running.settle()


def _check_final(contents: RecordingContents) -> None:
    """Compare the process's final counts with the contents of its file."""
    final = contents.final
    if final is None:
        return
    # names are not compared: on hardware the actor is "base", and its file "r1.base"
    counted, recorded = final.digest, contents.digest
    if (counted.count, counted.sha256) != (recorded.count, recorded.sha256):
        raise CheckError(
            f"{contents.path}: contains {contents.digest.count} messages of {contents.actor} with hash "
            f"{contents.digest.sha256[:12]}; the process counted {final.digest.count} with hash "
            f"{final.digest.sha256[:12]}"
        )
    sent, received = _message_counts(contents, "out"), _message_counts(contents, "in")
    if dict(final.sent) != sent or final.published != sum(sent.values()):
        raise CheckError(f"{contents.path}: number of sent messages differs from the process's count")
    lost = {key for key in received if received[key] > final.arrived.get(key, 0)}
    unread = sum(final.arrived.values()) - sum(received.values())
    if lost or not 0 <= unread <= final.unread:
        raise CheckError(f"{contents.path}: number of received messages differs from the process's count")


def _message_counts(contents: RecordingContents, counted_direction: Direction) -> dict[str, int]:
    return {
        key: len(trail) // STAMP.size
        for (direction, key), trail in contents.trails.items()
        if direction == counted_direction
        and not topic_of(key).is_from_outside
        and not topic_of(key).is_telemetry
        and not topic_of(key).is_recorded_only
    }


_MAX_RESULT_BYTES: Final = 64 * 1024 * 1024


@dataclass(frozen=True)
class CheckReport:
    """Result of checking the files of a run."""

    digest: str
    """Empty: no actor has one, as on hardware."""
    messages: int
    """Messages sent and received in all recordings."""
    complete: bool
    """False: a process wrote no final record, so the digest covers the recorded part only."""
    good_until: int | None
    """Last step that is complete in all recordings; None: none."""
    unreceived: int
    """Messages that were not received, as their receiver had exited."""
    sealed: SealReport | None
    """The verified seal; None: there is none."""


def check_sentences(report: CheckReport) -> Iterator[str]:
    """Yield sentences about the recordings; the seal is reported separately."""
    digest = f"digest {report.digest}" if report.digest else "no digest without a recording of the world,"
    yield f"{digest} over {report.messages} messages"
    if report.unreceived:
        yield f"{report.unreceived} messages were not received: their receivers had exited"
    if not report.complete:
        until = "no step" if report.good_until is None else f"complete up to step {report.good_until}"
        yield f"the run did not end as planned; the digest covers the recorded part; recordings: {until}"


def check_recording(file: Path) -> tuple[dict[str, object], str]:
    """Verify the checksums of one recording; return the result as JSON types and as a sentence.

    Raises RecordingError if it is damaged.
    """
    found = read_contents(file.stem, file, strict=True)
    count, state = found.digest.count, "complete" if found.whole else "truncated"
    until = "" if found.step is None else f", valid up to step {found.step}"
    sentence = f"recording of {found.actor}: {count} digested messages, {state}{until}"
    contents = {"actor": found.actor, "messages": count, "whole": found.whole, "good_until": found.step}
    return {"is": "recording", **contents}, sentence


def check_run(out: Path, *, strict: bool = True) -> CheckReport:
    """Compare all recordings of a run with each other, with its result and its seal.

    `strict`: raise RecordingError for a damaged recording, and CheckError for a truncated one of a run with a
    result; otherwise compare their valid parts with the other recordings only. Raises CheckError,
    RecordingError or SealError if files disagree.
    """
    recordings = [read_contents(actor, path, strict=strict) for actor, path in all_recordings(out).items()]
    blank = [contents for contents in recordings if contents.blank]
    if blank and all(contents.final is not None for contents in recordings if not contents.blank):
        raise CheckError(f"{blank[0].path}: ends before its first record")
    unreceived = sum(_compare(key, mesh) for mesh in _meshes(recordings) for key in _exchanged_keys(mesh))
    complete = all(contents.final is not None and contents.whole for contents in recordings)
    digest = (
        run_digest(contents.digest for contents in recordings)
        if any(is_in_run_digest(contents.actor) for contents in recordings)
        else ""
    )
    compared = strict or complete
    if compared:
        _compare_result(out, digest, recordings)
    return CheckReport(
        digest,
        sum(contents.digest.count for contents in recordings),
        complete,
        min((contents.step for contents in recordings if contents.step is not None), default=None)
        if all(contents.step is not None for contents in recordings)
        else None,
        unreceived,
        check_seal(out) if compared else None,
    )


def _meshes(recordings: Sequence[RecordingContents]) -> list[list[RecordingContents]]:
    """Group the recordings of processes that exchanged messages: all, or on hardware those of one robot."""
    on_board = any(contents.robot.endswith(".base") for contents in recordings)
    meshes = defaultdict[str, list[RecordingContents]](list)
    for contents in recordings:
        meshes[contents.robot.partition(".")[0] if on_board else ""].append(contents)
    return [*meshes.values()]


def _exchanged_keys(recordings: Sequence[RecordingContents]) -> list[str]:
    """Return the keys on which recorded actors exchange messages."""
    keys = {key for contents in recordings for _, key in contents.trails} - {ROSTER.pattern}
    topics = {key: topic_of(key) for key in keys}
    return sorted(k for k, one in topics.items() if not (one.is_from_outside or one.is_recorded_only))


def _compare(key: str, recordings: Sequence[RecordingContents]) -> int:
    """Compare sent and received messages on a key; return the number that was not received."""
    senders = [contents for contents in recordings if ("out", key) in contents.trails]
    receivers = defaultdict[str, list[RecordingContents]](list)
    for contents in recordings:
        if ("in", key) in contents.trails:
            receivers[contents.robot].append(contents)
    if not senders:
        return 0  # their recordings are not here
    sent = _trail(senders, "out", key)
    missing = 0
    for parts in receivers.values():
        received = _trail(parts, "in", key)
        if sent != received:
            missing += _compare_stamps(key, senders, parts, Counter(STAMP.iter_unpack(sent)), received)
    return missing if receivers else len(sent) // STAMP.size


def _compare_stamps(
    key: str,
    senders: Sequence[RecordingContents],
    receivers: Sequence[RecordingContents],
    pending: Counter[tuple[int, bytes]],
    received: bytes,
) -> int:
    """Return how many of the stamps `pending` were not received. Raises CheckError for an unknown one."""
    known, sender = min((_last_known_step(contents) for contents in senders), default=-1), senders[0].actor
    names = " and ".join(contents.actor for contents in receivers)
    for stamp in STAMP.iter_unpack(received):
        step, _ = stamp
        if pending[stamp] > 0:
            pending[stamp] -= 1
        elif step <= known:
            what = "differs from what" if any(other == step for other, _ in pending) else "is not among what"
            raise CheckError(f"step {step}: a message that {names} received on {key} {what} {sender} sent")
    unread = sum(contents.final.unread for contents in receivers if contents.final is not None)
    missing = pending.total()
    on_hardware = any("." in contents.robot for contents in (*senders, *receivers))
    if on_hardware and missing:  # no process waits for the last message
        last = max((step for step, _ in STAMP.iter_unpack(received)), default=-1)
        if min(step for step, _ in pending.elements()) > last:
            return missing  # in flight when the receiver exited
    if all(contents.final is not None for contents in (*senders, *receivers)) and missing > unread:
        raise CheckError(
            f"{key}: {missing - unread} messages of {sender} were not received by {names}, "
            f"the first one in step {min(step for step, _ in pending.elements())}"
        )
    return missing


def _last_known_step(contents: RecordingContents) -> int:
    """Return the last step whose sent messages are all recorded."""
    if contents.final is not None:
        return 1 << 64
    return -1 if contents.step is None else contents.step


def _trail(recordings: Sequence[RecordingContents], direction: Direction, key: str) -> bytes:
    return b"".join(contents.trails[direction, key] for contents in recordings)


def _compare_result(out: Path, digest: str, recordings: Sequence[RecordingContents]) -> None:
    """Raise CheckError unless a result has complete recordings with its digest."""
    result = out / "run.json"
    if not result.is_file():
        return
    with regular_file.open_regular(result) as file:
        text = file.read(_MAX_RESULT_BYTES + 1)
    try:
        claimed = typed_json.decode(text, _ResultDigest).digest
    except ValueError as error:
        raise RecordingError(f"{result}: not a valid run result: {error}") from None
    cut = next((contents for contents in recordings if contents.final is None or not contents.whole), None)
    if cut is not None:
        until = "its first step" if cut.step is None else f"step {cut.step}"
        raise CheckError(
            f"{cut.path}: ends after {until}, but the run has a result; the file is truncated or damaged"
        )
    if claimed != digest:
        raise CheckError(f"{result}: digest differs from that of the recordings, {digest}")


class _ResultDigest(msgspec.Struct):
    """The part of a result that follows from the recordings."""

    digest: str
