"""Settings: structs whose fields carry their bounds, and the checker that decodes files into them.

A bound is a `msgspec.Meta` of the field's type. Its `description` continues "must be" in errors, where type,
bounds and `unit` do not suffice. A `Duration` is a number of seconds in a file, and µs in the struct.
Dataclasses are decoded in the same way.
"""

import codecs
import dataclasses
import math
import operator
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
from msgspec import Meta

from actors import wording
from actors.geometry import GREATEST_COORDINATE, Coordinate
from actors.instant import Duration, in_seconds, seconds
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError

T = TypeVar("T")
LONGEST_S: Final = 1_000_000
"""Longest duration in a file, s."""
LARGEST_FILE: Final = 1_000_000
"""Bytes; a scenario of 1000 robots with 10 items each has half of that."""
MOST_PARTS: Final = 32
"""Parts of a dotted key; parsing time grows with their square, and no file here has more than three."""
MOST_BITS: Final = 1023
"""Bits of a whole number; a longer one does not fit a float, and Python cannot print more than 14 000."""
_TEXT: Final = re.compile(
    r"""\"{3}(?:[^"\\]|\\.|"(?!""))*"{0,3}|'{3}(?:[^']|'(?!''))*'{0,3}"""
    r"""|"(?:[^"\\\n]|\\.)*"?|'[^'\n]*'?|#[^\n]*""",
    re.DOTALL,
)
"""Strings, also unterminated ones, and comments; matches in linear time."""
_KEY: Final = re.compile(r"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++)+")
_WITHIN: Final = f"within ±{GREATEST_COORDINATE:.0f}"
A_POSE: Final = f"a pose [x, y, heading] in m, m and rad, {_WITHIN}"
A_POINT: Final = f"a point [x, y] in m, {_WITHIN}"

StartPose = Annotated[tuple[Coordinate, Coordinate, Coordinate], Meta(description=A_POSE)]
Place = Annotated[tuple[Coordinate, Coordinate], Meta(description=A_POINT)]
Span = Annotated[
    tuple[Coordinate, Coordinate], Meta(description="two numbers [from, to] in m, the first below the second")
]
Text = Annotated[str, Meta(pattern=r"\A[^\x00]+\Z")]
"""Not empty, and without NUL, which ends a path for the operating system."""
Names = Annotated[
    tuple[Annotated[Text, Meta(description='the name of an area, such as "hall"')], ...],
    Meta(min_length=1, description='a list of names of areas, such as ["hall"]'),
]
Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=0)]
PositiveCount = Annotated[int, Meta(ge=1)]
Interval = Annotated[Duration, Meta(ge=0, le=seconds(LONGEST_S))]
PositiveInterval = Annotated[Duration, Meta(gt=0, le=seconds(LONGEST_S))]


class ParameterError(AcrcError, ValueError):
    """An unknown setting, or one with an invalid value."""

    def __init__(self, key: str, value: object, expected: str, sentence: str = "") -> None:
        """Describe the fault; `expected` continues "must be", `sentence` replaces the default sentence."""
        super().__init__(sentence or f"{key} is {wording.toml_text(value)}, but must be {expected}")
        self.key, self.value, self.expected = key, value, expected


class RuleError(AcrcError, ValueError):
    """A conflict between keys of one table; its text continues "must"."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings whose numbers and choices are checked, also when made by code. Raises ParameterError."""

    def __post_init__(self) -> None:
        for name, metas, choices in _bounds(type(self)):
            value = getattr(self, name)
            if value is not None and not (_is_within(value, metas) and (not choices or value in choices)):
                raise self.wrong(name)

    def wrong(self, name: str, expected: str = "") -> ParameterError:
        """Return the error for a field's value; `expected`: continues "must be", default: by its type."""
        key = f"{type(self).__name__}.{name}"
        return ParameterError(
            key, getattr(self, name), expected or words(fields_of(type(self))[name].hint, name)
        )

    def check_unused(self, names: Collection[str], where: str) -> None:
        """Raise ParameterError for a field that is set but unused under the condition `where`."""
        for name in names:
            if getattr(self, name) != fields_of(type(self))[name].default:
                raise self.wrong(name, f"absent where {where}, which does not use it")


