"""What a process has to say about the run in its last record, by subject: anything may stand there."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, TypeVar

import msgspec

from actors.runtime import typed_json
from actors.runtime.errors import AcrcError

T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
"""Of anything; also an instant, µs."""
Metres = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Name = Annotated[str, msgspec.Meta(max_length=200)]
Words = Annotated[str, msgspec.Meta(max_length=20_000)]
MOST_LISTED: Final = 10_000
"""Entries of a list that a process may leave; its own lists have a tenth at most."""
MOST_NAMES: Final = 500
"""Names that counts may have."""


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
        return typed_json.decode(outcome[subject], kind)
    except ValueError as error:
        raise OutcomeError(f"{record}: the outcome {subject!r} is not that of {whose}: {error}") from None
