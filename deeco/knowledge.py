"""Knowledge as immutable values: roles are visible to peers, components add local fields."""

import dataclasses
import inspect
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Final,
    Literal,
    NewType,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from deeco.errors import DefinitionError, ExecutionError

T = TypeVar("T")
Fact = Callable[[Any], object]
"""A method of a role or component without further parameters; a change of its value can trigger processes."""
new_tuple: Final = tuple.__new__
"""Create a named tuple from its class and values, without the overhead of its Python-level constructor."""


def has_generated_init(cls: type) -> bool:
    """Return whether a dataclass's constructor only sets its fields."""
    return (
        dataclasses.is_dataclass(cls)
        and cls.__dataclass_params__.init  # type: ignore[attr-defined]
        and getattr(vars(cls).get("__init__"), "__code__", None) is not None
        and vars(cls)["__init__"].__code__.co_filename == "<string>"  # generated, not the user's own
        and cls.__new__ is object.__new__
        and not hasattr(cls, "__post_init__")
        and not any("__slots__" in vars(base) for base in cls.__mro__[:-1])
        and all(field.init for field in dataclasses.fields(cls))
    )


@cache
def _names(cls: type) -> frozenset[str]:
    """Return the fields that `_replace` may set directly; none if the constructor does more."""
    return frozenset(field.name for field in dataclasses.fields(cls) if has_generated_init(cls))


def _replace(value: T, /, **changes: Any) -> T:
    """Return a copy of `value` with changed fields, as dataclasses.replace."""
    cls: Any = type(value)
    names = _names(cls)
    if not names or len(value.__dict__) != len(names) or not changes.keys() <= names:
        known = sorted(field.name for field in dataclasses.fields(cls))
        if unknown := sorted(changes.keys() - known):
            raise ExecutionError(
                f"replace: {cls.__name__} has no field {unknown[0]!r}; use one of {', '.join(known)}"
            )
        return dataclasses.replace(value, **changes)  # type: ignore[type-var]  # extra attributes
    made: T = object.__new__(cls)
    made.__dict__.update(value.__dict__, **changes)
    return made


if TYPE_CHECKING:  # so that types of fields are checked as there
    from dataclasses import replace as replace  # noqa: PLC0414  # re-exported
else:
    replace = _replace

_PLAIN: Final = (bool, int, float, str, bytes, types.NoneType)
_BARE_TUPLE: Final = typing.Tuple  # noqa: UP006  # old user code may contain it
_ADVICE: Final = {
    list: "{name} is mutable; write tuple[{item}, ...]",
    bytearray: "{name} is mutable; write bytes",
    dict: "{name} is mutable; write a tuple of pairs",
    set: "{name} is mutable, and its order differs between processes; write a sorted tuple",
    frozenset: "the order of {name} differs between processes; write a sorted tuple",
}


def immutability_fault(annotation: Any) -> str | None:
    """Return why knowledge cannot contain values of this type, with the remedy; None if it can.

    Valid are numbers, bool, str, bytes, None, Enum, Literal, tuple, NamedTuple, frozen dataclasses, frozen
    structs (msgspec) and unions of them, also inside NewType and Annotated.
    """
    return _fault(annotation, frozenset())


def _fault(annotation: Any, inside: frozenset[type]) -> str | None:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is None or annotation in _PLAIN or origin is Literal:
        return None
    if isinstance(annotation, NewType):
        return _fault(annotation.__supertype__, inside)
    if annotation is _BARE_TUPLE:
        return _class_fault(tuple, inside)
    if origin in {Union, types.UnionType, tuple, Annotated}:
        inner = arguments[:1] if origin is Annotated else arguments
        return _first_fault(tuple(item for item in inner if item is not Ellipsis), inside)
    if origin is None and isinstance(annotation, type):
        return _class_fault(annotation, inside)
    return _refusal(annotation, origin, arguments)


def _class_fault(cls: type, inside: frozenset[type]) -> str | None:
    if issubclass(cls, Enum) or cls in inside:
        return None
    inner = inside | {cls}
    if (issubclass(cls, tuple) and hasattr(cls, "_fields")) or is_frozen_struct(cls):
        return _first_fault(tuple(get_type_hints(cls, include_extras=True).values()), inner)
    if is_dataclass(cls):
        if not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]  # typeshed has no such field
            return f"{cls.__name__} is a mutable dataclass; write @dataclass(frozen=True)"
        hints = get_type_hints(cls, include_extras=True)
        return _first_fault(tuple(hints[field.name] for field in fields(cls)), inner)
    if cls is tuple:
        return "tuple has no item type; write for example tuple[float, ...]"
    return _refusal(cls, cls, ())


