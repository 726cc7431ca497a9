"""What is kept of a trial, whether it ran to its end or failed."""

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
