"""Encoding of knowledge on the link: each type is compiled once into a pair of functions.

Decoders of classes and tuples are generated as source code, as dataclasses generate their methods.
"""

import inspect
import reprlib
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import cache, cached_property
from math import isfinite
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
from deeco.knowledge import describe, has_generated_init, is_frozen_struct, struct_fields
from deeco.link import LinkParameters

_LEAST: Final = -(2**63)
_MOST: Final = 2**64 - 1
"""With _LEAST: range of msgpack integers."""
_CALL: Final = "helper(value)"
_IS_INT: Final = f"type(value) is int and {_LEAST} <= value <= {_MOST}"


class MalformedDataError(Exception):
    """Received data that do not match the expected encoding."""


class UnencodableValueError(Exception):
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
class Codec:
    """Encoding of the values of one type."""

    signature: str
    """Text form; types of equal text are encoded alike."""
    kinds: frozenset[type]
    """Classes of the encoded values."""
    pack: Callable[[Any], Any]
    """Convert a value for msgpack. Raises UnencodableValueError."""
    decoder: str
    """Python expression that converts `value` back; raises only MalformedDataError, for anything that `pack`
    does not return."""
    helper: Any = None
    """Object named `helper` in this expression."""
    depth: int = 0
    """Depth of nested arrays."""

    @cached_property
    def unpack(self) -> Any:
        """Function with the expression `decoder`."""
        return eval(f"lambda value: {self.decoder}", _scope(helper=self.helper))


def malformed() -> NoReturn:
    """Raise MalformedDataError, in an expression."""
    raise MalformedDataError


def refuse(value: object, expected: str) -> NoReturn:
    """Raise UnencodableValueError for a value of the wrong type; `expected` names the right one."""
    raise UnencodableValueError(f"{reprlib.repr(value)} must be {expected}")


def _identity_codec(signature: str, kind: type, condition: str, expected: str) -> Codec:
    """Return the codec of values encoded as themselves; `condition`: Python expression of `value`."""
    pack = eval(f"lambda value: value if {condition} else refuse(value, {expected!r})")
    return Codec(signature, frozenset({kind}), pack, f"value if {condition} else malformed()")


def _pack_int(value: Any) -> int:
    if not isinstance(value, int) or value is True or value is False:
        refuse(value, "an int")
    if not _LEAST <= value <= _MOST:
        refuse(value, "an int of up to 64 bits")
    return int(value)


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


NONE: Final = _identity_codec("None", NoneType, "value is None", "None")
BOOL: Final = _identity_codec("bool", bool, "value is True or value is False", "True or False")
INT: Final = Codec("int", frozenset({int}), _pack_int, f"value if {_IS_INT} else malformed()")
FLOAT: Final = Codec(
    "float",
    frozenset({float}),
    _pack_float,
    "value if type(value) is float and isfinite(value) else malformed()",
)


def resolution_codec(resolution: Resolution) -> Codec:
    """Return the codec of floats as integer multiples of a resolution."""
    per_unit = resolution.per_unit

    def pack(value: Any) -> int:
        steps = _pack_float(value) * per_unit
        if not _LEAST <= steps < _MOST:
            refuse(value, f"a float of up to 64 bits in steps of 1/{per_unit}")
        return round(steps)

    decoder = f"value / {per_unit} if {_IS_INT} else malformed()"
    return Codec(f"float/{per_unit}", FLOAT.kinds, pack, decoder)


def text_codec(most: int) -> Codec:
    """Return the codec of str values of up to `most` bytes in UTF-8."""

    def pack(value: Any) -> str:
        if not isinstance(value, str):
            refuse(value, "a str")
        try:
            size = len(value.encode())
        except UnicodeEncodeError:
            refuse(value, "a str without lone surrogates")
        if size > most:
            raise UnencodableValueError(
                f"a str has {size} bytes in UTF-8; at most {most} are allowed (LinkParameters.max_text)"
            )
        return value

    is_short = f"(4 * len(value) <= {most} or text_size(value) <= {most})"
    decoder = f"value if type(value) is str and {is_short} else malformed()"
    return Codec("str", frozenset({str}), pack, decoder)


def text_size(value: str) -> int:
    """Return the bytes of a str in UTF-8; never raises."""
    return len(value) if value.isascii() else len(value.encode("utf-8", "surrogatepass"))


