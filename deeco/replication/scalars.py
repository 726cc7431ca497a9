"""How single values travel: numbers, text, bytes, None, members of an Enum and of a Literal.

Packing refuses what cannot travel; unpacking takes nothing for granted.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from types import NoneType
from typing import Any, Final, NoReturn

from deeco.errors import DefinitionError

_LEAST: Final = -(2**63)
_MOST: Final = 2**64 - 1
"""With _LEAST: what msgpack has for whole numbers."""


class Junk(Exception):  # noqa: N818  # never seen by a user
    """Received data that are not of the form they should have."""


class Unfit(Exception):  # noqa: N818  # never seen by a user
    """A value that cannot travel: what is wrong with it, and what would have been right."""


@dataclass(frozen=True)
class Resolution:
    """Have the floats of a field travel as whole numbers of 1/`per_unit`, which takes 1 to 5 bytes, not 9.

        position: Annotated[Point, Resolution(1000)]        # to the millimetre

    Holds for every float inside of the annotated type; the innermost Resolution counts. A float x arrives as
    round(x * per_unit) / per_unit: one that is given to that resolution arrives as it is. Raises
    DefinitionError if `per_unit` is no whole number above 0.
    """

    per_unit: int

    def __post_init__(self) -> None:
        if type(self.per_unit) is not int or self.per_unit < 1:
            raise DefinitionError(
                f"Resolution({self.per_unit!r}): per_unit should be a whole number of at least 1, "
                "such as 1000 for millimetres"
            )


@dataclass(frozen=True)
class Form:
    """How the values of one type travel."""

    says: str
    """The form in words; two types with the same are packed alike."""
    kinds: frozenset[type]
    """Classes of the values it is made for."""
    pack: Callable[[Any], Any]
    """Value to what msgpack takes. Raises Unfit."""
    unpack: Callable[[Any], Any]
    """The way back. Raises Junk, and nothing else, for anything that no `pack` gives."""
    depth: int = 0
    """Arrays inside one another."""


def refuse(value: object, should: str) -> NoReturn:
    """Raise Unfit for a value of the wrong type."""
    raise Unfit(f"{reprlib.repr(value)} should be {should}")


def _pack_none(value: Any) -> None:
    if value is not None:
        refuse(value, "None")


def _unpack_none(value: object) -> None:
    if value is not None:
        raise Junk


def _pack_bool(value: Any) -> bool:
    if value is True or value is False:
        return bool(value)
    refuse(value, "True or False")


def _unpack_bool(value: object) -> bool:
    if value is True or value is False:
        return value is True
    raise Junk


def _pack_int(value: Any) -> int:
    if not isinstance(value, int) or value is True or value is False:
        refuse(value, "an int")
    if not _LEAST <= value <= _MOST:
        refuse(value, "an int of at most 64 bits")
    return int(value)


def _unpack_int(value: object) -> int:
    if type(value) is int and _LEAST <= value <= _MOST:
        return value
    raise Junk


def _pack_float(value: Any) -> float:
    if type(value) is float and isfinite(value):
        return value
    if not isinstance(value, (float, int)) or value is True or value is False:
        refuse(value, "a float")
    try:
        number = float(value)
    except OverflowError:
        refuse(value, "a float of at most 64 bits")
    if not isfinite(number):
        refuse(value, "a finite float")
    return number


def _unpack_float(value: object) -> float:
    if type(value) is float and isfinite(value):
        return value
    raise Junk


NONE: Final = Form("None", frozenset({NoneType}), _pack_none, _unpack_none)
BOOL: Final = Form("bool", frozenset({bool}), _pack_bool, _unpack_bool)
INT: Final = Form("int", frozenset({int}), _pack_int, _unpack_int)
FLOAT: Final = Form("float", frozenset({float}), _pack_float, _unpack_float)


def rounded(resolution: Resolution) -> Form:
    """A float as a whole number of a resolution's steps."""
    per_unit = resolution.per_unit

    def pack(value: Any) -> int:
        steps = _pack_float(value) * per_unit
        if not _LEAST <= steps < _MOST:
            refuse(value, f"a float of at most 64 bits in steps of 1/{per_unit}")
        return round(steps)

    def unpack(value: object) -> float:
        if type(value) is int and _LEAST <= value <= _MOST:
            return value / per_unit
        raise Junk

    return Form(f"float/{per_unit}", FLOAT.kinds, pack, unpack)


def text(most: int) -> Form:
    """A str of at most so many bytes in UTF-8."""

    def pack(value: Any) -> str:
        if not isinstance(value, str):
            refuse(value, "a str")
        try:
            size = len(value.encode())
        except UnicodeEncodeError:
            refuse(value, "a str that UTF-8 can express")
        if size > most:
            raise Unfit(
                f"a str of {size} bytes in UTF-8 should have at most {most} (LinkParameters.most_text)"
            )
        return value

    def unpack(value: object) -> str:
        if type(value) is str and (4 * len(value) <= most or text_size(value) <= most):
            return value
        raise Junk

    return Form("str", frozenset({str}), pack, unpack)


def text_size(value: str) -> int:
    """Bytes in UTF-8; never raises."""
    return len(value) if value.isascii() else len(value.encode("utf-8", "surrogatepass"))


def octets(most: int) -> Form:
    """A bytes of at most so many bytes."""

    def pack(value: Any) -> bytes:
        if not isinstance(value, bytes):
            refuse(value, "a bytes")
        if len(value) > most:
            raise Unfit(
                f"a bytes of {len(value)} bytes should have at most {most} (LinkParameters.most_text)"
            )
        return value

    def unpack(value: object) -> bytes:
        if type(value) is bytes and len(value) <= most:
            return value
        raise Junk

    return Form("bytes", frozenset({bytes}), pack, unpack)


def enumeration(cls: type[Enum]) -> Form:
    """A member of an Enum as its index in the order of definition."""
    members = tuple(cls)
    # By identity, for there is one object of each member, and its hash is a slow method.
    indices = {id(member): index for index, member in enumerate(members)}

    def pack(value: Any) -> int:
        index = indices.get(id(value))
        if index is None:
            refuse(value, f"a member of {cls.__name__}")
        return index

    names = ",".join(member.name for member in members)
    return Form(f"{cls.__qualname__}{{{names}}}", frozenset({cls}), pack, _chosen(members))


def literal(values: tuple[Any, ...]) -> Form:
    """A value of a Literal as its index."""
    # In an order of their own: typing takes Literal["a", "b"] and Literal["b", "a"] for the same, and gives
    # back whichever it met first.
    ordered = tuple(sorted(values, key=lambda value: (type(value).__name__, _written(value))))
    indices = {(type(value), value): index for index, value in enumerate(ordered)}
    choice = ", ".join(_written(value) for value in values)

    def pack(value: Any) -> int:
        try:
            return indices[type(value), value]
        except (KeyError, TypeError):  # TypeError: it has no hash
            refuse(value, f"one of {choice}")

    says = ",".join(_written(value) for value in ordered)
    return Form(f"Literal[{says}]", frozenset(type(value) for value in values), pack, _chosen(ordered))


def _written(value: object) -> str:
    return f"{type(value).__name__}.{value.name}" if isinstance(value, Enum) else repr(value)


def _chosen(values: tuple[Any, ...]) -> Callable[[Any], Any]:
    count = len(values)

    def unpack(index: Any) -> Any:
        if type(index) is int and 0 <= index < count:
            return values[index]
        raise Junk

    return unpack
