"""What a process has to say about the run in its last record, by subject: anything may stand there."""

from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, Final, TypeVar

import msgspec

from actors.runtime import typed_json
from actors.runtime.errors import AcrcError

T = TypeVar("T")
Outcomes = dict[str, dict[str, bool | int | float | str]]
"""Values that behaviours' `outcome()` returned, by name and robot."""
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
"""Of anything; also an instant, µs."""
Metres = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Name = Annotated[str, msgspec.Meta(max_length=200)]
Words = Annotated[str, msgspec.Meta(max_length=20_000)]
MOST_LISTED: Final = 10_000
"""Entries of a list that a process may leave; its own lists have a tenth at most."""
MOST_NAMES: Final = 500
"""Names that counts may have."""

_RESERVED: Final = frozenset({"adaptation", "deeco", "localisation", "navigation"})
"""Subjects of the robot and of the component model."""
_MOST_OWN, _LONGEST_NAME = 20, 100
"""Values in a behaviour's outcome, and characters of their names."""
_Own = bool | Annotated[int, msgspec.Meta(ge=-(1 << 53), le=1 << 53)] | float | Name | list[Any] | None
_OwnSubject = _Own | dict[str, _Own]


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


def own_outcome(record: Path, outcome: Mapping[str, msgspec.Raw]) -> dict[str, bool | int | float | str]:
    """Return the numbers, texts and booleans that a behaviour's `outcome()` returned, by name.

    A name within a dict follows that dict's name after a dot. Lists and null (also NaN, which JSON lacks)
    stay in the recording. Raises OutcomeError for what exceeds the bounds.
    """
    found: dict[str, Any] = {}
    for subject in sorted(outcome.keys() - _RESERVED):
        value: Any = told(record, outcome, subject, _OwnSubject, "a behaviour")  # type: ignore[arg-type]
        parts = {f".{name}": part for name, part in value.items()} if isinstance(value, dict) else {"": value}
        found |= {subject + name: part for name, part in parts.items() if not isinstance(part, list | None)}
    if len(found) > _MOST_OWN or max(map(len, found), default=0) > _LONGEST_NAME:
        raise OutcomeError(
            f"an outcome has {len(found)} values; must have at most {_MOST_OWN}, "
            f"with names of at most {_LONGEST_NAME} characters"
        )
    return found


def means(outcomes: Outcomes) -> dict[str, float]:
    """Return the mean of each name over the robots that gave a number for it; true counts as 1."""
    numbers = {
        name: [one for one in of.values() if not isinstance(one, str)] for name, of in outcomes.items()
    }
    return {name: fmean(values) for name, values in numbers.items() if values}