def bytes_codec(most: int) -> Codec:
    """Return the codec of bytes values of up to `most` bytes."""

    def pack(value: Any) -> bytes:
        if not isinstance(value, bytes):
            refuse(value, "bytes")
        if len(value) > most:
            raise UnencodableValueError(
                f"a bytes value has {len(value)} bytes; at most {most} are allowed (LinkParameters.max_text)"
            )
        return value

    is_valid = f"type(value) is bytes and len(value) <= {most}"
    return Codec("bytes", frozenset({bytes}), pack, f"value if {is_valid} else malformed()")


def enum_codec(cls: type[Enum]) -> Codec:
    """Return the codec of Enum members as indices in order of definition."""
    members = tuple(cls)
    # By identity: members are singletons, and Enum's hash is slow.
    indices = {id(member): index for index, member in enumerate(members)}

    def pack(value: Any) -> int:
        index = indices.get(id(value))
        if index is None:
            refuse(value, f"a member of {cls.__name__}")
        return index

    names = ",".join(member.name for member in members)
    return Codec(f"{cls.__qualname__}{{{names}}}", frozenset({cls}), pack, *_index_decoder(members))


def literal_codec(values: tuple[Any, ...]) -> Codec:
    """Return the codec of Literal values as indices."""
    # Sorted: typing treats Literal["a", "b"] and Literal["b", "a"] as equal and returns the one cached first.
    ordered = tuple(sorted(values, key=lambda value: (type(value).__name__, _literal_text(value))))
    indices = {(type(value), value): index for index, value in enumerate(ordered)}
    choice = ", ".join(_literal_text(value) for value in values)

    def pack(value: Any) -> int:
        try:
            return indices[type(value), value]
        except (KeyError, TypeError):  # TypeError: not hashable
            refuse(value, f"one of {choice}")

    signature = ",".join(_literal_text(value) for value in ordered)
    return Codec(
        f"Literal[{signature}]", frozenset(type(value) for value in values), pack, *_index_decoder(ordered)
    )


def _literal_text(value: object) -> str:
    return f"{type(value).__name__}.{value.name}" if isinstance(value, Enum) else repr(value)


def _index_decoder(values: tuple[Any, ...]) -> tuple[str, tuple[Any, ...]]:
    return f"helper[value] if type(value) is int and 0 <= value < {len(values)} else malformed()", values


_FIXED: Final[dict[Any, Codec]] = {None: NONE, types.NoneType: NONE, bool: BOOL, int: INT}


class UnencodableTypeError(Exception):
    """A type of immutable values that cannot be encoded; the message names the reason and the remedy."""


@dataclass(frozen=True)
class Compiler:
    """Compiles types to codecs within the limits of the link."""

    limits: LinkParameters
    resolution: Resolution | None = None
    """Resolution of the innermost enclosing Annotated."""
    inside: tuple[type, ...] = ()
    """Enclosing classes, outermost first."""

    def codec(self, annotation: Any) -> Codec:
        """Return the codec of an annotated type. Raises UnencodableTypeError."""
        if isinstance(annotation, NewType):
            return self.codec(annotation.__supertype__)
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            return self._annotated_codec(arguments)
        if origin is Literal:
            return literal_codec(arguments)
        if origin is tuple:
            return self._tuple_codec_of(arguments)
        if origin in {Union, types.UnionType}:
            return self._union_codec_of(arguments)
        return self._plain_codec(annotation)

    def _plain_codec(self, annotation: Any) -> Codec:
        if annotation is float:
            return resolution_codec(self.resolution) if self.resolution else FLOAT
        if annotation is str:
            return text_codec(self.limits.max_text)
        if annotation is bytes:
            return bytes_codec(self.limits.max_text)
        if annotation in _FIXED:
            return _FIXED[annotation]
        return self._class_codec_of(annotation)

    def _annotated_codec(self, arguments: tuple[Any, ...]) -> Codec:
        annotation, *extras = arguments
        resolution = next((extra for extra in reversed(extras) if isinstance(extra, Resolution)), None)
        return (replace(self, resolution=resolution) if resolution else self).codec(annotation)

    def _tuple_codec_of(self, arguments: tuple[Any, ...]) -> Codec:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return _sequence_codec(self.codec(arguments[0]), self.limits.max_items)
        return _tuple_codec([self.codec(argument) for argument in arguments])

    def _union_codec_of(self, arguments: tuple[Any, ...]) -> Codec:
        # Sorted by text, as typing treats unions of different order as equal.
        codecs: dict[str, Codec] = {}
        for codec in sorted((self.codec(one) for one in arguments), key=lambda one: one.signature):
            if codecs.setdefault(codec.signature, codec).kinds != codec.kinds:
                raise UnencodableTypeError(f"two alternatives are {codec.signature}; rename one of them")
        optional = codecs.pop(NONE.signature, None)
        alternatives = tuple(codecs.values())
        if not alternatives:
            return NONE
        codec = alternatives[0] if len(alternatives) == 1 else _union_codec(alternatives)
        return _optional_codec(codec) if optional else codec

    def _class_codec_of(self, cls: Any) -> Codec:
        if not isinstance(cls, type):
            raise UnencodableTypeError(f"{describe(cls)} cannot be encoded")
        if issubclass(cls, Enum):
            return enum_codec(cls)
        if cls in self.inside:
            raise UnencodableTypeError(f"{cls.__name__} contains itself; recursive types cannot be encoded")
        inner = replace(self, inside=(*self.inside, cls))
        if is_dataclass(cls):
            names = tuple(field.name for field in fields(cls) if field.init)
        elif issubclass(cls, tuple) and hasattr(cls, "_fields"):
            names = cls._fields
        elif is_frozen_struct(cls):
            names = struct_fields(cls)
        else:
            raise UnencodableTypeError(f"{describe(cls)} cannot be encoded")
        return _class_codec(cls, names, inner.fields(cls, names))

    def fields(self, cls: type, names: Sequence[str]) -> list[Codec]:
        """Return the codecs of a class's fields. Raises UnencodableTypeError."""
        if len(names) > self.limits.max_items:
            raise UnencodableTypeError(
                f"{cls.__name__} has {len(names)} fields; at most {self.limits.max_items} are allowed "
                "(LinkParameters.max_items)"
            )
        hints = get_type_hints(cls, localns={cls.__name__: cls}, include_extras=True)
        if untyped := next((name for name in names if name not in hints), None):
            raise UnencodableTypeError(f"annotate {cls.__name__}.{untyped} with its type")
        return [self.codec(hints[name]) for name in names]


