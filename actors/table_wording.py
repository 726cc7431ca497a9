"""What is wrong with a value in a table, in one sentence: the key, the value, and what would be right."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from actors import toml_file, wording
from actors.geometry import GREATEST_COORDINATE
from actors.runtime.errors import AcrcError
from actors.table import Right
from actors.wording import shown

M = TypeVar("M", bound=BaseModel)
Location = Sequence[str | int]
_UNBOUNDED: Final = {int: "a whole number", float: "a finite number"}
_BOUNDED: Final = {int: "a whole number", float: "a number"}
_BOUNDS: Final = ("gt", "ge", "lt", "le")
"""As pydantic's Field and what it makes of them call them."""


def load(path: Path, model: type[M], kind: str, most: int) -> M:
    """What stands in a TOML file of that kind, such as "places", of at most so many bytes.

    Raises AcrcError.
    """
    return parse(toml_file.read(path, kind, most), model, str(path))


def parse(text: str, model: type[M], name: str = "") -> M:
    """What the text of a TOML file says; a sentence begins with the file's name, if it has one.

    Raises AcrcError.
    """
    try:
        content = toml_file.loads(text)
    except ValueError as error:
        raise AcrcError(_of(name, f"this is no TOML: {error}")) from None
    return checked(content, model, name)


def checked(content: Mapping[str, Any], model: type[M], name: str = "") -> M:
    """The same of a file that has been parsed."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise AcrcError(_of(name, first(error, model, content))) from None


def _of(name: str, sentence: str) -> str:
    return f"{name}: {sentence}" if name else sentence


def first(error: ValidationError, model: type[BaseModel], content: object) -> str:
    """The first thing that is wrong in `content`, as a sentence without its end."""
    return sentence(error.errors(include_url=False)[0], model, content)


def sentence(one: ErrorDetails, model: type[BaseModel], content: object) -> str:
    """One thing that is wrong; listing them all takes a second where somebody has made a million."""
    location = one["loc"]
    place = _place(model, location)
    if one["type"] == "extra_forbidden":
        assert place.table is not None
        return wording.unknown_key(key(location[:-1]), str(location[-1]), place.table.model_fields)
    if one["type"] == "value_error" and place.table is not None and (reason := str(one["ctx"]["error"])):
        return f"{key(location) or 'the file'} must {reason}"
    context = one.get("ctx", {})
    if GREATEST_COORDINATE in (context.get("le"), -context.get("ge", 0)) and isinstance(location[-1], int):
        axis = "" if location[-2] in {"x", "y"} else (" x", " y", " heading")[location[-1]]
        wrong = f"{key(location[:-1])}{axis} is {shown(_value_at(content, location))}"
        unit = "rad" if location[-1] == 2 else "m"
        return f"{wrong}, but coordinates must be within ±{GREATEST_COORDINATE:.0f} {unit}"
    return _wrong(place, one["type"], location, content)


def _wrong(place: "_Location", kind: str, location: Location, content: object) -> str:
    right, known = _right(place), place.known
    if kind == "missing" and len(known) == len(location):
        return f"{key(known)} is missing, but must be {right.words}"
    words = right.words
    if right.item and len(location) > len(known):
        known, words = location[: len(known) + 1], right.item
    return f"{key(known)} is {shown(_value_at(content, known))}, but must be {words}"


def right_at(model: type[BaseModel], location: Location) -> Right:
    """What would be right at a location."""
    return _right(_place(model, location))


def key(location: Location) -> str:
    """A location as a dotted path with indices: ("event", 3, "at") is event[3].at."""
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path


class _Location(NamedTuple):
    """Where a location leads."""

    known: Location
    """Its beginning that names tables and keys, without what leads into a key's value."""
    field: FieldInfo | None
    """Of the key; None for the file itself, and for one of many tables."""
    table: type[BaseModel] | None
    """The table there, if one or many stand there."""


def _place(model: type[BaseModel], location: Location) -> _Location:
    place, many = _Location((), None, model), False
    for depth, part in enumerate(location):
        if many:
            place, many = _Location(location[: depth + 1], None, place.table), False
        elif place.table is None or part not in place.table.model_fields:
            break
        else:
            field = place.table.model_fields[str(part)]
            place = _Location(location[: depth + 1], field, _table_of(field))
            many = place.table is not None and _holds_many(field)
    return place


def _right(place: _Location) -> Right:
    last = place.known[-1]
    if place.field is None:
        many = isinstance(last, int)
        return Right(f"a table [[{place.known[-2]}]]" if many else f"a table [{key(place.known)}]")
    for note in _notes(place.field.annotation, place.field.metadata):
        if isinstance(note, Right):
            return note
    if place.table is None:
        return Right(_derived(place.field))
    if get_origin(place.field.annotation) is tuple:
        return Right(f"written as tables [[{last}]]", item=f"a table [[{last}]]")
    return Right(f"written as tables [{last}.NAME]" if _holds_many(place.field) else f"a table [{last}]")


def _derived(field: FieldInfo) -> str:
    """The words for a field that says nothing of itself, from its type and its bounds."""
    kind = field.annotation
    if get_args(kind) and get_origin(kind) is not Literal:  # it may be absent
        kind = next(one for one in get_args(kind) if one is not type(None))
    if get_origin(kind) is Literal:
        return wording.one_of(get_args(kind))
    if kind is bool:
        return "true or false"
    if kind is str:
        return "a text"
    assert kind in _BOUNDED, f"{field} does not say what is right"
    bounds = {name: getattr(note, name) for note in field.metadata for name in _BOUNDS if hasattr(note, name)}
    return f"{_BOUNDED[kind]} {wording.span(**bounds)}" if bounds else _UNBOUNDED[kind]


def _table_of(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a field holds, or many of; None for any other value."""
    for kind in (field.annotation, *get_args(field.annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _notes(annotation: object, notes: Sequence[object]) -> Iterator[object]:
    """What Annotated says about a type, also where it may be None."""
    yield from notes
    for part in get_args(annotation):
        yield from getattr(part, "__metadata__", ())


def _holds_many(field: FieldInfo) -> bool:
    return get_origin(field.annotation) in {tuple, dict}


def _value_at(content: object, location: Location) -> object:
    value = content
    for part in location:
        if isinstance(value, Mapping):
            value = value[part]
        else:
            assert isinstance(value, list) and isinstance(part, int)
            value = value[part]
    return value
