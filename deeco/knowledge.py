"""Knowledge is a value: roles are what peers may know of a component, components add what stays with them.

    @role
    class Vehicle(Knowledge):           # published
        position: float

    @component
    class Truck(Vehicle):               # what it adds is local
        fuel: float = 1.0

Both decorators make a frozen dataclass with keyword-only fields; `dataclasses.replace` makes the next value.
"""

from dataclasses import dataclass, fields
from typing import Any, TypeVar, dataclass_transform, get_type_hints

from deeco import immutability
from deeco.errors import DefinitionError
from deeco.process import processes_of, tag_of

_KIND = "_deeco_kind"
K = TypeVar("K", bound="Knowledge")


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """What every role and component has."""

    id: str
    """Of the component; unique among all components that may ever hear of one another."""


@dataclass_transform(frozen_default=True, kw_only_default=True)
def role(cls: type[K]) -> type[K]:
    """Make a class of Knowledge a role: all its fields are published, and peers see nothing else.

    Raises DefinitionError if a field's type can change, or if the class has processes.
    """
    made = _made(cls, "role")
    if parent := next((base for base in made.__mro__[1:] if is_component(base)), None):
        raise DefinitionError(
            f"role {made.__name__} builds on {parent.__name__}, which is a component; "
            "what peers may know must not contain what is local"
        )
    if process := next((name for name, value in vars(made).items() if tag_of(value)), None):
        raise DefinitionError(
            f"role {made.__name__} has the process {process}; processes belong to a component"
        )
    return made


@dataclass_transform(frozen_default=True, kw_only_default=True)
def component(cls: type[K]) -> type[K]:
    """Make a class of Knowledge a component: the fields it adds to its roles stay on its node.

    Raises DefinitionError if a field's type can change or if a process is not sound.
    """
    made = _made(cls, "component")
    if not roles_of(made):
        raise DefinitionError(
            f"component {made.__name__} plays no role; it should build on a class with @role"
        )
    processes_of(made)
    return made


def _made(cls: type[K], kind: str) -> type[K]:
    if not issubclass(cls, Knowledge):
        raise DefinitionError(
            f"{kind} {cls.__name__} does not build on Knowledge; "
            "it should, directly or by way of the roles that it plays"
        )
    made = dataclass(frozen=True, kw_only=True)(cls)
    try:
        hints = get_type_hints(made, localns={made.__name__: made}, include_extras=True)
    except NameError as error:
        raise DefinitionError(
            f"{kind} {made.__name__}: {error}; import or define the type before the class"
        ) from None
    for field in fields(made):
        if wrong := immutability.fault(hints[field.name]):
            raise DefinitionError(f"{made.__name__}.{field.name}: {wrong}")
    setattr(made, _KIND, kind)
    return made


def is_role(cls: type) -> bool:
    """True for a class with @role."""
    return vars(cls).get(_KIND) == "role"


def is_component(cls: type) -> bool:
    """True for a class with @component."""
    return vars(cls).get(_KIND) == "component"


def roles_of(cls: type) -> tuple[type[Knowledge], ...]:
    """The roles that a class plays, in the order of its bases, without those that another one contains."""
    roles = [base for base in cls.__mro__ if is_role(base)]
    return tuple(one for one in roles if not any(one in other.__mro__[1:] for other in roles))


def roles_under(kind: type[Knowledge]) -> tuple[type[Knowledge], ...]:
    """A role and all that build on it: who plays one of these plays it."""
    below = [one for sub in kind.__subclasses__() for one in roles_under(sub)]
    return tuple(dict.fromkeys([kind, *below] if is_role(kind) else below))


def seen_as(value: Knowledge, wanted: type[Knowledge]) -> Knowledge:
    """The knowledge of one role out of a component's: all that a peer may see."""
    return wanted(**{name: getattr(value, name) for name in published(wanted)})


def published(cls: type[Knowledge]) -> tuple[str, ...]:
    """Names of a role's fields, in their order."""
    return tuple(field.name for field in fields(cls))


def local_fields(cls: type[Knowledge]) -> tuple[str, ...]:
    """Names of the fields that a component adds to its roles."""
    shared = {name for one in roles_of(cls) for name in published(one)}
    return tuple(field.name for field in fields(cls) if field.name not in shared)


def type_of(cls: type[Knowledge], field: str) -> Any:
    """The annotated type of a field, with its extras."""
    return get_type_hints(cls, include_extras=True)[field]
