"""What is wrong with a value in a table, in one sentence: the key, the value, and what would be right."""

from collections.abc import Iterator, Mapping, Sequence
from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from actors import wording
from actors.wording import shown
from deploy.scenario.kinds import Right


def sentence(model: type[BaseModel], kind: str, location: Sequence[str | int], content: object) -> str:
    """The error `kind` (pydantic's name for it) at a location in `content`, as a sentence without its end."""
    if kind == "extra_forbidden":
        return unknown_key(_table_at(model, location[:-1]), location)
    known = _known_part(model, location)
    right = right_at(model, location)
    if kind == "missing" and len(known) == len(location):
        return f"{key(known)} is missing, but must be {right.words}"
    if right.item and len(location) > len(known):
        known, words = location[: len(known) + 1], right.item
    else:
        words = right.words
    return f"{key(known)} is {shown(_value_at(content, known))}, but must be {words}"


def unknown_key(table: type[BaseModel], location: Sequence[str | int]) -> str:
    """The last part of `location` is no key of `table`."""
    *parents, name = location
    return wording.unknown_key(key(parents), str(name), table.model_fields)


def right_at(model: type[BaseModel], location: Sequence[str | int]) -> Right:
    """What would be right at a location."""
    known = _known_part(model, location)
    last = known[-1]
    if isinstance(last, int):
        return Right(f"a table [[{known[-2]}]]")
    field = _table_at(model, known[:-1]).model_fields[last]
    for note in _notes(field.annotation, field.metadata):
        if isinstance(note, Right):
            return note
    kind = _kind(field)
    if kind is not None and _holds_many(field):
        return Right(f"written as tables [[{last}]]", item=f"a table [[{last}]]")
    assert kind is not None, f"{key(known)} does not say what is right"
    return Right(f"a table [{last}]")


def key(location: Sequence[str | int]) -> str:
    """A location as a dotted path with indices: ("event", 3, "at") is event[3].at."""
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def _known_part(model: type[BaseModel], location: Sequence[str | int]) -> Sequence[str | int]:
    """The beginning of a location that names tables and keys, without what leads into a key's value."""
    table: type[BaseModel] | None = model
    for depth, part in enumerate(location):
        if isinstance(part, str):
            if table is None or part not in table.model_fields:
                return location[:depth]
            field = table.model_fields[part]
            table = _kind(field)
        elif table is None:
            return location[:depth]
    return location


def _table_at(model: type[BaseModel], location: Sequence[str | int]) -> type[BaseModel]:
    """The table that a location leads to."""
    table = model
    for part in location:
        if isinstance(part, str):
            kind = _kind(table.model_fields[part])
            assert kind is not None
            table = kind
    return table


def _kind(field: FieldInfo) -> type[BaseModel] | None:
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
    return bool(get_args(field.annotation))


def _value_at(content: object, location: Sequence[str | int]) -> object:
    value = content
    for part in location:
        if isinstance(value, Mapping):
            value = value[part]
        else:
            assert isinstance(value, list) and isinstance(part, int)
            value = value[part]
    return value
