"""Trials of a campaign: the order to a process, the record of its result, and the trace of true poses."""

import hashlib
import os
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from acrc_testbed.experiments.study import Study, Trial
from acrc_testbed.explanation.time_spent import TimeSpent
from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.recording_readers import messages_on
from actors.messages import TRUTH
from actors.runtime import typed_json
from actors.runtime.recording import RecordingError
from actors.runtime.recording.reader import open_recording
from deploy.run.options import Bus

DIGITS: Final = 8
"""Hexadecimal digits of each second: two states look alike once in 4 000 million."""


def trace(out: Path) -> str:
    """DIGITS for each whole simulated second of the run in the folder `out`, from 0 on.

    Raises RecordingError for a damaged one.
    """
    seconds: list[str] = []
    for _, truth in messages_on(recordings(out)["radio"], TRUTH):
        if truth.halt or truth.instant < len(seconds) * 1_000_000:
            continue
        poses = [value for robot in truth.robots for value in (robot.x, robot.y, robot.heading)]
        state = struct.pack(f"<{len(poses)}d", *poses)
        seconds.append(hashlib.blake2b(state, digest_size=DIGITS // 2).hexdigest())
    return "".join(seconds)


def coincide_s(one: str, other: str) -> int:
    """How many whole seconds two traces have in common from the beginning on."""
    pairs = zip(_by_second(one), _by_second(other), strict=False)
    for number, (mine, theirs) in enumerate(pairs):
        if mine != theirs:
            return number
    return min(len(one), len(other)) // DIGITS


def _by_second(trace: str) -> list[str]:
    return [trace[at_ : at_ + DIGITS] for at_ in range(0, len(trace), DIGITS)]


_MOST_TOLD: Final = 60


class TrialRecord(msgspec.Struct, frozen=True):
    """One trial: its result, or the cause for which there is none."""

    strategy: str
    seed: int
    variant: dict[str, Any]
    result: RunResult | None = None
    failure: str | None = None
    """One sentence."""
    time: TimeSpent | None = None
    """Where the time went; None of a trial that failed."""
    drawn: dict[str, Any] = {}
    """What the study's distributions came to for this seed and variant: keys of the scenario, as for
    `acrc run --set KEY=VALUE`."""
    trace: str = ""
    """Eight hexadecimal digits for each whole simulated second, from 0 on: where all robots truly were."""


class CheckRecord(msgspec.Struct, frozen=True):
    """One trial repeated as real processes over Zenoh."""

    strategy: str
    seed: int
    variant: dict[str, Any]
    in_memory: str
    """Digest."""
    in_memory_speed: float
    """Simulated seconds per second, beside what else the machine did."""
    over_zenoh: str = ""
    """Digest; empty if the repetition failed."""
    over_zenoh_speed: float | None = None
    failure: str | None = None
    """Why the repetition came to no end, one sentence."""
    differs: tuple[str, ...] = ()
    """What else of the record is not the same, such as "places_done 40 in memory, 12 there"."""
    isolation: str = ""
    """How robots were shut off in the repetition, as in its result."""

    @property
    def agrees(self) -> bool:
        """True if the repetition gave the same digest, and the same of all that the record says."""
        return self.in_memory == self.over_zenoh and not self.differs


_HOW: Final = frozenset(
    {
        "digest", "wall_s", "startup_s", "cpu_s", "real_time_factor", "isolation", "bus", "out", "processor",
    }
)  # fmt: skip
"""Of a result: what says how it was made, not what came of it; and the digest, which is compared alone."""


def compared(before: TrialRecord, again: TrialRecord) -> CheckRecord:
    """A trial in memory, which has a result, beside its repetition as processes.

    Everything that came of the two is compared: a digest is of messages, and a strategy that changes the
    referee's mind sends none.
    """
    first, second = before.result, again.result
    assert first is not None
    here = CheckRecord(
        before.strategy, before.seed, before.variant, first.digest, first.real_time_factor,
        failure=again.failure,
    )  # fmt: skip
    if second is None:
        return here
    differs = [
        f"{name} {_brief(mine)} in memory, {_brief(theirs)} there"
        for one, other, without in ((first, second, _HOW), (before, again, {"result", "failure"}))
        for name in one.__struct_fields__
        if name not in without and (mine := getattr(one, name)) != (theirs := getattr(other, name))
    ]
    return msgspec.structs.replace(
        here,
        over_zenoh=second.digest,
        over_zenoh_speed=second.real_time_factor,
        differs=tuple(differs),
        isolation=second.isolation,
    )


def _brief(value: object) -> str:
    """As far as a line can take it."""
    text = msgspec.json.encode(value).decode()
    return text if len(text) <= _MOST_TOLD else f"{text[:_MOST_TOLD]}…"


def keep(path: Path, told: msgspec.Struct) -> None:
    """Write it as JSON into its file, which is there whole or not at all, also if the power fails."""
    keep_bytes(path, msgspec.json.encode(told))


def keep_bytes(path: Path, content: bytes) -> None:
    """The same of what is encoded already."""
    new = path.with_suffix(".new")  # one process writes it, and a later one removes what that has left
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


ORDER: Final = "order.json"
RECORD: Final = "record.json"
MOST_BYTES: Final = 64 << 20
"""Of a record; one of 600 s and eight robots has some 100 KB."""
MOST_SAID: Final = 1 << 20
"""Octets that are kept of what a trial's process has said: the last ones."""


TRIAL: Final = "acrc_testbed.experiments.trial_program"


class TrialOutcome(NamedTuple):
    """Files that a trial's process left; not checked yet."""

    record: bytes | None
    """JSON of the trial's record; None: there is none."""
    cause: str
    """Why there may be no record."""
    said: bytes
    """End of the process's output."""
    refusal: str = ""
    """Why this computer runs no trial of the campaign; empty if it does."""


class TrialOrder(msgspec.Struct, frozen=True):
    """One trial by itself, with nothing in it that tells where it stands in its study."""

    study: Study
    """Scenario, settings, distributions and conditions; without name, seeds and other strategies."""
    trial: Trial
    bus: Bus = "memory"
    isolate: bool | None = None
    """As in `RunOptions`."""
    modules: tuple[str, ...] = ()
    """Folders in which strategies of one's own are looked for."""


def order_of(study: Study, trial: Trial, modules: Sequence[Path], *, repeated: bool) -> TrialOrder:
    """What a trial's process is told. `repeated`: once more, as processes."""
    alone = Study(
        name="",
        scenario=study.scenario,
        strategies=(trial.strategy,),
        seeds=0,
        settings=study.settings_of(trial.variant),
        distributions=study.distributions,
        conditions=study.conditions,
    )
    processes = repeated or study.isolated
    return TrialOrder(
        alone,
        Trial(trial.strategy, trial.seed),
        "zenoh" if processes else "memory",
        True if study.isolated else None,
        tuple(map(str, modules)),
    )


def received(content: bytes | None, trial: Trial, cause: str) -> TrialRecord:
    """The trial's record from what its process has left, which a strategy may have written.

    What is no such record, or of another trial, is a failure, and so is none; then `cause` says why.
    """
    if content is None:
        return _failed(trial, cause)
    try:
        told = typed_json.decode(content, TrialRecord)
    except ValueError as error:
        return _failed(trial, f"its process wrote no valid record of a trial: {str(error)[:200]}")
    if len(content) > MOST_BYTES or (told.result is not None and told.result.seed != trial.seed):
        return _failed(trial, "its process has left the record of another trial")
    if (told.result is None) == (told.failure is None):
        return _failed(trial, "its process has left a record with neither result nor failure, or with both")
    return msgspec.structs.replace(
        told, strategy=trial.strategy, seed=trial.seed, variant=dict(trial.variant)
    )


def left(file: Path, most: int, *, end: bool = False) -> bytes | None:
    """What lies in a file of a trial's process: so many octets at most, or with `end` the last ones.

    None for what is no file, or larger. Nothing is waited for, and no link is followed.
    """
    try:
        with open_recording(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most and not end:
                return None
            stream.seek(max(size - most, 0))
            return stream.read(most)
    except (RecordingError, OSError):
        return None


def outcome_in(folder: Path, cause: str) -> TrialOutcome:
    """Return what a trial's process left in its folder."""
    said = left(folder / "trial.log", MOST_SAID, end=True)
    return TrialOutcome(left(folder / RECORD, MOST_BYTES), cause, said or b"")


def _failed(trial: Trial, cause: str) -> TrialRecord:
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), failure=cause)
