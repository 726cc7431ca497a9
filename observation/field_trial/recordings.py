"""The recordings of a field trial: which files there are, whose they are, and what they tell."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.process import RunNote
from actors.runtime.recording import LARGE, Note, RecordingError, decoded, read_notes, read_recording
from observation.field_trial.robot_log import RobotIdentity, RobotLog, large_messages, read_log


class FieldTrialError(AcrcError):
    """Folders whose recordings do not make up one field trial."""


class _Base(msgspec.Struct, frozen=True):
    """What the first record of a robot's base says of it."""

    robot: str


class Punctuality(msgspec.Struct, frozen=True):
    """What a base has counted of its robot's steps."""

    lateness_ms: dict[int, int]
    """Steps by whole ms from a step's instant to the robot's answer."""
    overruns: int
    late_air: int


@dataclass
class FieldTrial:
    """Everything that was read."""

    logs: dict[str, list[RobotLog]]
    """By robot, r2 before r10; each robot's by epoch."""
    lateness_ms: dict[str, Counter[int]]
    """By robot: what its base has counted, over all starts of the base."""
    overruns: Counter[str]
    """By robot: steps that were left out."""
    notes: list[str] = field(default_factory=list)
    """What is wrong with the files, a sentence each."""

    def all_logs(self) -> Iterator[RobotLog]:
        """Every recording of a robot."""
        for logs in self.logs.values():
            yield from logs


def read_field_trial(folders: Sequence[Path]) -> FieldTrial:
    """Read every recording in the folders. Raises FieldTrialError if no robot's is among them.

    A folder is a robot's own, or holds such; with `r2` those of its base and bridge are read, which lie
    beside it as `r2.base` and `r2.radio`.
    """
    trial = FieldTrial({}, {}, Counter())
    own: list[tuple[Path, RobotIdentity]] = []
    others: list[tuple[Path, RunNote]] = []
    for path in _recordings(folders):
        run = _first_record(path, trial.notes)
        if run is None:
            continue
        identity = _identity(run)
        if identity is None:
            others.append((path, run))
        else:
            own.append((path, identity))
    if not own:
        damaged = f"; {trial.notes[0]}" if trial.notes else ""
        raise FieldTrialError(
            f"{', '.join(map(str, folders))}: no robot's recording in there, such as r2.mcap{damaged}"
        )
    _check_twice(own)
    kept: dict[bytes, bytes] = {}
    for path, run in others:
        kept |= large_messages(path, LARGE)
        _take_base(path, run, trial)
    for path, identity in sorted(own, key=lambda one: (natural(one[1].id), one[1].epoch)):
        log = read_log(path, identity, kept)
        trial.logs.setdefault(identity.id, []).append(log)
        trial.notes += _said_of(log)
    trial.notes += _strangers(trial)
    return trial


def natural(robot: str) -> tuple[tuple[int, int, str], ...]:
    """A key to sort ids by: numbers in them by their value."""
    parts = re.findall(r"\d+|\D+", robot)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts)


def _recordings(folders: Iterable[Path]) -> list[Path]:
    """Every recording once, in a fixed order."""
    found: dict[Path, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise FieldTrialError(
                f"{folder}: no such folder; it should be a robot's, or one that holds robots'"
            )
        own = sorted(folder.glob("*.mcap"))
        place = folder.absolute()
        beside = sorted(place.parent.glob(f"{_literal(place.name)}.*/*.mcap")) if own else []
        inside = sorted(folder.glob("*/*.mcap"))
        if not own and not inside:
            raise FieldTrialError(f"{folder}: no recording in it; there should be *.mcap or */*.mcap")
        for path in (*own, *inside, *beside):
            found.setdefault(Path(os.path.realpath(path)), path)
    return list(found.values())


def _literal(name: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", name)


def _first_record(path: Path, notes: list[str]) -> RunNote | None:
    """What a recording begins with; None, and a sentence in `notes`, if that is nothing of ours."""
    try:
        first = next(read_recording(path), None)
    except RecordingError as error:
        notes.append(str(error))
        return None
    if not isinstance(first, Note) or first.name != "run":
        notes.append(f"{path}: ends before its first record, or is no actor's recording; left out")
        return None
    try:
        return decoded(path, "run", first.json, RunNote)
    except RecordingError as error:
        notes.append(f"{error}; left out")
        return None


def _identity(run: RunNote) -> RobotIdentity | None:
    """Whose recording it is; None if it is no robot's."""
    try:
        return msgspec.json.decode(run.setup, type=RobotIdentity)
    except (ValueError, RecursionError):
        return None


def _check_twice(own: Sequence[tuple[Path, RobotIdentity]]) -> None:
    seen: dict[tuple[str, int], Path] = {}
    for path, identity in own:
        known = seen.setdefault((identity.id, identity.epoch), path)
        if known != path:
            raise FieldTrialError(
                f"{known} and {path}: both are recordings of {identity.id} in epoch {identity.epoch}; "
                "there should be one of each epoch, from one field trial"
            )


def _take_base(path: Path, run: RunNote, trial: FieldTrial) -> None:
    """Add what a robot's base has counted, if it is a base's recording with a last record."""
    if run.actor != "base":
        return
    try:
        robot = typed_json.decode(run.setup, _Base).robot
        final = read_notes(path).get("final")
        if final is None:
            trial.notes.append(f"{path}: has no last record, so the lateness that it counted is not known")
            return
        outcome = typed_json.decode(final, _Outcome).outcome
    except (AcrcError, ValueError) as error:
        trial.notes.append(f"{path}: its first or last record is not that of a base: {error}")
        return
    trial.lateness_ms.setdefault(robot, Counter()).update(outcome.lateness_ms)
    trial.overruns[robot] += outcome.overruns


class _Outcome(msgspec.Struct, frozen=True):
    """The part of a base's last record that is read."""

    outcome: Punctuality


def _strangers(trial: FieldTrial) -> Iterator[str]:
    """Whose recordings are missing."""
    known = {log.identity.address for log in trial.all_logs()}
    heard = Counter(frame.sender for log in trial.all_logs() for frame in log.heard)
    for sender in sorted(heard.keys() - known):
        yield (
            f"{heard[sender]} frames were heard of address {sender}, which is no robot's here: what it did "
            "and where it still meant to go is not known"
        )


def _said_of(log: RobotLog) -> Iterator[str]:
    """What is missing in a robot's recording."""
    if log.damage is not None:
        yield f"{log.damage}; what comes before is taken"
    elif log.failure is not None:
        yield f"{log.path}: {log.identity.id} failed in step {log.failure.step}: {log.failure.cause}"
    elif log.final is None:
        until = f"at step {log.ticks[-1].step}" if log.ticks else "before its first step"
        yield f"{log.path}: cut short {until}, without a last record, as by switching off"
    if log.hashed_drives:
        yield (
            f"{log.path}: {log.hashed_drives} answers are known by their hash only, and so what they say of "
            "places is not; the recording of the base or the world would hold them"
        )
    if log.hashed_transmits:
        yield (
            f"{log.path}: the frames of {log.hashed_transmits} messages are known by their hash only; the "
            "recording of the bridge or the radio would hold them"
        )