def check_spans(table: Settings, *names: str) -> None:
    """Raise ParameterError for a field of two numbers if the first is not below the second."""
    for name in names:
        low, high = getattr(table, name)
        if not low < high:
            raise table.wrong(name)


def check_range(key: str, value: float, least: float, most: float) -> None:
    """Raise ParameterError for a value outside [least, most]."""
    if not least <= value <= most:
        raise ParameterError(key, value, wording.bounds_text(ge=least, le=most))


def read_text(path: Path, kind: str, most: int = LARGEST_FILE) -> str:
    """Return the text of a file, without a byte order mark. Raises AcrcError.

    `kind`: names it in errors, such as "scenario". `most`: its maximum size, bytes.
    """
    try:
        with regular_file.open_regular(path) as file:
            content = file.read(most + 1)
        if len(content) > most:
            raise AcrcError(f"{path}: the {kind} file is larger than {most} bytes")
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise AcrcError(f"{path}: the {kind} file is UTF-16; save it as UTF-8")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise AcrcError(f"{path}: the {kind} file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise AcrcError(f"{path}: byte {error.start} of the {kind} file is not UTF-8") from None


def toml_tables(text: str, name: object) -> dict[str, Any]:
    """Return the tables in the text of the TOML file `name`. Raises AcrcError."""
    try:
        return loads(text)
    except ValueError as error:
        raise AcrcError(f"{name}: invalid TOML: {error}") from None


def loads(text: str) -> dict[str, Any]:
    """Return the content of a TOML text, in linear time. Raises ValueError.

    Also rejects whole numbers beyond any float, and keys of more than MOST_PARTS parts.
    """
    _check_keys(text)
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(str(error)) from None
    if any(isinstance(value, int) and value.bit_length() > MOST_BITS for value in _values(content)):
        raise ValueError(f"a whole number in it has more than {MOST_BITS} bits")
    return content


def _check_keys(text: str) -> None:
    bare = _TEXT.sub(lambda found: "s" + "\n" * found.group().count("\n"), text)
    for key in _KEY.finditer(bare):
        if key.group().count(".") >= MOST_PARTS:
            line = bare.count("\n", 0, key.start()) + 1
            raise ValueError(f"line {line} has a key of more than {MOST_PARTS} parts")


def _values(content: object) -> Iterator[object]:
    """Yield every value, at any depth."""
    pending = [content]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            pending.extend(value.values())
        elif isinstance(value, list):
            pending.extend(value)
        else:
            yield value


def load(path: Path, kind: type[T], what: str, most: int = LARGEST_FILE) -> T:
    """Return the content of a TOML file of at most `most` bytes as a struct. Raises AcrcError.

    `what`: names it in errors, such as "study".
    """
    return parse(read_text(path, what, most), kind, str(path))


def parse(text: str, kind: type[T], name: str) -> T:
    """Return the content of the TOML file `name` as a struct. Raises AcrcError."""
    content = toml_tables(text, name)
    try:
        return decode(kind, content)
    except AcrcError as error:
        raise AcrcError(f"{name}: {error}") from None


def decode(
    kind: type[T], content: Any, key: str = "", base: T | None = None, others: Collection[str] = ()
) -> T:
    """Return the struct or dataclass that a table describes; `key`: the table's key in the file.

    `base`: has the values that the table does not set. `others`: keys that the caller has read. Raises
    ParameterError for the first wrong key or value, and AcrcError for keys in conflict.
    """
    if not isinstance(content, Mapping):
        raise ParameterError(key, content, words(kind, key))
    table: Any = kind
    start: Any = base
    fields, values = fields_of(table), dict[str, Any]()
    for name, value in content.items():
        if name in fields:
            values[name] = _field(fields[name].hint, value, _joined_key(key, name))
        elif name not in others:
            known = (*fields, *others)
            raise ParameterError(_joined_key(key, name), value, "", wording.unknown_key(key, name, known))
    for name, field in fields.items():
        if base is None and field.required and name not in values:
            expected = words(field.hint, _joined_key(key, name))
            sentence = f"{_joined_key(key, name)} is missing, but must be {expected}"
            raise ParameterError(_joined_key(key, name), None, expected, sentence)
    try:
        result: T = table(**values) if base is None else msgspec.structs.replace(start, **values)
    except RuleError as error:
        raise AcrcError(f"{key or 'the file'} must {error}") from None
    except ParameterError as error:
        name = error.key.rpartition(".")[2]
        raise ParameterError(_joined_key(key, name), content.get(name, error.value), error.expected) from None
    return result


def plain(value: Any) -> Any:
    """Return settings as in a file: tables without None, durations in s."""
    if not isinstance(value, msgspec.Struct):
        return tuple(map(plain, value)) if isinstance(value, tuple) else value
    return {
        name: in_seconds(one) if _split_annotation(field.hint)[0] is Duration else plain(one)
        for name, field in fields_of(type(value)).items()
        if (one := getattr(value, name)) is not None
    }


class _WrongError(Exception):
    """A value of the wrong type or out of bounds."""


class _Field(NamedTuple):
    hint: Any
    default: Any
    required: bool


@cache
def fields_of(kind: Any) -> dict[str, _Field]:
    """Return the settable fields, by name."""
    if issubclass(kind, msgspec.Struct):
        return {one.name: _Field(one.type, one.default, one.required) for one in msgspec.structs.fields(kind)}
    hints = get_type_hints(kind, include_extras=True)
    return {
        one.name: _Field(hints[one.name], one.default, one.default is one.default_factory)
        for one in dataclasses.fields(kind)
        if one.init and words(hints[one.name], "")
    }


@cache
def _bounds(kind: Any) -> list[tuple[str, Sequence[Meta], Sequence[Any]]]:
    """Return the fields with a bounded number or a choice."""
    found = list[tuple[str, Sequence[Meta], Sequence[Any]]]()
    for name, field in fields_of(kind).items():
        is_union = get_origin(field.hint) in {Union, UnionType}
        alternatives = (
            [one for one in get_args(field.hint) if one is not NoneType] if is_union else [field.hint]
        )
        plain_kind, metas = _split_annotation(alternatives[0])
        choices = get_args(plain_kind) if get_origin(plain_kind) is Literal else ()
        if len(alternatives) == 1 and (choices or (metas and plain_kind in {int, float, Duration})):
            found.append((name, metas, choices))
    return found


def _split_annotation(hint: Any) -> tuple[Any, Sequence[Meta]]:
    """Return a type without Annotated, and its bounds."""
    if get_origin(hint) is not Annotated:
        return hint, ()
    return hint.__origin__, [one for one in hint.__metadata__ if isinstance(one, Meta)]


def _joined_key(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _field(hint: Any, value: object, key: str) -> Any:
    try:
        return _value(hint, value, key)
    except _WrongError:
        raise ParameterError(key, value, words(hint, key)) from None


def _value(hint: Any, value: Any, key: str) -> Any:
    kind, metas = _split_annotation(hint)
    try:
        found = _convert(kind, value, key)
        if not _is_within(found, metas):
            raise _WrongError
    except _WrongError:
        if expected := _description(metas):
            raise ParameterError(key, value, expected) from None
        raise
    return found


def _convert(kind: Any, value: Any, key: str) -> Any:
    origin, args = get_origin(kind), get_args(kind)
    if origin in {Union, UnionType}:
        return _convert_union(args, value, key)
    if origin is tuple:
        return _convert_items(args, value, key)
    if origin in {dict, Mapping} and isinstance(value, Mapping):
        return {name: _field(args[1], one, _joined_key(key, str(name))) for name, one in value.items()}
    if _is_table(kind):
        return decode(kind, value, key)
    return _convert_scalar(kind, args if origin is Literal else (), value)


def _convert_union(kinds: Sequence[Any], value: Any, key: str) -> Any:
    wrong = _WrongError()
    for kind in kinds:
        if kind is not NoneType and not (_is_table(kind) and not isinstance(value, Mapping)):
            try:
                return _value(kind, value, key)
            except _WrongError as error:
                wrong = error
    if value is None and NoneType in kinds:
        return None
    raise wrong


def _convert_items(kinds: Sequence[Any], value: Any, key: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise _WrongError
    if kinds[-1] is ...:
        return tuple(_value(kinds[0], one, f"{key}[{number}]") for number, one in enumerate(value))
    if len(kinds) != len(value):
        raise _WrongError
    return tuple(_value(kind, one, key) for kind, one in zip(kinds, value, strict=True))


def _convert_scalar(kind: Any, choices: Sequence[Any], value: Any) -> Any:
    if kind is Any:
        return tuple(value) if isinstance(value, list) else value
    if isinstance(kind, type) and issubclass(kind, Enum):
        choices = [one.value for one in kind]
    for one in choices:
        if type(one) is type(value) and one == value:  # True is not 1
            return kind(value) if isinstance(kind, type) else value
    if type(value) is int and not -(2**63) <= value < 2**63:
        raise _WrongError
    number = type(value) in {int, float} and math.isfinite(value)
    if kind is float and number:
        return float(value)
    if kind is Duration and number and abs(value) <= LONGEST_S:
        return seconds(value)
    if type(value) is not kind or kind is float:
        raise _WrongError
    return value


_TESTS: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "ge": operator.ge,
    "gt": operator.gt,
    "le": operator.le,
    "lt": operator.lt,
    "multiple_of": lambda value, bound: value % bound == 0,
    "pattern": lambda value, bound: re.search(bound, value) is not None,
    "min_length": lambda value, bound: len(value) >= bound,
    "max_length": lambda value, bound: len(value) <= bound,
}


def _is_within(value: Any, metas: Sequence[Meta]) -> bool:
    """Return whether a value is finite and within bounds."""
    return not (isinstance(value, float) and not math.isfinite(value)) and all(
        test(value, bound)
        for meta in metas
        for name, test in _TESTS.items()
        if (bound := getattr(meta, name)) is not None
    )


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, msgspec.Struct) or dataclasses.is_dataclass(kind))


