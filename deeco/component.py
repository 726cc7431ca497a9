"""Roles and components: classes of knowledge, of which peers see the roles, and processes use it all.

    @role
    class Vehicle(Knowledge):           # published
        position: float

    @component
    class Truck(Vehicle):               # what it adds is local
        fuel: float = 1.0

Both decorators make a frozen dataclass with keyword-only fields; `dataclasses.replace` makes the next value.
"""

from dataclasses import dataclass, fields
from typing import TypeVar, dataclass_transform, get_type_hints

from deeco import immutability
from deeco.errors import DefinitionError
from deeco.knowledge import KIND, Knowledge, is_component, roles_of
from deeco.process import processes_of, tag_of

K = TypeVar("K", bound=Knowledge)


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
    setattr(made, KIND, kind)
    return made
