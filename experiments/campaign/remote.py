"""One trial on another computer: what a worker of a cluster is asked to do."""

import subprocess
import sys
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.runtime.errors import AcrcError
from deploy.repository import REPOSITORY
from deploy.scratch import scratch_folder
from deploy.version import software
from experiments.study.study import Study

_TRIAL: Final = "experiments.campaign.trial_program"
_CHECK: Final = "experiments.campaign.check_program"


class OtherSoftwareError(AcrcError):
    """A worker whose results would not compare with the others'."""


class Order(NamedTuple):
    """Everything that a worker need know."""

    study: bytes
    """JSON of the study."""
    number: int
    """Of the trial."""
    before: bytes | None
    """JSON of the trial's record if it is to be repeated; None: it is to be run."""
    commit: str
    repository: str
    """Where the one who asks has this software: paths in it are meant in the worker's own."""
    patience_s: float
    modules: tuple[str, ...] = ()
    """Folders in which strategies of one's own are looked for: there, too."""


class Answer(NamedTuple):
    """What came of it."""

    record: bytes | None
    """JSON of the trial's record, or of its repetition's."""
    cause: str
    """Why there is none."""
    said: bytes
    """What the process said."""


def carry_out(order: Order) -> Answer:
    """Run the trial in a process of its own. Raises OtherSoftwareError if this is another commit."""
    here = software()
    if here != order.commit:
        raise OtherSoftwareError(f"a worker has {here}, this is {order.commit}; their results do not compare")
    with scratch_folder() as folder:
        study, before, out = folder / "study.json", folder / "before.json", folder / "record.json"
        study.write_bytes(_moved(order.study, order.repository))
        words = [str(study), str(order.number), str(out)]
        if order.before is not None:
            before.write_bytes(order.before)
            words.insert(2, str(before))
        words += [_here(folder, order.repository) for folder in order.modules]
        program = _TRIAL if order.before is None else _CHECK
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", program, *words],
                cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                timeout=order.patience_s, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            return Answer(None, f"took longer than {order.patience_s:g} s", error.stdout or b"")
        cause = f"its process ended with exit code {done.returncode} without a result"
        return Answer(out.read_bytes() if out.exists() else None, cause, done.stdout)


def _moved(study: bytes, repository: str) -> bytes:
    """The study, its files looked for in this clone if they lie in the clone of the one who asks."""
    known = msgspec.json.decode(study, type=Study)
    return msgspec.json.encode(msgspec.structs.replace(known, scenario=_here(known.scenario, repository)))


def _here(path: str, repository: str) -> str:
    if path and Path(path).is_relative_to(repository):
        return str(REPOSITORY / Path(path).relative_to(repository))
    return path
