"""Knowledge is a value: roles are what peers may know of a component, components add what stays with them."""

from dataclasses import dataclass, fields
from typing import Any, Final, get_type_hints

KIND: Final = "_deeco_kind"
"""The attribute by which `deeco.component` marks classes."""


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """What every role and component has."""

    id: str
    """Of the component; unique among all components that may ever hear of one another."""


def is_role(cls: type) -> bool:
    """True for a class with @role."""
    return vars(cls).get(KIND) == "role"


def is_component(cls: type) -> bool:
    """True for a class with @component."""
    return vars(cls).get(KIND) == "component"


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
