"""Values made often, in fewer calls: `replace` for knowledge, and `made` for named tuples."""

import dataclasses
from functools import cache
from typing import TYPE_CHECKING, Any, Final, TypeVar

__all__ = ["is_plain", "made", "replace"]

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
    from dataclasses import replace
else:
    replace = _replace
