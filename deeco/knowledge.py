"""Knowledge is a value: roles are what peers may know of a component, components add what stays with them."""

import dataclasses
import types
import typing
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

T = TypeVar("T")
made: Final = tuple.__new__
"""A named tuple of its class and all its values; its own call is one of a function in Python."""


def is_plain(cls: type) -> bool:
    """True for a dataclass whose making does nothing but set its fields: then they can be set at once."""
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
    """Of the fields that may be set at once: none of a class whose making does more."""
    return frozenset(field.name for field in dataclasses.fields(cls) if is_plain(cls))


def _replace(value: T, /, **changes: Any) -> T:
    """`value` with other values for some of its fields, as dataclasses.replace has it."""
    cls: Any = type(value)
    names = _names(cls)
    if not names or len(value.__dict__) != len(names) or not changes.keys() <= names:
        return dataclasses.replace(value, **changes)  # type: ignore[type-var]  # it keeps more, or a mistake
    made: T = object.__new__(cls)
    made.__dict__.update(value.__dict__, **changes)
    return made


if TYPE_CHECKING:  # so that types of fields are checked as there
    from dataclasses import replace as replace  # noqa: PLC0414  # re-exported
else:
    replace = _replace

_PLAIN: Final = (bool, int, float, str, bytes, types.NoneType)
_BARE_TUPLE: Final = typing.Tuple  # noqa: UP006  # what users of old may write
_ADVICE: Final = {
    list: "{name} can change behind everybody's back; write tuple[{item}, ...]",
    bytearray: "{name} can change behind everybody's back; write bytes",
    dict: "{name} can change behind everybody's back; write a tuple of pairs",
    set: "{name} can change, and its order differs from one process to the next; write a sorted tuple",
    frozenset: "the order of {name} differs from one process to the next; write a sorted tuple",
}


def immutability_fault(annotation: Any) -> str | None:
    """Why values of the type `annotation` may not stand in knowledge, with the remedy; None if they may.

    Allowed are numbers, bool, str, bytes, None, Enum, Literal, tuple, NamedTuple, frozen dataclasses, frozen
    structs (msgspec), and unions of them, with NewType and Annotated looked through.
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
        return _first(tuple(item for item in inner if item is not Ellipsis), inside)
    if origin is None and isinstance(annotation, type):
        return _class_fault(annotation, inside)
    return _refusal(annotation, origin, arguments)


def _class_fault(cls: type, inside: frozenset[type]) -> str | None:
    if issubclass(cls, Enum) or cls in inside:
        return None
    inner = inside | {cls}
    if (issubclass(cls, tuple) and hasattr(cls, "_fields")) or is_frozen_struct(cls):
        return _first(tuple(get_type_hints(cls, include_extras=True).values()), inner)
    if is_dataclass(cls):
        if not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]  # typeshed has no such field
            return f"{cls.__name__} is a dataclass that can change; write @dataclass(frozen=True)"
        hints = get_type_hints(cls, include_extras=True)
        return _first(tuple(hints[field.name] for field in fields(cls)), inner)
    if cls is tuple:
        return "tuple does not say what is in it; write for example tuple[float, ...]"
    return _refusal(cls, cls, ())


def struct_fields(cls: type) -> tuple[str, ...]:
    """The fields of a struct (msgspec), in their order, told by its looks; none of any other class."""
    return getattr(cls, "__struct_fields__", ())


def is_frozen_struct(cls: type) -> bool:
    """True for a msgspec.Struct whose values cannot change."""
    config = getattr(cls, "__struct_config__", None)
    return config is not None and bool(config.frozen) and bool(struct_fields(cls))


def _first(annotations: tuple[Any, ...], inside: frozenset[type]) -> str | None:
    return next((wrong for item in annotations if (wrong := _fault(item, inside))), None)


def _refusal(annotation: Any, origin: Any, arguments: tuple[Any, ...]) -> str:
    name = describe(annotation)
    if origin in _ADVICE:
        item = describe(arguments[0]) if arguments else "float"
        return _ADVICE[origin].format(name=name, item=item)
    if annotation in {Any, object}:
        return f"{name} says nothing about what is in it; name the type"
    return (
        f"{name} is not among the types whose values are known never to change; "
        "use a number, a str, an Enum, a tuple or a frozen dataclass without type parameters"
    )


def describe(annotation: Any) -> str:
    """A type as one would write it."""
    if isinstance(annotation, type) and not get_args(annotation):
        return annotation.__name__
    return str(annotation).replace("typing.", "")


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
