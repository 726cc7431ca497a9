"""What a robot's adaptation has said of its decisions, in the last record of its process."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec

from observation.results.outcome import MOST_LISTED, Count, Metres, Name, Words, told

_SUBJECT: Final = "adaptation"


class SaidDecision(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A decision of a robot's adaptation, as it has told it; instants and ages in µs."""

    instant: Count
    by: Name
    words: Words
    source: Name
    age: Count
    old: tuple[Metres, Metres] | None
    new: tuple[Metres, Metres] | None


class SaidAdaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that one process said; instants in µs."""

    decisions: Annotated[tuple[SaidDecision, ...], msgspec.Meta(max_length=MOST_LISTED)]
    decisions_unlisted: Count
    blocked: Annotated[tuple[tuple[Count, Count | None], ...], msgspec.Meta(max_length=MOST_LISTED)] | None
    """Spells in which it held itself to be blocked; None if it never asks."""


def adaptation(record: Path, outcome: Mapping[str, msgspec.Raw]) -> SaidAdaptation | None:
    """What a process's last record says on it; None if nothing. Raises OutcomeError."""
    return told(record, outcome, _SUBJECT, SaidAdaptation, "a robot's adaptation")
