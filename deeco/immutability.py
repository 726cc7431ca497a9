"""Which types knowledge may be made of: those whose values cannot change."""

import types
import typing
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Annotated, Any, Final, Literal, NewType, Union, get_args, get_origin, get_type_hints

_PLAIN: Final = (bool, int, float, str, bytes, types.NoneType)
_BARE_TUPLE: Final = typing.Tuple  # noqa: UP006  # what users of old may write
_ADVICE: Final = {
    list: "{name} can change behind everybody's back; write tuple[{item}, ...]",
    bytearray: "{name} can change behind everybody's back; write bytes",
    dict: "{name} can change behind everybody's back; write a tuple of pairs",
    set: "{name} can change, and its order differs from one process to the next; write a sorted tuple",
    frozenset: "the order of {name} differs from one process to the next; write a sorted tuple",
}


def fault(annotation: Any) -> str | None:
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
