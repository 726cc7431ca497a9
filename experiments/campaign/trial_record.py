"""What is kept of a trial, whether it ran to its end or failed, and of its repetition over the mesh."""

import os
from pathlib import Path
from typing import Any, Final

import msgspec

from observation.accounting.time_spent import TimeSpent
from observation.results.result import RunResult

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