def _description(metas: Sequence[Meta]) -> str:
    return next((one.description for one in reversed(metas) if one.description), "")


def words(hint: Any, key: str) -> str:
    """Describe a type's valid values, to follow "must be"; empty if no file can set it."""
    kind, metas = _split_annotation(hint)
    return _description(metas) or _table_words(kind, key) or _number_words(kind, metas)


def _table_words(kind: Any, key: str) -> str:
    """Describe valid tables, lists and choices."""
    origin, args = get_origin(kind), [one for one in get_args(kind) if one not in {NoneType, ...}]
    if origin in {Union, UnionType}:
        return " or ".join(words(one, key) for one in args)
    if origin is dict or (origin is tuple and len(args) == 1):
        name, item = (f"[{key}]", args[0]) if origin is tuple else (f"{key}.NAME", args[1])
        if _is_table(item):
            return f"written as tables [{name}]"
        return f"a list, each item {described}" if (described := words(item, key)) else ""
    if _is_table(kind):
        return f"a table [[{key.partition('[')[0]}]]" if key.endswith("]") else f"a table [{key}]"
    if isinstance(kind, type) and issubclass(kind, Enum):
        args = [one.value for one in kind]
    if origin is Literal or args:
        return wording.one_of(args) if origin is not tuple else ""
    return {bool: "true or false", str: "a string"}.get(kind, "")


def _number_words(kind: Any, metas: Sequence[Meta]) -> str:
    if kind not in {int, float, Duration}:
        return ""
    bounds = {
        name: bound
        for meta in metas
        for name in ("gt", "ge", "lt", "le")
        if (bound := getattr(meta, name)) is not None
    }
    unit = next((f" of {one.extra['unit']}" for one in metas if one.extra), "")
    if kind is Duration:
        bounds = {name: _in_seconds(bound) for name, bound in bounds.items()} or {"le": LONGEST_S}
        unit = " of seconds"
    noun = f"a whole number{unit}" if kind is int else f"a number{unit}"
    if not bounds:
        return noun if kind is int else "a finite number"
    between = " " if len(bounds) > 1 or "gt" in bounds or "lt" in bounds else ", " if unit else " of "
    return noun + between + wording.bounds_text(**bounds)


def _in_seconds(bound: float) -> float:
    return int(bound) / seconds(1) if bound % seconds(1) else int(bound) // seconds(1)
