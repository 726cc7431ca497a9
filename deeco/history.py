"""Histories: role fields in which each node collects the last values of another field, with their instants.

    @role
    class Room(Knowledge):
        celsius: float = 20.0
        recent: Annotated[Past[float], History("celsius", 10, seconds(60))] = ()

A history is not sent. The component's own node adds a value at each publication, its peers at each reception.
"""

from dataclasses import dataclass, fields
from typing import Annotated, Any, Final, TypeVar, get_origin

from deeco.errors import DefinitionError
from deeco.instant import Duration, Instant, check_duration
from deeco.knowledge import Knowledge, describe, replace, role_fields

T = TypeVar("T")
K = TypeVar("K", bound=Knowledge)
Past = tuple[tuple[Instant, T], ...]
"""Values, oldest first, each with the instant of its publication or, on a peer's node, its reception."""
_TAG: Final = "_deeco_histories"
MAX_SIZE: Final = 1000
"""Largest history: with 256 replicas, 256 000 values per field."""


@dataclass(frozen=True)
class History:
    """Annotation of a field that collects the last `size` values of the field `of`; its default is ().

    `max_age`: with each new value, older ones are dropped; None: no limit.
    """

    of: str
    size: int
    max_age: Duration | None = None

    def __post_init__(self) -> None:
        name = f"History({self.of!r})"
        if type(self.size) is not int or not 1 <= self.size <= MAX_SIZE:
            raise DefinitionError(f"{name}: size is {self.size!r}; must be an integer from 1 to {MAX_SIZE}")
        if self.max_age is not None:
            check_duration(f"{name}: max_age", self.max_age)

    def extended(self, past: Past[object], now: Instant, value: object) -> Past[object]:
        """Return the values with a new one, within both limits."""
        values = (*past, (now, value))[-self.size :]
        return tuple([one for one in values if self.max_age is None or now - one[0] <= self.max_age])


def histories(cls: type[Knowledge]) -> dict[str, History]:
    """Return the histories of a role or component by field, in the order of its fields."""
    found: dict[str, History] = getattr(cls, _TAG, {})
    return found


def published_fields(role: type[Knowledge]) -> tuple[str, ...]:
    """Return the fields of a role that are sent."""
    return tuple(name for name in role_fields(role) if name not in histories(role))


def add_histories(cls: type[Knowledge], hints: dict[str, Any]) -> None:
    """Store the histories among a class's annotated fields. Raises DefinitionError for an invalid one."""
    names = [field.name for field in fields(cls)]
    extras = {name: getattr(hints[name], "__metadata__", ()) for name in names}
    found = {name: one for name in names for one in extras[name] if isinstance(one, History)}
    setattr(cls, _TAG, found)
    for name, history in found.items():
        where = f"{cls.__name__}.{name}: History({history.of!r})"
        if history.of not in names or history.of in found:
            others = ", ".join(one for one in names if one not in found)
            raise DefinitionError(f"{where} needs another field of {cls.__name__}; use one of {others}")
        value = hints[history.of]
        value = value.__origin__ if get_origin(value) is Annotated else value
        if hints[name].__origin__ != Past[value]:  # type: ignore[valid-type]  # made at run time
            text = describe(value)
            raise DefinitionError(f"{where} collects values of type {text}; annotate it with Past[{text}]")


def with_history(value: K, before: Knowledge | None, now: Instant) -> K:
    """Return the knowledge with its present values added to the histories of `before`."""
    changes: dict[str, Any] = {}
    for name, history in histories(type(value)).items():
        changes[name] = history.extended(getattr(before, name, ()), now, getattr(value, history.of))
    return replace(value, **changes)