def _sequence_codec(item: Codec, most: int) -> Codec:
    pack_item = item.pack

    def pack(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, tuple):
            refuse(value, "a tuple")
        if len(value) > most:
            raise UnencodableValueError(
                f"a tuple has {len(value)} items; at most {most} are allowed (LinkParameters.max_items)"
            )
        return tuple(map(pack_item, value))

    is_valid = f"type(value) is tuple and len(value) <= {most}"
    decoder = f"tuple([{item.decoder} for value in value]) if {is_valid} else malformed()"
    return Codec(f"[{item.signature},...]", frozenset({tuple}), pack, decoder, item.helper, 1 + item.depth)


def _tuple_codec(codecs: Sequence[Codec]) -> Codec:
    count = len(codecs)
    pack_items = _packer(codecs, [f"value[{index}]" for index in range(count)])

    def pack(value: Any) -> Any:
        if not isinstance(value, tuple) or len(value) != count:
            refuse(value, f"a tuple of {count} items")
        return pack_items(value)

    unpack = _decoder(codecs, f"return {_tuple_of(expressions(codecs))}")
    signature = ",".join(codec.signature for codec in codecs)
    return Codec(f"[{signature}]", frozenset({tuple}), pack, _CALL, unpack, _depth(codecs))


def _class_codec(cls: type, names: tuple[str, ...], codecs: Sequence[Codec]) -> Codec:
    pack_fields = _packer(codecs, [f"value.{name}" for name in names])
    unpack = class_decoder(cls, dict(zip(names, expressions(codecs), strict=True)), codecs)

    def pack(value: Any) -> Any:
        if type(value) is not cls:  # a subclass would lose fields
            refuse(value, f"a {cls.__name__}")
        return pack_fields(value)

    signature = ",".join(f"{name}:{codec.signature}" for name, codec in zip(names, codecs, strict=True))
    return Codec(f"{cls.__qualname__}({signature})", frozenset({cls}), pack, _CALL, unpack, _depth(codecs))


def _optional_codec(codec: Codec) -> Codec:
    pack_value = codec.pack

    def pack(value: Any) -> Any:
        return None if value is None else pack_value(value)

    decoder = f"None if value is None else {codec.decoder}"
    return Codec(f"?{codec.signature}", codec.kinds | NONE.kinds, pack, decoder, codec.helper, codec.depth)