def struct_fields(cls: type) -> tuple[str, ...]:
    """Return the fields of a msgspec.Struct in order; none for any other class. Needs no msgspec."""
    return getattr(cls, "__struct_fields__", ())


def is_frozen_struct(cls: type) -> bool:
    """Return whether a class is a frozen msgspec.Struct."""
    config = getattr(cls, "__struct_config__", None)
    return config is not None and bool(config.frozen) and bool(struct_fields(cls))


def _first_fault(annotations: tuple[Any, ...], inside: frozenset[type]) -> str | None:
    return next((wrong for item in annotations if (wrong := _fault(item, inside))), None)


def _refusal(annotation: Any, origin: Any, arguments: tuple[Any, ...]) -> str:
    name = describe(annotation)
    if origin in _ADVICE:
        item = describe(arguments[0]) if arguments else "float"
        return _ADVICE[origin].format(name=name, item=item)
    if annotation in {Any, object}:
        return f"{name} does not restrict the value; use a specific type"
    return (
        f"{name} is not known to be immutable; "
        "use a number, a str, an Enum, a tuple or a frozen dataclass without type parameters"
    )


def describe(annotation: Any) -> str:
    """Return a type as written in source code."""
    if isinstance(annotation, type) and not get_args(annotation):
        return annotation.__name__
    return str(annotation).replace("typing.", "")


KIND: Final = "_deeco_kind"
"""Attribute by which `deeco.component` marks classes."""


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """Base class of all roles and components."""

    id: str
    """Id of the component; unique among all components that can ever exchange knowledge."""


def is_role(cls: type) -> bool:
    """Return whether a class has @role."""
    return vars(cls).get(KIND) == "role"


def is_component(cls: type) -> bool:
    """Return whether a class has @component."""
    return vars(cls).get(KIND) == "component"


def roles_of(cls: type) -> tuple[type[Knowledge], ...]:
    """Return the roles that a class plays, in the order of its bases, without bases of other roles."""
    roles = [base for base in cls.__mro__ if is_role(base)]
    return tuple(one for one in roles if not any(one in other.__mro__[1:] for other in roles))


def role_subclasses(kind: type[Knowledge]) -> tuple[type[Knowledge], ...]:
    """Return a role and all roles derived from it."""
    subclasses = [one for sub in kind.__subclasses__() for one in role_subclasses(sub)]
    return tuple(dict.fromkeys([kind, *subclasses] if is_role(kind) else subclasses))


def role_view(value: Knowledge, role: type[Knowledge]) -> Knowledge:
    """Return a component's knowledge reduced to one role."""
    return role(**{name: getattr(value, name) for name in role_fields(role)})


def role_fields(cls: type[Knowledge]) -> tuple[str, ...]:
    """Return the names of a role's fields in order."""
    return tuple(field.name for field in fields(cls))


def local_fields(cls: type[Knowledge]) -> tuple[str, ...]:
    """Return the names of the fields that a component adds to its roles."""
    shared = {name for one in roles_of(cls) for name in role_fields(one)}
    return tuple(field.name for field in fields(cls) if field.name not in shared)


def has_fact(cls: type, fact: Fact) -> bool:
    """Return whether a fact is a method of the class or of a base, overridden or not."""
    name = getattr(fact, "__name__", "")
    return any(vars(base).get(name) is fact for base in cls.__mro__)


def check_fact(cls: type, fact: Fact, use: str) -> None:
    """Raise DefinitionError, which begins with `use`, if the class has no such fact."""
    known = has_fact(cls, fact)
    if not known or len(inspect.signature(fact).parameters) > 1:
        fault = "has parameters" if known else f"is not a method of {cls.__name__} or its roles"
        raise DefinitionError(f"{use} {getattr(fact, '__qualname__', repr(fact))}, which {fault}")


def field_type(cls: type[Knowledge], field: str) -> Any:
    """Return the annotated type of a field, including Annotated metadata."""
    return get_type_hints(cls, include_extras=True)[field]
