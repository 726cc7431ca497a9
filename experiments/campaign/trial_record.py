"""What is kept of a trial, whether it ran to its end or failed."""

import os
from pathlib import Path
from typing import Any

import msgspec

from deploy.results.result import RunResult


class TrialRecord(msgspec.Struct, frozen=True):
    """One trial: its result, or the cause for which there is none."""

    strategy: str
    seed: int
    variant: dict[str, Any]
    result: RunResult | None = None
    failure: str | None = None
    """One sentence."""
    verified: bool | None = None
    """Whether real processes over Zenoh gave the same digest; None: they were not asked."""


def keep(path: Path, record: TrialRecord) -> None:
    """The record in its file, whole or not at all, also if the power fails."""
    new = path.with_suffix(f".{os.getpid()}")
    with new.open("wb") as file:
        file.write(msgspec.json.encode(record))
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)
