"""Recorded messages as lines for a person, as rows of a table, and as series of numbers."""

import csv
import io
import json
from collections.abc import Iterable, Iterator
from enum import Enum, auto
from typing import Any

import msgspec

from actors.instant import in_seconds
from actors.runtime.errors import printable
from actors.topic import Message, Topic
from observation.recordings.plain import at_column, columns, plain
from observation.recordings.topics import Recorded, TopicError, short


class LineForm(Enum):
    """How lines are printed."""

    TEXT = auto()
    CSV = auto()
    JSON = auto()


_HASH_ONLY = "only its hash was kept: nobody took it"


def shown(recorded: Iterable[Recorded], form: LineForm) -> Iterator[str]:
    """A line for each message. Raises TopicError for a table of messages of several types."""
    return (
        table(recorded) if form is LineForm.CSV else map(_object if form is LineForm.JSON else line, recorded)
    )


def _object(one: Recorded) -> str:
    message = one.message()
    told = {"seconds": in_seconds(one.instant), "key": short(one.key), "type": one.topic.kind.__name__}
    return json.dumps({**told, "message": None if message is None else plain(message)})


def line(one: Recorded) -> str:
    """Simulated time, key and fields, in one line."""
    message = one.message()
    said = _HASH_ONLY if message is None else _fields(message)
    return printable(f"{in_seconds(one.instant):10.3f} s  {short(one.key)}  {said}")


def _fields(message: Message) -> str:
    return " ".join(f"{name}={_shown(value)}" for name, value in plain(message).items())


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def table(recorded: Iterable[Recorded]) -> Iterator[str]:
    """The same as CSV: a header, then a row for each message; times in simulated s.

    Raises TopicError where there are messages of several types.
    """
    topic: Topic[Message] | None = None
    names: list[str] = []
    for one in recorded:
        if topic is None:
            topic, names = one.topic, columns(one.topic.kind)
            yield row(["seconds", "key", *names])
        if one.topic.kind is not topic.kind:
            raise TopicError(
                f"--csv: messages on {short(one.key)} are {one.topic.kind.__name__}, and those before are "
                f"{topic.kind.__name__}; must be keys of one type, such as */drive"
            )
        message = one.message()
        cells = [None if message is None else at_column(message, name) for name in names]
        yield row([in_seconds(one.instant), short(one.key), *map(_cell, cells)])


def _cell(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value


def row(cells: list[Any]) -> str:
    """Cells as a line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()


def series(recorded: Iterable[Recorded], column: str) -> dict[str, tuple[list[float], list[float]]]:
    """A numeric field of messages, such as `vx`, `odometry.x` or `robots[0].x`: by key seconds and values.

    Without what messages say nothing of. Raises TopicError where it is no number.
    """
    found: dict[str, tuple[list[float], list[float]]] = {}
    for one in recorded:
        message = one.message()
        if message is None:
            continue
        value = _number(message, column, one.key)
        if value is not None:
            seconds, values = found.setdefault(one.key, ([], []))
            seconds.append(in_seconds(one.instant))
            values.append(value)
    if not found:
        raise TopicError(f"{column!r}: no message says anything of it")
    return found


def _number(message: Message, column: str, key: str) -> float | None:
    try:
        value = at_column(message, column)
    except (LookupError, ValueError):
        there = ", ".join(columns(type(message)))
        raise TopicError(f"{column!r}: no field of {short(key)}; there are {there}") from None
    if value is None:
        return None
    if not isinstance(value, int | float):
        shown = msgspec.json.encode(value).decode()[:80]
        raise TopicError(f"{column!r}: is {shown} in {short(key)}; must be a number")
    return float(value)
