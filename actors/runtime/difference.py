"""Where two messages of one kind differ first."""

from collections.abc import Sequence
from typing import NamedTuple

import msgspec


class Difference(NamedTuple):
    """A field with two values."""

    field: str
    """Such as `Drive.route[2].place`; a length as `len(Drive.route)`."""
    one: object
    other: object


def first_difference(one: object, other: object, field: str = "") -> Difference | None:
    """The first field, in the order of the declaration, in which two values differ; None if none does."""
    field = field or type(one).__name__
    if isinstance(one, msgspec.Struct) and type(one) is type(other):
        parts = [
            (f"{field}.{name}", getattr(one, name), getattr(other, name)) for name in one.__struct_fields__
        ]
    elif isinstance(one, Sequence) and isinstance(other, Sequence) and not isinstance(one, str | bytes):
        if len(one) != len(other):
            return Difference(f"len({field})", len(one), len(other))
        parts = [(f"{field}[{index}]", *pair) for index, pair in enumerate(zip(one, other, strict=True))]
    else:
        return None if repr(one) == repr(other) else Difference(field, one, other)  # -0.0 is not 0.0
    return next((found for name, a, b in parts if (found := first_difference(a, b, name))), None)
