"""`replace` for knowledge: the same as that of dataclasses, in a fifth of its calls."""

import dataclasses
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

__all__ = ["is_plain", "replace"]

T = TypeVar("T")


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
    own, names = getattr(value, "__dict__", {}), _names(cls)
    if len(own) != len(names) or not changes.keys() <= names:  # it keeps more than its fields, or a mistake
        return dataclasses.replace(value, **changes)  # type: ignore[type-var]
    made: T = object.__new__(cls)
    made.__dict__.update(own, **changes)
    return made


if TYPE_CHECKING:  # so that types of fields are checked as there
    from dataclasses import replace
else:
    replace = _replace
