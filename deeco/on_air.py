"""Encoding of knowledge on the link: each type is compiled once into a pair of functions."""

import inspect
import reprlib
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import partial
from math import isfinite
from operator import attrgetter
from types import NoneType
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NewType,
    NoReturn,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from deeco.errors import DefinitionError
from deeco.knowledge import describe, is_frozen_struct, is_plain, struct_fields
from deeco.link import LinkParameters

_LEAST: Final = -(2**63)
_MOST: Final = 2**64 - 1
"""With _LEAST: range of msgpack integers."""


class Junk(Exception):  # noqa: N818  # internal
    """Received data that do not match the expected encoding."""


class Unfit(Exception):  # noqa: N818  # internal
    """A value that cannot be encoded; the message names the fault and the remedy."""


@dataclass(frozen=True)
class Resolution:
    """Encode the floats of a field as integer multiples of 1/`per_unit`, in 1 to 5 bytes instead of 9.

        position: Annotated[Point, Resolution(1000)]        # to the millimetre

    Applies to every float inside the annotated type; the innermost Resolution counts. A float x is received
    as
    round(x * per_unit) / per_unit; a value of that form is unchanged. Raises DefinitionError unless
    `per_unit` is
    a positive integer.
    """

    per_unit: int

    def __post_init__(self) -> None:
        if type(self.per_unit) is not int or self.per_unit < 1:
            raise DefinitionError(
                f"Resolution({self.per_unit!r}): per_unit must be a positive integer, "
                "such as 1000 for millimetres"
            )


@dataclass(frozen=True)
class Form:
    """Encoding of the values of one type."""

    says: str
    """Text form; types of equal text are encoded alike."""
    kinds: frozenset[type]
    """Classes of the encoded values."""
    pack: Callable[[Any], Any]
    """Convert a value for msgpack. Raises Unfit."""
    unpack: Callable[[Any], Any]
    """Convert back. Raises only Junk, for anything that `pack` does not return."""
    depth: int = 0
    """Depth of nested arrays."""


def refuse(value: object, should: str) -> NoReturn:
    """Raise Unfit for a value of the wrong type; `should` names the right one."""
    raise Unfit(f"{reprlib.repr(value)} must be {should}")


def _singletons(says: str, kind: type, values: tuple[Any, ...], should: str) -> Form:
    """Return the form of values compared by identity and encoded as themselves."""

    def pack(value: Any) -> Any:
        if not any(value is one for one in values):
            refuse(value, should)
        return value

    def unpack(value: object) -> Any:
        if not any(value is one for one in values):
            raise Junk
        return value

    return Form(says, frozenset({kind}), pack, unpack)


def _pack_int(value: Any) -> int:
    if not isinstance(value, int) or value is True or value is False:
        refuse(value, "an int")
    if not _LEAST <= value <= _MOST:
        refuse(value, "an int of up to 64 bits")
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
        refuse(value, "a float of up to 64 bits")
    if not isfinite(number):
        refuse(value, "a finite float")
    return number


def _unpack_float(value: object) -> float:
    if type(value) is float and isfinite(value):
        return value
    raise Junk


NONE: Final = _singletons("None", NoneType, (None,), "None")
BOOL: Final = _singletons("bool", bool, (True, False), "True or False")
INT: Final = Form("int", frozenset({int}), _pack_int, _unpack_int)
FLOAT: Final = Form("float", frozenset({float}), _pack_float, _unpack_float)


def rounded(resolution: Resolution) -> Form:
    """Return the form of floats as integer multiples of a resolution."""
    per_unit = resolution.per_unit

    def pack(value: Any) -> int:
        steps = _pack_float(value) * per_unit
        if not _LEAST <= steps < _MOST:
            refuse(value, f"a float of up to 64 bits in steps of 1/{per_unit}")
        return round(steps)

    def unpack(value: object) -> float:
        if type(value) is int and _LEAST <= value <= _MOST:
            return value / per_unit
        raise Junk

    return Form(f"float/{per_unit}", FLOAT.kinds, pack, unpack)


