"""Upon which knowledge a change depended, and when each part of that had come about."""

import inspect
from collections.abc import Iterator
from typing import Final, NamedTuple

from actors.geometry import Point, Pose
from actors.instant import in_seconds
from deeco.explain.anatomy import ensemble_type, method_flow, methods
from deeco.explain.dataflow import flow
from deeco.knowledge import Knowledge
from observation.evidence.knowledge_trace import KnowledgeChange
from observation.explanation.retold import Retold

_CONSTANT: Final = "parameters"
_OFTEN: Final = 0.3
"""A point that changes more often than this, per second, is where the robot is, and not what it wants."""

_FEW: Final = 5
"""So many changes are not often."""


class Dependence(NamedTuple):
    """What a process or an exchange reads."""

    own: tuple[str, ...]
    """Fields of the component's own."""
    peer: tuple[str, ...]
    """Fields of the peer, for an exchange."""


class ChangeRun(NamedTuple):
    """A field of knowledge that one process or exchange has changed; a count, several times in a row."""

    field: str
    numbers: tuple[int, ...]
    """Those changes."""

    @property
    def last(self) -> int:
        """The newest of them."""
        return self.numbers[-1]


def dependence(change: KnowledgeChange, ensembles: tuple[object, ...]) -> Dependence:
    """What is read, told from the source; nothing where the source does not say."""
    owner, _, name = change.by.rpartition(".")
    kind = type(change.after)
    if not change.peer and change.read is None:
        function = getattr(kind, name, None)
        if function is None:
            return Dependence((), ())
        own = next(iter(inspect.signature(function).parameters))
        return Dependence(flow(function, {own: kind}).read(own), ())
    for one in ensembles:
        described = ensemble_type(type(one))
        if described is not None and described.name == owner:
            return _of_exchange(type(one), name, kind)
    return Dependence((), ())


def _of_exchange(ensemble: type, name: str, kind: type[Knowledge]) -> Dependence:
    """Membership and exchange together: both had to agree."""
    described = ensemble_type(ensemble)
    assert described is not None
    local = name.removeprefix("at_")
    own: dict[str, None] = {}
    peer: dict[str, None] = {}
    for method in methods(described):
        if method.name not in ("membership", name):
            continue
        found = method_flow(ensemble, method, local, kind)
        other = next(side for side, _ in method.sides if side != local)
        own |= dict.fromkeys(found.read(local))
        peer |= dict.fromkeys(found.read(other))
    return Dependence(tuple(own), tuple(peer))


def runs(retold: Retold, number: int, fields: tuple[str, ...]) -> list[ChangeRun]:
    """How each of the fields had come to be what it was before a change, the newest first."""
    component = retold.trace.changes[number].component
    found = [
        run
        for field in fields
        if field != _CONSTANT and (run := last_run(retold, field, component, number)) is not None
    ]
    return sorted(found, key=lambda run: -run.last)


def last_run(retold: Retold, field: str, component: str, before: int) -> ChangeRun | None:
    """A field's last changes before a change; None if it never changed, or only says where the robot is."""
    numbers = list(_changes_of(retold, field, component, before))
    if not numbers:
        return None
    value = getattr(retold.trace.changes[numbers[-1]].after, field)
    if isinstance(value, Point | Pose) and _is_frequent(retold, numbers):
        return None
    return ChangeRun(field, tuple(_one_way(retold, field, numbers)))


def _one_way(retold: Retold, field: str, numbers: list[int]) -> list[int]:
    """The last change; of a count, those too by which it had gone the same way."""
    changes, newest = retold.trace.changes, numbers[-1]
    direction, found = _direction(retold, field, newest), [newest]
    for number in reversed(numbers[:-1]):
        same = changes[number].by == changes[newest].by
        if not direction or not same or _direction(retold, field, number) != direction:
            break
        found.append(number)
    return found[::-1]


def _direction(retold: Retold, field: str, number: int) -> int:
    """1: a change made it more; -1: less; 0: it was no number before."""
    before, after = getattr(retold.before(number), field), getattr(retold.trace.changes[number].after, field)
    if not isinstance(before, int) or not isinstance(after, int):
        return 0
    return (after > before) - (after < before)


def _changes_of(retold: Retold, field: str, component: str, before: int) -> Iterator[int]:
    for number, change in enumerate(retold.trace.changes[:before]):
        if change.component == component and any(root(one.path) == field for one in change.changed):
            yield number


def root(path: str) -> str:
    """The field of the component that a path begins with."""
    return path.partition(".")[0].partition("[")[0]


def is_routine(retold: Retold, number: int) -> bool:
    """True if whatever made a change changes something all the time."""
    by = retold.trace.changes[number].by
    return _is_frequent(retold, [other for other, one in enumerate(retold.trace.changes) if one.by == by])


def _is_frequent(retold: Retold, numbers: list[int]) -> bool:
    changes = retold.trace.changes
    lasted = in_seconds(changes[-1].instant - changes[0].instant)
    return len(numbers) > max(_FEW, _OFTEN * lasted)
