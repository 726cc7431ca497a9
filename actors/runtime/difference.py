"""Where two messages of one kind differ first."""

from collections.abc import Sequence
from itertools import zip_longest
from typing import Final, NamedTuple

import msgspec


class _Absent:
    """Stands where the shorter of two sequences has ended."""

    def __repr__(self) -> str:
        return "absent"


_ABSENT: Final = _Absent()


class Difference(NamedTuple):
    """A field with two values."""

    field: str
    """Such as `Drive.route[2].place`."""
    one: object
    other: object


def first_difference(one: object, other: object, field: str = "") -> Difference | None:
    """The first field, in the order of the declaration, in which two values differ; None if none does.

    Of sequences that are not equally long it is the first element; what the shorter one lacks is `absent`.
    """
    field = field or type(one).__name__
    if isinstance(one, msgspec.Struct) and type(one) is type(other):
        parts = [
            (f"{field}.{name}", getattr(one, name), getattr(other, name)) for name in one.__struct_fields__
        ]
    elif isinstance(one, Sequence) and isinstance(other, Sequence) and not isinstance(one, str | bytes):
        pairs = list(zip_longest(one, other, fillvalue=_ABSENT))
        if len(one) != len(other):
            index = next(index for index, (a, b) in enumerate(pairs) if repr(a) != repr(b))
            return Difference(f"{field}[{index}]", *pairs[index])
        parts = [(f"{field}[{index}]", *pair) for index, pair in enumerate(pairs)]
    else:
        return None if repr(one) == repr(other) else Difference(field, one, other)  # -0.0 is not 0.0
    return next((found for name, a, b in parts if (found := first_difference(a, b, name))), None)