def text(most: int) -> Form:
    """Return the form of str values of up to `most` bytes in UTF-8."""

    def pack(value: Any) -> str:
        if not isinstance(value, str):
            refuse(value, "a str")
        try:
            size = len(value.encode())
        except UnicodeEncodeError:
            refuse(value, "a str without lone surrogates")
        if size > most:
            raise Unfit(
                f"a str has {size} bytes in UTF-8; at most {most} are allowed (LinkParameters.most_text)"
            )
        return value

    def unpack(value: object) -> str:
        if type(value) is str and (4 * len(value) <= most or text_size(value) <= most):
            return value
        raise Junk

    return Form("str", frozenset({str}), pack, unpack)


def text_size(value: str) -> int:
    """Return the bytes of a str in UTF-8; never raises."""
    return len(value) if value.isascii() else len(value.encode("utf-8", "surrogatepass"))


def octets(most: int) -> Form:
    """Return the form of bytes values of up to `most` bytes."""

    def pack(value: Any) -> bytes:
        if not isinstance(value, bytes):
            refuse(value, "bytes")
        if len(value) > most:
            raise Unfit(
                f"a bytes value has {len(value)} bytes; at most {most} are allowed (LinkParameters.most_text)"
            )
        return value

    def unpack(value: object) -> bytes:
        if type(value) is bytes and len(value) <= most:
            return value
        raise Junk

    return Form("bytes", frozenset({bytes}), pack, unpack)


def enumeration(cls: type[Enum]) -> Form:
    """Return the form of Enum members as indices in order of definition."""
    members = tuple(cls)
    # By identity: members are singletons, and Enum's hash is slow.
    indices = {id(member): index for index, member in enumerate(members)}

    def pack(value: Any) -> int:
        index = indices.get(id(value))
        if index is None:
            refuse(value, f"a member of {cls.__name__}")
        return index

    names = ",".join(member.name for member in members)
    return Form(f"{cls.__qualname__}{{{names}}}", frozenset({cls}), pack, _chosen(members))


def literal(values: tuple[Any, ...]) -> Form:
    """Return the form of Literal values as indices."""
    # Sorted: typing treats Literal["a", "b"] and Literal["b", "a"] as equal and returns the one cached first.
    ordered = tuple(sorted(values, key=lambda value: (type(value).__name__, _written(value))))
    indices = {(type(value), value): index for index, value in enumerate(ordered)}
    choice = ", ".join(_written(value) for value in values)

    def pack(value: Any) -> int:
        try:
            return indices[type(value), value]
        except (KeyError, TypeError):  # TypeError: not hashable
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


_FIXED: Final[dict[Any, Form]] = {None: NONE, types.NoneType: NONE, bool: BOOL, int: INT}


class Unsound(Exception):  # noqa: N818  # internal
    """A type of immutable values that cannot be encoded; the message names the reason and the remedy."""


