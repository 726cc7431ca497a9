"""Recordings looked at afterwards: the digest computed again from the files, and actors executed again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.radio.program import part as radio_part
from actors.robot.program import part as robot_part
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote, Part, RunNote
from actors.runtime.recording import Entry, Note, RecordingError, Unrecorded, read_notes, read_recording
from actors.runtime.replay_bus import ReplayBus, replay, topic_of
from actors.runtime.shell import Shell
from actors.runtime.tally import ActorDigest, MessageHash, is_digested, run_digest
from actors.world import program as world_program


class CheckError(AcrcError):
    """Recordings that contradict one another or the run's result."""


@dataclass(frozen=True)
class CheckReport:
    """What the files of a run say about its digest."""

    digest: str
    messages: int
    complete: bool
    """False: at least one process left no final record, so the digest is that of what was written."""
    unreceived: int
    """Large messages whose receiver recorded nothing of the kind, because it had ended."""


@dataclass(frozen=True)
class ReplayReport:
    """One actor executed again."""

    actor: str
    outputs: int
    """How many messages it sent again, all equal to the recorded ones."""


def recordings(out: Path) -> dict[str, Path]:
    """The recordings of a run by actor; a restarted robot's later ones are named `r2.1`, `r2.2`, …"""
    found = {path.stem: path for path in sorted(out.glob("*/*.mcap"))}
    if not found:
        raise RecordingError(f"{out}: no run's folder: there is no */*.mcap in it")
    return found


def check(out: Path) -> CheckReport:
    """Compute the digest of a run again from its files; CheckError where they do not agree."""
    files = recordings(out)
    received = {
        (entry.key, entry.step): entry.sha256
        for path in files.values()
        for entry in _entries(path)
        if entry.direction == "in"
    }
    digests, unreceived = [], 0
    for actor, path in files.items():
        digest, missing = _recompute(actor, path, received)
        digests.append(digest)
        unreceived += missing
    agreed = [_agrees(digest, files[digest.actor]) for digest in digests]
    report = CheckReport(run_digest(digests), sum(d.count for d in digests), all(agreed), unreceived)
    _compare_result(out, report)
    return report


def replay_actor(out: Path, actor: str) -> ReplayReport:
    """Execute one actor again from what it received; ReplayError at the first output that differs."""
    files = recordings(out)
    if actor not in files:
        raise RecordingError(f"{out}: no recording of {actor!r}; there are {', '.join(files)}")
    notes = read_notes(files[actor])
    if "run" not in notes:
        raise RecordingError(f"{files[actor]}: ends before its first record")
    run = msgspec.json.decode(notes["run"], type=RunNote)
    part = _builders().get(actor, robot_part)(run.argv)
    bus = ReplayBus(files[actor])
    shell = Shell(part.core, bus, Unrecorded(), actor=run.actor, open_to=part.open_to)
    if part.ready is not None:
        shell.send(part.ready)
    replay(shell, bus)
    return ReplayReport(actor, bus.compared)


def _builders() -> dict[str, Callable[[tuple[str, ...]], Part]]:
    return {"world": world_program.part_of, "radio": radio_part}


def _entries(path: Path) -> Iterator[Entry]:
    return (item for item in read_recording(path) if not isinstance(item, Note))


def _recompute(actor: str, path: Path, received: dict[tuple[str, int], bytes]) -> tuple[ActorDigest, int]:
    """The digest of one file's outputs, and how many of its large ones nobody recorded."""
    running, unreceived = MessageHash(), 0
    for entry in _entries(path):
        if entry.direction != "out" or not is_digested(topic_of(entry.key).pattern):
            continue
        running.add(entry.key, entry.step, entry.sequence, entry.sha256)
        if entry.payload is None:
            copy = received.get((entry.key, entry.step))
            if copy is None:
                unreceived += 1
            elif copy != entry.sha256:
                raise CheckError(
                    f"{path}: {actor} sent other bytes on {entry.key} in step {entry.step} than were received"
                )
    return running.digest(actor), unreceived


def _agrees(digest: ActorDigest, path: Path) -> bool:
    """True if the process's own final count says the same; False if it left none; else CheckError."""
    text = read_notes(path).get("final")
    if text is None:
        return False
    final = msgspec.json.decode(text, type=FinalNote)
    if final.digest != digest:
        raise CheckError(
            f"{path}: holds {digest.count} messages sent by {digest.actor} with hash {digest.sha256[:12]}; "
            f"the process itself counted {final.digest.count} with hash {final.digest.sha256[:12]}"
        )
    return True


def _compare_result(out: Path, report: CheckReport) -> None:
    result = out / "run.json"
    if not result.is_file():
        return
    claimed = msgspec.json.decode(result.read_bytes(), type=dict[str, msgspec.Raw]).get("digest")
    if claimed is None or msgspec.json.decode(claimed) != report.digest:
        raise CheckError(f"{result}: another digest than the recordings give, which is {report.digest}")
