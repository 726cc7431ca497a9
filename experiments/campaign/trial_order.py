"""What the process of one trial is told, and how what it leaves is taken in."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from actors.runtime import typed_json
from actors.runtime.recording import RecordingError
from actors.runtime.recording.reading import opened
from deploy.run.options import Bus
from experiments.campaign.trial_record import TrialRecord
from experiments.study.study import Study, Trial

ORDER: Final = "order.json"
RECORD: Final = "record.json"
MOST_BYTES: Final = 64 << 20
"""Of a record; one of 600 s and eight robots has some 100 KB."""
MOST_SAID: Final = 1 << 20
"""Octets that are kept of what a trial's process has said: the last ones."""


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
        "",
        study.scenario,
        (trial.strategy,),
        0,
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
        return _failed(trial, f"its process has left no record of a trial: {str(error)[:200]}")
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
        with opened(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most and not end:
                return None
            stream.seek(max(size - most, 0))
            return stream.read(most)
    except (RecordingError, OSError):
        return None


def _failed(trial: Trial, cause: str) -> TrialRecord:
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), failure=cause)
