"""When each part of the knowledge that a change depended on had come about."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from actors.instant import in_seconds
from observation.trace.rows import KnowledgeChange

_CONSTANT: Final = "parameters"
_OFTEN: Final = 0.3
"""A point that changes more often than this, per second, is where the robot is, and not what it wants."""
_FEW: Final = 5
"""So many changes are not often."""

Changes = Sequence[KnowledgeChange]


class ChangeRun(NamedTuple):
    """A field of knowledge that one process or exchange has changed; a count, several times in a row."""

    field: str
    numbers: tuple[int, ...]
    """Those changes."""

    @property
    def last(self) -> int:
        """The newest of them."""
        return self.numbers[-1]


def runs(changes: Changes, number: int) -> list[ChangeRun]:
    """How each field that a change depended on had come to be what it was before, the newest first."""
    own = changes[number].own
    found = [
        run for field in own if field != _CONSTANT and (run := _last_run(changes, field, number)) is not None
    ]
    return sorted(found, key=lambda run: -run.last)


def is_routine(changes: Changes, number: int) -> bool:
    """True if whatever made a change changes something all the time."""
    by = changes[number].by
    return _is_frequent(changes, [other for other, one in enumerate(changes) if one.by == by])


def _last_run(changes: Changes, field: str, before: int) -> ChangeRun | None:
    """A field's last changes before a change; None if it never changed, or only says where the robot is."""
    numbers = list(_changes_of(changes, field, before))
    if not numbers:
        return None
    if changes[numbers[-1]].fields[field].is_place and _is_frequent(changes, numbers):
        return None
    return ChangeRun(field, tuple(_one_way(changes, field, numbers)))


def _one_way(changes: Changes, field: str, numbers: list[int]) -> list[int]:
    """The last change; of a count, those too by which it had gone the same way."""
    newest = numbers[-1]
    direction, found = changes[newest].fields[field].direction, [newest]
    for number in reversed(numbers[:-1]):
        same = changes[number].by == changes[newest].by
        if not direction or not same or changes[number].fields[field].direction != direction:
            break
        found.append(number)
    return found[::-1]


def _changes_of(changes: Changes, field: str, before: int) -> Iterator[int]:
    component = changes[before].component
    for number, change in enumerate(changes[:before]):
        if change.component == component and field in change.fields:
            yield number


def _is_frequent(changes: Changes, numbers: list[int]) -> bool:
    lasted = in_seconds(changes[-1].instant - changes[0].instant)
    return len(numbers) > max(_FEW, _OFTEN * lasted)