def _union_codec(alternatives: tuple[Codec, ...]) -> Codec:
    def pack(value: Any) -> tuple[int, Any]:
        for index in orders.get(type(value), indices):
            try:
                return index, alternatives[index].pack(value)
            except UnencodableValueError:
                continue
        raise UnencodableValueError(f"{reprlib.repr(value)} must be one of {signature}")

    def unpack(packed: Any) -> Any:
        if type(packed) is not tuple or len(packed) != 2:
            raise MalformedDataError
        index, value = packed
        if type(index) is not int or not 0 <= index < len(alternatives):
            raise MalformedDataError
        return alternatives[index].unpack(value)

    signature = "|".join(codec.signature for codec in alternatives)
    kinds = frozenset[type]().union(*(codec.kinds for codec in alternatives))
    indices = range(len(alternatives))
    # Codecs for the value's own class first, as float also accepts int.
    orders = {
        kind: sorted(indices, key=lambda index: kind not in alternatives[index].kinds) for kind in kinds
    }
    return Codec(f"({signature})", kinds, pack, _CALL, unpack, _depth(alternatives))


def _depth(codecs: Sequence[Codec]) -> int:
    return 1 + max((codec.depth for codec in codecs), default=0)


def _packer(codecs: Sequence[Codec], items: Iterable[str]) -> Any:
    """Return a function that packs items of `value`, given as Python expressions."""
    calls = [f"pack{index}({item})" for index, item in enumerate(items)]
    scope = {f"pack{index}": codec.pack for index, codec in enumerate(codecs)}
    return eval(f"lambda value: {_tuple_of(calls)}", scope)


def expressions(codecs: Sequence[Codec]) -> list[str]:
    """Return Python expressions that decode `value0`, `value1`, … of a generated decoder."""
    return [
        f"({codec.decoder})".replace("value", f"value{index}").replace("helper", f"helper{index}")
        for index, codec in enumerate(codecs)
    ]


def _tuple_of(values: Iterable[str]) -> str:
    return f"({''.join(f'{value}, ' for value in values)})"


def class_decoder(cls: type, values: Mapping[str, str], codecs: Sequence[Codec]) -> Any:
    """Return a function from packed fields, and an `id` if used, to an object; it raises MalformedDataError.

    `values`: the fields' values as Python expressions of `value0`, `value1`, … and `id`. Raises
    UnencodableTypeError if the constructor's parameters are not the fields.
    """
    parameters = tuple(inspect.signature(cls).parameters.values())
    if {parameter.name for parameter in parameters} != set(values):
        given = ", ".join(parameter.name for parameter in parameters) or "nothing"
        raise UnencodableTypeError(
            f"{cls.__name__} has parameters {given}; they must be its fields {', '.join(values)}"
        )
    new: Any = object.__new__
    if issubclass(cls, tuple) and cls.__new__.__code__.co_filename == "<string>":  # generated by NamedTuple
        new = tuple.__new__
        body = f"return new(cls, {_tuple_of(values.values())})"
    elif has_generated_init(cls):
        fields = "; ".join(f"state[{name!r}] = {value}" for name, value in values.items())
        body = f"made = new(cls); state = made.__dict__; {fields}; return made"
    else:
        keywords = {one.name: "" if one.kind is one.POSITIONAL_ONLY else f"{one.name}=" for one in parameters}
        arguments = ", ".join(keyword + values[name] for name, keyword in keywords.items())
        body = _CONSTRUCTION.format(arguments)
    return _decoder(codecs, body, cls=cls, new=new)


_CONSTRUCTION: Final = """try:
        return cls({})
    except Exception:  # a user's __post_init__ may raise anything
        malformed()"""
_DECODER: Final = """
def unpack(packed, id=None):
    if type(packed) is not tuple or len(packed) != {count}:
        malformed()
    [{variables}] = packed
    {body}
"""


def _decoder(codecs: Sequence[Codec], body: str, **names: Any) -> Any:
    """Return a function that unpacks a tuple of exactly these codecs, and then runs statements."""
    variables = ", ".join(f"value{index}" for index in range(len(codecs)))
    helpers = {f"helper{index}": codec.helper for index, codec in enumerate(codecs)}
    scope = _scope(**helpers, **names)
    exec(_compiled(_DECODER.format(count=len(codecs), variables=variables, body=body)), scope)
    return scope["unpack"]


def _scope(**names: Any) -> dict[str, Any]:
    return {"isfinite": isfinite, "malformed": malformed, "text_size": text_size, **names}


@cache
def _compiled(source: str) -> types.CodeType:
    return compile(source, "<decoder>", "exec")