@dataclass(frozen=True)
class Compiler:
    """Compiles types to forms within the limits of the link."""

    limits: LinkParameters
    resolution: Resolution | None = None
    """Resolution of the innermost enclosing Annotated."""
    inside: tuple[type, ...] = ()
    """Enclosing classes, outermost first."""

    def form(self, annotation: Any) -> Form:
        """Return the form of an annotated type. Raises Unsound."""
        if isinstance(annotation, NewType):
            return self.form(annotation.__supertype__)
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            return self._annotated(arguments)
        if origin is Literal:
            return literal(arguments)
        if origin is tuple:
            return self._tuple(arguments)
        if origin in {Union, types.UnionType}:
            return self._union(arguments)
        return self._plain(annotation)

    def _plain(self, annotation: Any) -> Form:
        if annotation is float:
            return rounded(self.resolution) if self.resolution else FLOAT
        if annotation is str:
            return text(self.limits.most_text)
        if annotation is bytes:
            return octets(self.limits.most_text)
        if annotation in _FIXED:
            return _FIXED[annotation]
        return self._class(annotation)

    def _annotated(self, arguments: tuple[Any, ...]) -> Form:
        annotation, *extras = arguments
        resolution = next((extra for extra in reversed(extras) if isinstance(extra, Resolution)), None)
        return (replace(self, resolution=resolution) if resolution else self).form(annotation)

    def _tuple(self, arguments: tuple[Any, ...]) -> Form:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return _sequence(self.form(arguments[0]), self.limits.most_items)
        return _row([self.form(argument) for argument in arguments])

    def _union(self, arguments: tuple[Any, ...]) -> Form:
        # Sorted by text, as typing treats unions of different order as equal.
        forms: dict[str, Form] = {}
        for form in sorted((self.form(one) for one in arguments), key=lambda one: one.says):
            if forms.setdefault(form.says, form).kinds != form.kinds:
                raise Unsound(f"two alternatives are {form.says}; rename one of them")
        optional = forms.pop(NONE.says, None)
        alternatives = tuple(forms.values())
        if not alternatives:
            return NONE
        form = alternatives[0] if len(alternatives) == 1 else _choice(alternatives)
        return _optional(form) if optional else form

    def _class(self, cls: Any) -> Form:
        if not isinstance(cls, type):
            raise Unsound(f"{describe(cls)} cannot be encoded")
        if issubclass(cls, Enum):
            return enumeration(cls)
        if cls in self.inside:
            raise Unsound(f"{cls.__name__} contains itself; recursive types cannot be encoded")
        inner = replace(self, inside=(*self.inside, cls))
        if is_dataclass(cls):
            names = tuple(field.name for field in fields(cls) if field.init)
        elif issubclass(cls, tuple) and hasattr(cls, "_fields"):
            names = cls._fields
        elif is_frozen_struct(cls):
            names = struct_fields(cls)
        else:
            raise Unsound(f"{describe(cls)} cannot be encoded")
        return _record(cls, names, inner.fields(cls, names))

    def fields(self, cls: type, names: Sequence[str]) -> list[Form]:
        """Return the forms of a class's fields. Raises Unsound."""
        if len(names) > self.limits.most_items:
            raise Unsound(
                f"{cls.__name__} has {len(names)} fields; at most {self.limits.most_items} are allowed "
                "(LinkParameters.most_items)"
            )
        hints = get_type_hints(cls, localns={cls.__name__: cls}, include_extras=True)
        if untyped := next((name for name in names if name not in hints), None):
            raise Unsound(f"annotate {cls.__name__}.{untyped} with its type")
        return [self.form(hints[name]) for name in names]


def _sequence(item: Form, most: int) -> Form:
    pack_item, unpack_item = item.pack, item.unpack

    def pack(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, tuple):
            refuse(value, "a tuple")
        if len(value) > most:
            raise Unfit(
                f"a tuple has {len(value)} items; at most {most} are allowed (LinkParameters.most_items)"
            )
        return tuple(map(pack_item, value))

    def unpack(packed: Any) -> tuple[Any, ...]:
        if type(packed) is not tuple or len(packed) > most:
            raise Junk
        return tuple(map(unpack_item, packed))

    return Form(f"[{item.says},...]", frozenset({tuple}), pack, unpack, 1 + item.depth)


def _row(forms: Sequence[Form]) -> Form:
    count = len(forms)
    pack_items = _each([form.pack for form in forms])

    def pack(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, tuple) or len(value) != count:
            refuse(value, f"a tuple of {count} items")
        return pack_items(value)

    says = ",".join(form.says for form in forms)
    return Form(f"[{says}]", frozenset({tuple}), pack, strict(forms), _depth(forms))


