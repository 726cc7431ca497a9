"""What is kept of a trial, whether it ran to its end or failed."""

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


def keep(path: Path, told: msgspec.Struct) -> None:
    """Write it as JSON into its file, which is there whole or not at all, also if the power fails."""
    new = path.with_suffix(".new")  # one process writes it, and a later one what that has left
    with new.open("wb") as file:
        file.write(msgspec.json.encode(told))
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)
