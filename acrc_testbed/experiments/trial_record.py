"""Orders and records of trials, and traces of true poses."""

import hashlib
import os
import struct
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import asdict

from acrc_testbed.experiments.study import Study, Trial
from acrc_testbed.explanation.time_spent import TimeSpent
from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.recording_readers import messages_on
from actors.messages import TRUTH
from actors.runtime import typed_json
from actors.runtime.recording import RecordingError
from actors.runtime.recording.reader import open_recording
from actors.task.task import TaskDeclaration
from deploy.run.options import Bus

DIGITS: Final = 8
"""Hexadecimal digits per second; collision probability 2^-32."""


def pose_trace(out: Path) -> str:
    """Return a hash of DIGITS digits of all true poses for each whole simulated second of a run, from 0 on.

    Raises RecordingError for a damaged recording.
    """
    seconds: list[str] = []
    for _, truth in messages_on(recordings(out)["radio"], TRUTH):
        if truth.halt or truth.instant < len(seconds) * 1_000_000:
            continue
        poses = [value for robot in truth.robots for value in (robot.x, robot.y, robot.heading)]
        state = struct.pack(f"<{len(poses)}d", *poses)
        seconds.append(hashlib.blake2b(state, digest_size=DIGITS // 2).hexdigest())
    return "".join(seconds)


def identical_seconds(one: str, other: str) -> int:
    """Return the number of whole seconds in which two traces are identical from the start."""
    return len(os.path.commonprefix((one, other))) // DIGITS  # noqa: RUF071 (texts, not paths)


_MAX_LENGTH: Final = 60


class TrialRecord(msgspec.Struct, frozen=True):
    """Result of a trial, or the cause of its failure."""

    strategy: str
    seed: int
    variant: dict[str, Any]
    result: RunResult | None = None
    failure: str | None = None
    """Cause of failure; None: succeeded."""
    time: TimeSpent | None = None
    """Time by cause; None for a failed trial."""
    drawn: dict[str, Any] = {}
    """Values drawn from the study's distributions, as keys of the scenario for `acrc run --set KEY=VALUE`."""
    trace: str = ""
    """Hash of all true poses, eight hexadecimal digits per whole simulated second, from 0 on."""


class CheckRecord(msgspec.Struct, frozen=True):
    """Comparison of a trial in memory with its repetition as processes over Zenoh."""

    strategy: str
    seed: int
    variant: dict[str, Any]
    in_memory: str
    """Digest."""
    in_memory_speed: float
    """Simulated seconds per second, under the machine's load."""
    over_zenoh: str = ""
    """Digest; empty if the repetition failed."""
    over_zenoh_speed: float | None = None
    failure: str | None = None
    """Cause of the repetition's failure; None: succeeded."""
    differs: tuple[str, ...] = ()
    """Other differences, such as "contacts 4 in memory, 1 over Zenoh"."""
    isolation: str = ""
    """Isolation of robots in the repetition, as in its result."""

    @property
    def agrees(self) -> bool:
        """True if digest and all other results are equal."""
        return self.in_memory == self.over_zenoh and not self.differs


_NOT_COMPARED: Final = frozenset(
    {
        "digest", "wall_s", "startup_s", "cpu_s", "real_time_factor", "isolation", "bus", "out", "processor",
        "task",
    }
)  # fmt: skip
"""Fields of a result that are not compared: execution details, and the digest, compared
separately, like the values of the task."""


def compare_repetition(before: TrialRecord, again: TrialRecord) -> CheckRecord:
    """Compare a successful trial in memory with its repetition as processes.

    Compares all results, not only digests: a strategy that manipulates the referee in memory changes no
    message.
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
        f"{name} {_abbreviated(mine)} in memory, {_abbreviated(theirs)} over Zenoh"
        for one, other, without in (
            (_values(first), _values(second), _NOT_COMPARED),
            (asdict(before), asdict(again), {"result", "failure"}),
        )
        for name, mine in one.items()
        if name not in without and mine != (theirs := other.get(name))
    ]
    return msgspec.structs.replace(
        here,
        over_zenoh=second.digest,
        over_zenoh_speed=second.real_time_factor,
        differs=tuple(differs),
        isolation=second.isolation,
    )


def _values(result: RunResult) -> dict[str, object]:
    """Return all fields of a result and the values of the task."""
    return {**result.task, **asdict(result)}


def _abbreviated(value: object) -> str:
    """Return a value as JSON, abbreviated to a line."""
    text = msgspec.json.encode(value).decode()
    return text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH]}…"


def write_json(path: Path, content: msgspec.Struct) -> None:
    """Write a struct as JSON, atomically and durably."""
    write_durably(path, msgspec.json.encode(content))


def write_durably(path: Path, content: bytes) -> None:
    """Write a file atomically and durably."""
    new = path.with_suffix(".new")  # there is a single writer; this may be left from a crash
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


ORDER_FILE: Final = "order.json"
RECORD_FILE: Final = "record.json"
MAX_BYTES: Final = 64 << 20
"""Upper limit of a record, octets; 600 s with eight robots take about 100 KB."""
MAX_OUTPUT: Final = 1 << 20
"""Octets kept of a trial's output, from its end."""


TRIAL_MODULE: Final = "acrc_testbed.experiments.trial_program"


class TrialOutcome(NamedTuple):
    """Files left by a trial's process, not yet validated."""

    record: bytes | None
    """Trial's record as JSON; None: no record."""
    cause: str
    """Reason if there is no record."""
    output: bytes
    """End of the process's output."""
    refusal: str = ""
    """Reason why this computer cannot run trials of the campaign; empty: it can."""


class CodeFolders(NamedTuple):
    """Folders from which trials load user code, permitted by `actors.robot.behaviour.code_permit`."""

    strategies: tuple[Path, ...] = ()
    metrics: tuple[Path, ...] = ()
    tasks: tuple[Path, ...] = ()
    """Named on the command line."""


NO_CODE: Final = CodeFolders()


class TrialOrder(msgspec.Struct, frozen=True):
    """Order for one trial, without information on its study."""

    study: Study
    """Scenario, settings, distributions, conditions and own metrics; no name, seeds or other strategies."""
    trial: Trial
    bus: Bus = "memory"
    isolate: bool | None = None
    """As in `RunOptions`."""
    modules: tuple[str, ...] = ()
    """Folders of user strategies."""
    metric_modules: tuple[str, ...] = ()
    """Folders of the functions of the study's own metrics."""
    task_modules: tuple[str, ...] = ()
    """Folders of the user's tasks."""


def make_order(study: Study, trial: Trial, folders: CodeFolders, *, repeated: bool) -> TrialOrder:
    """Return the order for a trial. `repeated`: repeat it as processes."""
    alone = Study(
        name="",
        task=study.task,
        scenario=study.scenario,
        strategies=(trial.strategy,),
        seeds=0,
        settings=study.settings_of(trial.variant),
        distributions=study.distributions,
        conditions=study.conditions,
        metric=study.metric,
    )
    processes = repeated or study.isolated
    return TrialOrder(
        alone,
        Trial(trial.strategy, trial.seed),
        "zenoh" if processes else "memory",
        True if study.isolated else None,
        *(tuple(map(str, paths)) for paths in folders),
    )


def validated_record(content: bytes | None, trial: Trial, task: TaskDeclaration, cause: str) -> TrialRecord:
    """Return the validated record of a trial; its content is untrusted, as a strategy may have written it.

    An invalid record or one of another trial or task is a failure; without a record, `cause` is the failure.
    """
    if content is None:
        return _failed_record(trial, cause)
    try:
        record = typed_json.decode(content, TrialRecord)
    except ValueError as error:
        return _failed_record(trial, f"its process left an invalid record: {str(error)[:200]}")
    if len(content) > MAX_BYTES or (record.result is not None and record.result.seed != trial.seed):
        return _failed_record(trial, "its process left the record of another trial")
    if record.result is not None and record.result.declaration != task:
        return _failed_record(trial, f"its run had another task than {task.name}, or another version of it")
    if (record.result is None) == (record.failure is None):
        return _failed_record(trial, "its process left an invalid record: must have either result or failure")
    return msgspec.structs.replace(
        record, strategy=trial.strategy, seed=trial.seed, variant=dict(trial.variant)
    )


def read_output(file: Path, most: int, *, end: bool = False) -> bytes | None:
    """Read a file of a trial's process, at most `most` octets; with `end` the last ones.

    None for a missing, irregular or larger file. Does not block or follow links.
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


def read_outcome(folder: Path, cause: str) -> TrialOutcome:
    """Return the files left by a trial's process in its folder."""
    output = read_output(folder / "trial.log", MAX_OUTPUT, end=True)
    return TrialOutcome(read_output(folder / RECORD_FILE, MAX_BYTES), cause, output or b"")


def _failed_record(trial: Trial, cause: str) -> TrialRecord:
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), failure=cause)
