"""What a robot's adaptation has said of its decisions, in the last record of its process."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from deploy.results.outcome import told

_SUBJECT: Final = "adaptation"


class SaidDecision(msgspec.Struct, frozen=True):
    """A decision of a robot's adaptation, as it has told it; instants and ages in µs."""

    instant: int
    by: str
    words: str
    source: str
    age: int
    old: tuple[float, float] | None
    new: tuple[float, float] | None


class Adaptation(msgspec.Struct, frozen=True):
    """All that one process said; instants in µs."""

    decisions: tuple[SaidDecision, ...]
    decisions_unlisted: int
    blocked: tuple[tuple[int, int | None], ...] | None
    """Spells in which it held itself to be blocked; None if it never asks."""


def adaptation(record: Path, outcome: Mapping[str, msgspec.Raw]) -> Adaptation | None:
    """What a process's last record says on it; None if nothing. Raises OutcomeError."""
    return told(record, outcome, _SUBJECT, Adaptation, "a robot's adaptation")
