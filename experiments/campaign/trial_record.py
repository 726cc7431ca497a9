"""What is kept of a trial, whether it ran to its end or failed, and of its repetition over the mesh."""

import os
from pathlib import Path
from typing import Any

import msgspec

from deploy.results.result import RunResult
from experiments.accounting.time_spent import TimeSpent


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

    @property
    def agrees(self) -> bool:
        """True if the repetition gave the same digest."""
        return self.in_memory == self.over_zenoh


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