def _record(cls: type, names: tuple[str, ...], forms: Sequence[Form]) -> Form:
    make = maker(cls, names)
    attributes = getter(names)
    pack_items, unpack_items = _each([form.pack for form in forms]), strict(forms)

    def pack(value: Any) -> tuple[Any, ...]:
        if type(value) is not cls:  # a subclass would lose fields
            refuse(value, f"a {cls.__name__}")
        return pack_items(attributes(value))

    def unpack(packed: Any) -> Any:
        return make(unpack_items(packed))

    says = ",".join(f"{name}:{form.says}" for name, form in zip(names, forms, strict=True))
    return Form(f"{cls.__qualname__}({says})", frozenset({cls}), pack, unpack, _depth(forms))


def _optional(form: Form) -> Form:
    pack_value, unpack_value = form.pack, form.unpack

    def pack(value: Any) -> Any:
        return None if value is None else pack_value(value)

    def unpack(packed: Any) -> Any:
        return None if packed is None else unpack_value(packed)

    return Form(f"?{form.says}", form.kinds | NONE.kinds, pack, unpack, form.depth)


def _choice(alternatives: tuple[Form, ...]) -> Form:
    def pack(value: Any) -> tuple[int, Any]:
        for index in orders.get(type(value), indices):
            try:
                return index, alternatives[index].pack(value)
            except Unfit:
                continue
        raise Unfit(f"{reprlib.repr(value)} must be one of {says}")

    def unpack(packed: Any) -> Any:
        if type(packed) is not tuple or len(packed) != 2:
            raise Junk
        index, value = packed
        if type(index) is not int or not 0 <= index < len(alternatives):
            raise Junk
        return alternatives[index].unpack(value)

    says = "|".join(form.says for form in alternatives)
    kinds = frozenset[type]().union(*(form.kinds for form in alternatives))
    indices = range(len(alternatives))
    # Forms for the value's own class first, as float also accepts int.
    orders = {
        kind: sorted(indices, key=lambda index: kind not in alternatives[index].kinds) for kind in kinds
    }
    return Form(f"({says})", kinds, pack, unpack, _depth(alternatives))


def _depth(forms: Sequence[Form]) -> int:
    return 1 + max((form.depth for form in forms), default=0)


def _each(functions: Sequence[Callable[[Any], Any]]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """Return a function that applies `functions` to the items of a sequence; fast for pairs (positions)."""
    if len(functions) == 2:
        first, second = functions
        return lambda items: (first(items[0]), second(items[1]))
    return lambda items: tuple([function(item) for function, item in zip(functions, items, strict=True)])


def strict(forms: Sequence[Form]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that unpacks a tuple of exactly these forms, or raises Junk."""
    functions, count = [form.unpack for form in forms], len(forms)

    def unpack(packed: Any) -> tuple[Any, ...]:
        if type(packed) is not tuple or len(packed) != count:
            raise Junk
        return tuple([function(item) for function, item in zip(functions, packed, strict=True)])

    return unpack


def getter(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function from an object to the values of its attributes."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


def maker(cls: type, names: tuple[str, ...]) -> Callable[[tuple[Any, ...]], Any]:
    """Return a function that makes an object from field values; it raises Junk if the class rejects them.

    Raises Unsound if the constructor's parameters are not the fields.
    """
    taken = tuple(inspect.signature(cls).parameters.values())
    if {parameter.name for parameter in taken} != set(names):
        wanted = ", ".join(parameter.name for parameter in taken) or "nothing"
        raise Unsound(f"{cls.__name__} has parameters {wanted}; they must be its fields {', '.join(names)}")
    if issubclass(cls, tuple) and cls.__new__.__code__.co_filename == "<string>":  # generated by NamedTuple
        return partial(tuple.__new__, cls)
    if is_plain(cls):
        new = object.__new__

        def fill(values: tuple[Any, ...]) -> Any:
            made: Any = new(cls)
            made.__dict__.update(zip(names, values, strict=True))
            return made

        return fill
    by_position = all(parameter.kind is not inspect.Parameter.KEYWORD_ONLY for parameter in taken)

    def make(values: tuple[Any, ...]) -> Any:
        try:
            return cls(*values) if by_position else cls(**dict(zip(names, values, strict=True)))
        except Exception as error:  # a user's __post_init__ may raise anything
            raise Junk from error

    return make
