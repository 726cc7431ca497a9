"""What a process has to say about the run in its last record, by subject: anything may stand there."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import msgspec

from actors.runtime.errors import AcrcError

T = TypeVar("T")


class OutcomeError(AcrcError):
    """A subject that does not hold what it should."""


def told(
    record: Path, outcome: Mapping[str, msgspec.Raw], subject: str, kind: type[T], whose: str
) -> T | None:
    """What the last record of the file `record` says on a subject; None if nothing. Raises OutcomeError.

    `whose`: what it should be the outcome of, for the sentence.
    """
    if subject not in outcome:
        return None
    try:
        return msgspec.json.decode(outcome[subject], type=kind)
    except (ValueError, RecursionError) as error:
        raise OutcomeError(f"{record}: the outcome {subject!r} is not that of {whose}: {error}") from None
