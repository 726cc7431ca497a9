"""How the types that knowledge is made of travel: each is compiled once, into two functions."""

import inspect
import reprlib
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from operator import attrgetter
from typing import Annotated, Any, Final, Literal, NewType, Union, get_args, get_origin, get_type_hints

from deeco.immutability import describe, is_frozen_struct, struct_fields
from deeco.parameters import LinkParameters
from deeco.replacing import is_plain
from deeco.replication.scalars import (
    BOOL,
    FLOAT,
    INT,
    NONE,
    Form,
    Junk,
    Resolution,
    Unfit,
    enumeration,
    literal,
    octets,
    refuse,
    rounded,
    text,
)

_FIXED: Final[dict[Any, Form]] = {None: NONE, types.NoneType: NONE, bool: BOOL, int: INT}


class Unsound(Exception):  # noqa: N818  # never seen by a user
    """A type that cannot be published, although its values cannot change; why, and what would be right."""


@dataclass(frozen=True)
class Compiler:
    """Makes forms, within the limits of the link."""

    limits: LinkParameters
    resolution: Resolution | None = None
    """That of the innermost Annotated around."""
    inside: tuple[type, ...] = ()
    """Classes around, outermost first."""

    def form(self, annotation: Any) -> Form:
        """The form of an annotated type. Raises Unsound."""
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
        # By what they say, for typing takes unions of different order for the same, as with Literal.
        forms: dict[str, Form] = {}
        for form in sorted((self.form(one) for one in arguments), key=lambda one: one.says):
            if forms.setdefault(form.says, form).kinds != form.kinds:
                raise Unsound(f"two alternatives are {form.says}; they should have different names")
        optional = forms.pop(NONE.says, None)
        alternatives = tuple(forms.values())
        if not alternatives:
            return NONE
        form = alternatives[0] if len(alternatives) == 1 else _choice(alternatives)
        return _optional(form) if optional else form

    def _class(self, cls: Any) -> Form:
        if not isinstance(cls, type):
            raise Unsound(f"{describe(cls)} has no form on the air")
        if issubclass(cls, Enum):
            return enumeration(cls)
        if cls in self.inside:
            raise Unsound(f"{cls.__name__} contains itself; what is published should have an end")
        inner = replace(self, inside=(*self.inside, cls))
        if is_dataclass(cls):
            names = tuple(field.name for field in fields(cls) if field.init)
        elif issubclass(cls, tuple) and hasattr(cls, "_fields"):
            names = cls._fields
        elif is_frozen_struct(cls):
            names = struct_fields(cls)
        else:
            raise Unsound(f"{describe(cls)} has no form on the air")
        return _record(cls, names, inner.fields(cls, names))

    def fields(self, cls: type, names: Sequence[str]) -> list[Form]:
        """The forms of a class's fields. Raises Unsound."""
        if len(names) > self.limits.most_items:
            raise Unsound(
                f"{cls.__name__} has {len(names)} fields; at most {self.limits.most_items} may be "
                "(LinkParameters.most_items)"
            )
        hints = get_type_hints(cls, localns={cls.__name__: cls}, include_extras=True)
        if untyped := next((name for name in names if name not in hints), None):
            raise Unsound(f"{cls.__name__}.{untyped} should have a type")
        return [self.form(hints[name]) for name in names]


def _sequence(item: Form, most: int) -> Form:
    pack_item, unpack_item = item.pack, item.unpack

    def pack(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, tuple):
            refuse(value, "a tuple")
        if len(value) > most:
            raise Unfit(
                f"a tuple of {len(value)} items should have at most {most} (LinkParameters.most_items)"
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
            refuse(value, f"a tuple of {count}")
        return pack_items(value)

    says = ",".join(form.says for form in forms)
    return Form(f"[{says}]", frozenset({tuple}), pack, _strict(forms), _depth(forms))


def _record(cls: type, names: tuple[str, ...], forms: Sequence[Form]) -> Form:
    make = maker(cls, names)
    attributes = getter(names)
    pack_items, unpack_items = _each([form.pack for form in forms]), _strict(forms)

    def pack(value: Any) -> tuple[Any, ...]:
        if type(value) is not cls:  # of a subclass, fields would be lost
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
        raise Unfit(f"{reprlib.repr(value)} should be one of {says}")

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
    # Those made for the value's class first, for a float would take an int as well.
    orders = {
        kind: sorted(indices, key=lambda index: kind not in alternatives[index].kinds) for kind in kinds
    }
    return Form(f"({says})", kinds, pack, unpack, _depth(alternatives))


def _depth(forms: Sequence[Form]) -> int:
    return 1 + max((form.depth for form in forms), default=0)


def _each(functions: Sequence[Callable[[Any], Any]]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """All functions, each on its item; written out for pairs, which are most positions."""
    if len(functions) == 2:
        first, second = functions
        return lambda items: (first(items[0]), second(items[1]))
    return lambda items: tuple([function(item) for function, item in zip(functions, items, strict=True)])


def _strict(forms: Sequence[Form]) -> Callable[[Any], tuple[Any, ...]]:
    count = len(forms)
    unpack_items = _each([form.unpack for form in forms])

    def unpack(packed: Any) -> tuple[Any, ...]:
        if type(packed) is not tuple or len(packed) != count:
            raise Junk
        return unpack_items(packed)

    return unpack


def getter(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """A function from an object to the values of its attributes."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


def maker(cls: type, names: tuple[str, ...]) -> Callable[[tuple[Any, ...]], Any]:
    """A function from the values of a class's fields to its object, which raises Junk if the class refuses.

    Raises Unsound for a class that takes something else than its fields.
    """
    taken = tuple(inspect.signature(cls).parameters.values())
    if {parameter.name for parameter in taken} != set(names):
        wanted = ", ".join(parameter.name for parameter in taken) or "nothing"
        raise Unsound(
            f"{cls.__name__} is made from {wanted}; it should be made from its fields {', '.join(names)}"
        )
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
        except Exception as error:  # whatever a user's __post_init__ raises for data that make no sense
            raise Junk from error

    return make
