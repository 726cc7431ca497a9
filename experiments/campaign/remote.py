"""One trial on another computer: what a worker of a cluster is asked to do."""

import subprocess
import sys
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.installation.repository import REPOSITORY
from actors.installation.version import software
from actors.processes.scratch import scratch_folder
from actors.runtime.errors import printable
from actors.runtime.isolation import sandbox
from experiments.campaign.pool import TRIAL
from experiments.campaign.trial_order import MOST_BYTES, MOST_SAID, ORDER, RECORD, TrialOrder, left

_MOST_WORDS: Final = 500


class Errand(NamedTuple):
    """Everything that a worker need know."""

    order: bytes
    """JSON of the trial's order."""
    commit: str
    repository: str
    """Where the one who asks has this software: paths in it are meant in the worker's own."""
    patience_s: float


class RemoteOutcome(NamedTuple):
    """What came of it."""

    record: bytes | None
    """JSON of the trial's record, or of its repetition's."""
    cause: str
    """Why there is none."""
    said: bytes
    """What the process said."""
    refusal: str = ""
    """Why this worker runs no trial of the campaign; empty if it does."""


def carry_out(errand: Errand) -> RemoteOutcome:
    """Run the trial in a process of its own, or say why not."""
    here = software()
    if here != errand.commit:
        return _refused(f"a worker has {here}, this is {errand.commit}; their results do not compare")
    order = _moved(errand)
    reason = sandbox.available() if order.isolate else None
    if reason is not None:
        return _refused(f"a worker cannot isolate robots, as the study wants: {reason}")
    with scratch_folder() as folder:
        (folder / ORDER).write_bytes(msgspec.json.encode(order))
        cause = ""
        with (folder / "trial.log").open("wb") as log:
            try:
                done = subprocess.run(
                    [sys.executable, "-P", "-m", TRIAL, str(folder)],
                    cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                    timeout=errand.patience_s, check=False,
                )  # fmt: skip
                cause = f"its process ended with exit code {done.returncode} without a result"
            except subprocess.TimeoutExpired:
                cause = f"took longer than {errand.patience_s:g} s"
        record, said = left(folder / RECORD, MOST_BYTES), left(folder / "trial.log", MOST_SAID, end=True)
        return RemoteOutcome(record, cause, said or b"")


def _refused(why: str) -> RemoteOutcome:
    return RemoteOutcome(None, "", b"", why)


def checked(answer: object) -> RemoteOutcome:
    """What a worker has answered, if it is an answer at all; its record is not looked into here."""
    if not isinstance(answer, RemoteOutcome):
        return RemoteOutcome(None, "a worker has answered something else", b"")
    kinds = (bytes | None, str, bytes, str)
    if not all(isinstance(part, kind) for part, kind in zip(answer, kinds, strict=True)):
        return RemoteOutcome(None, "a worker has answered something else", b"")
    record, cause, said, refusal = answer
    if record is not None and len(record) > MOST_BYTES:
        return RemoteOutcome(None, f"a worker has answered more than {MOST_BYTES} octets", b"")
    return RemoteOutcome(
        record, printable(cause[:_MOST_WORDS]), said[-MOST_SAID:], printable(refusal[:_MOST_WORDS])
    )


def _moved(errand: Errand) -> TrialOrder:
    """The order, its files looked for in this clone if they lie in the clone of the one who asks."""
    order = msgspec.json.decode(errand.order, type=TrialOrder)
    scenario, *modules = (_here(path, errand.repository) for path in (order.study.scenario, *order.modules))
    study = msgspec.structs.replace(order.study, scenario=scenario)
    return msgspec.structs.replace(order, study=study, modules=tuple(modules))


def _here(path: str, repository: str) -> str:
    if path and Path(path).is_relative_to(repository):
        return str(REPOSITORY / Path(path).relative_to(repository))
    return path
