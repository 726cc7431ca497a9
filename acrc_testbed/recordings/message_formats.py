"""Recorded messages and log lines as text, table rows, JSON and series of numbers."""

import base64
import csv
import io
import json
import re
import struct
import time
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum, auto
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from msgspec import inspect

from acrc_testbed.recordings.topics import (
    GrowingRecording,
    LoggedMessage,
    TopicError,
    has_ended,
    recording_files,
    short_key,
)
from actors.instant import in_seconds
from actors.messages import Scan
from actors.processes.robot_logs import LogTail, check_names, logged_robots
from actors.runtime.errors import printable
from actors.runtime.recording import Direction
from actors.runtime.replay_bus import topic_of
from actors.topic import Message

TAG: Final = "kind"
"""Field that names the variant of a union, such as `heard` in the events of RadioEvents."""


def to_json_types(value: object) -> Any:
    """Convert a value to JSON types: structs to dicts, bytes to base64, scans to ranges in mm."""
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        named: dict[str, Any] = {} if tag is None else {TAG: tag}
        return named | {name: to_json_types(_field(value, name)) for name in value.__struct_fields__}
    if isinstance(value, list | tuple):
        return [to_json_types(item) for item in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


def _field(value: msgspec.Struct, name: str) -> object:
    if isinstance(value, Scan) and name == "ranges_mm":
        count = len(value.ranges_mm) // 2
        return struct.unpack(f"<{count}H", value.ranges_mm[: 2 * count])
    return getattr(value, name)


def columns(kind: type[Message]) -> list[str]:
    """Return the columns of a message type, such as `odometry.x` or `pose[0]`; a variable tuple is one."""
    return _columns(inspect.type_info(kind), "")


def _columns(kind: inspect.Type, name: str) -> list[str]:
    if isinstance(kind, inspect.UnionType):
        present = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
        if len(present) == 1:
            return _columns(present[0], name)
    if isinstance(kind, inspect.StructType):
        prefix = f"{name}." if name else ""
        return [column for one in kind.fields for column in _columns(one.type, prefix + one.name)]
    if isinstance(kind, inspect.TupleType):
        parts = (_columns(one, f"{name}[{index}]") for index, one in enumerate(kind.item_types))
        return [column for part in parts for column in part]
    return [name]


def column_value(message: Message, column: str) -> Any:
    """Return the value of a column such as `robots[2].x` in JSON types, or None if it is absent.

    Raises LookupError for a column that this type of message does not have.
    """
    value: Any = message
    for part in column.replace("[", ".[").split("."):
        if value is None:
            return None
        if part.startswith("["):
            index = int(part.removeprefix("[").removesuffix("]"))
            if not isinstance(value, tuple):
                raise LookupError(column)
            value = value[index] if index < len(value) else None
        elif isinstance(value, msgspec.Struct) and part in value.__struct_fields__:
            value = _field(value, part)
        else:
            raise LookupError(column)
    return to_json_types(value)


class OutputFormat(Enum):
    """Output format of messages and log lines."""

    TEXT = auto()
    CSV = auto()
    JSON = auto()


_HASH_ONLY = "only the hash was recorded: no process received it"


def format_messages(recorded: Iterable[LoggedMessage], form: OutputFormat) -> Iterator[str]:
    """Format one line per message. Raises TopicError for a table of several message types."""
    return (
        csv_lines(recorded)
        if form is OutputFormat.CSV
        else map(_json_line if form is OutputFormat.JSON else format_message, recorded)
    )


def _json_line(one: LoggedMessage) -> str:
    message = one.message()
    head = {"seconds": in_seconds(one.instant), "key": short_key(one.key), "type": one.topic.kind.__name__}
    return json.dumps({**head, "message": None if message is None else to_json_types(message)})


def format_message(one: LoggedMessage) -> str:
    """Format simulated time, key and fields of a message as one line."""
    message = one.message()
    text = _HASH_ONLY if message is None else _fields(message)
    return printable(f"{in_seconds(one.instant):10.3f} s  {short_key(one.key)}  {text}")


def _fields(message: Message) -> str:
    return " ".join(f"{name}={_value_text(value)}" for name, value in to_json_types(message).items())


def _value_text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def csv_lines(recorded: Iterable[LoggedMessage]) -> Iterator[str]:
    """Format messages as CSV: a header, then one row per message with its time in simulated s.

    Raises TopicError for messages of several types.
    """
    topic = None
    names: list[str] = []
    for one in recorded:
        if topic is None:
            topic, names = one.topic, columns(one.topic.kind)
            yield csv_row(["seconds", "key", *names])
        if one.topic.kind is not topic.kind:
            raise TopicError(
                f"--csv: messages on {short_key(one.key)} have type {one.topic.kind.__name__}, earlier ones "
                f"{topic.kind.__name__}; give keys of one type, such as */drive"
            )
        message = one.message()
        cells = [None if message is None else column_value(message, name) for name in names]
        yield csv_row([in_seconds(one.instant), short_key(one.key), *map(_cell, cells)])


def _cell(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value


def csv_row(cells: list[Any]) -> str:
    """Format cells as a line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()


def series(recorded: Iterable[LoggedMessage], column: str) -> dict[str, tuple[list[float], list[float]]]:
    """Return times, s, and values of a numeric column, such as `odometry.x` or `robots[0].x`, by key.

    Messages without the column are left out. Raises TopicError if it is not a number.
    """
    found: dict[str, tuple[list[float], list[float]]] = {}
    for one in recorded:
        message = one.message()
        if message is None:
            continue
        value = _numeric_value(message, column, one.key)
        if value is not None:
            seconds, values = found.setdefault(one.key, ([], []))
            seconds.append(in_seconds(one.instant))
            values.append(value)
    if not found:
        raise TopicError(f"{column!r}: no message has a value")
    return found


def _numeric_value(message: Message, column: str, key: str) -> float | None:
    try:
        value = column_value(message, column)
    except (LookupError, ValueError):
        known = ", ".join(columns(type(message)))
        raise TopicError(f"{column!r}: not a field of {short_key(key)}; choose from {known}") from None
    if value is None:
        return None
    if not isinstance(value, int | float):
        text = msgspec.json.encode(value).decode()[:80]
        raise TopicError(f"{column!r}: {text} in {short_key(key)}; must be a number")
    return float(value)


_LOG: Final = "/log"
_POLL_S: Final = 0.1
_STAMP: Final = re.compile(r" *(\d+\.\d{3}) s  step \d+  ")


class LogLine(NamedTuple):
    """One line of a robot's log."""

    robot: str
    seconds: float
    """Simulated s; a line without a time has that of the previous line."""
    line: str


def is_log(key: str) -> bool:
    """Return True for the key of a log, such as `r1/log` or `*/log`."""
    return key.endswith(_LOG)


def read_logs(
    out: Path, keys: Sequence[str], begin: float, end: float | None, *, follow: bool
) -> Iterator[LogLine]:
    """Yield the lines of these logs; `follow`: also new ones until the run ends. Raises AcrcError."""
    if out.is_file():
        raise TopicError(f"{out}: a recording has no log; give a run's folder")
    names = [key.removesuffix(_LOG) for key in keys]
    check_names(names, logged_robots(out) or [*recording_files(out)], str(out))
    tail, now = LogTail(out, names), dict[str, float]()
    while follow and not has_ended(out):
        yield from _lines_within(tail.poll(), now, begin, end)
        time.sleep(_POLL_S)
    yield from _lines_within(tail.close(), now, begin, end)


def _lines_within(
    found: Iterable[tuple[str, str]], now: dict[str, float], begin: float, end: float | None
) -> Iterator[LogLine]:
    for robot, line in found:
        if stamp := _STAMP.match(line):
            now[robot] = float(stamp[1])
        seconds = now.setdefault(robot, 0.0)
        if begin <= seconds and (end is None or seconds <= end):
            yield LogLine(robot, seconds, line)


def format_logs(found: Iterable[LogLine], form: OutputFormat, *, named: bool) -> Iterator[str]:
    """Format log lines; `named`: prefix them with the robot."""
    if form is OutputFormat.CSV:
        yield csv_row(["seconds", "key", "text"])
    for one in found:
        text = _STAMP.sub("", one.line, count=1)
        if form is OutputFormat.JSON:
            yield json.dumps({"seconds": one.seconds, "key": one.robot + _LOG, "text": text})
        elif form is OutputFormat.CSV:
            yield csv_row([one.seconds, one.robot + _LOG, text])
        else:
            yield f"{one.robot}  {one.line}" if named else one.line


class KeyStatistics:
    """Statistics of the messages on one key over simulated time."""

    def __init__(self) -> None:
        self._instants: list[float] = []
        self._sizes: list[int] = []

    def add(self, one: LoggedMessage) -> None:
        """Add a message."""
        self._instants.append(in_seconds(one.instant))
        self._sizes.append(one.size)

    def figures(self, key: str) -> dict[str, Any]:
        """Return type, fields, number, sizes in bytes and intervals, s, of the messages.

        `hertz` is 0 and `shortest_s` None if all messages are of one step.
        """
        kind, count, size = topic_of(key).kind, len(self._sizes), sum(self._sizes)
        first, last, gaps = self._instants[0], self._instants[-1], np.diff(self._instants)
        hertz = (count - 1) / (last - first) if last > first else 0.0
        return {
            "key": short_key(key), "type": kind.__name__, "fields": columns(kind), "messages": count,
            "bytes": size, "first_s": first, "last_s": last, "hertz": hertz,
            "shortest_s": float(gaps.min()) if hertz else None, "longest_s": float(gaps.max(initial=0.0)),
            "spread_s": float(gaps.std()) if gaps.size else 0.0, "smallest": min(self._sizes),
            "largest": max(self._sizes), "bytes_per_s": size / count * hertz,
        }  # fmt: skip


def statistics_sentences(figures: dict[str, Any]) -> list[str]:
    """Describe the statistics of a key in words: fields, rate, sizes."""
    rate = ", all in one step"
    if figures["hertz"]:
        rate = (
            f": {figures['hertz']:.2f} Hz, {figures['shortest_s']:g} to {figures['longest_s']:g} s apart, "
            f"standard deviation {figures['spread_s']:.3f} s"
        )
    return [
        f"{figures['key']}  {figures['type']}: {', '.join(figures['fields'])}",
        f"  messages: {figures['messages']}, from {figures['first_s']:g} to {figures['last_s']:g} s{rate}",
        f"  {figures['bytes']} B, {figures['bytes'] / figures['messages']:.0f} B each on average, "
        f"{figures['smallest']} to {figures['largest']} B, {figures['bytes_per_s']:.0f} B/s",
    ]


def recording_statistics(target: Path) -> list[dict[str, Any]]:
    """Return statistics of all recordings in a run's folder, or of one recording. Raises RecordingError.

    `whole`: the process closed the file. `seals`: number of verified checksums. `commit`: version of the
    testbed that wrote it; empty without a first record.
    """
    return [_recording_statistics(actor, path) for actor, path in recording_files(target).items()]


def _recording_statistics(actor: str, path: Path) -> dict[str, Any]:
    rates: dict[tuple[Direction, str], KeyStatistics] = {}
    first = last = 0.0
    with GrowingRecording(path) as growing:
        for one in growing.poll():
            last = in_seconds(one.instant)
            first = first if rates else last
            rates.setdefault((one.direction, one.key), KeyStatistics()).add(one)
    keys = [{"direction": direction, **rate.figures(key)} for (direction, key), rate in rates.items()]
    run, reading = growing.run, growing.reading
    return {
        "actor": actor, "file": str(path), "messages": sum(one["messages"] for one in keys),
        "bytes": path.stat().st_size, "first_s": first, "last_s": last, "whole": reading.whole,
        "seals": reading.seals, "commit": "" if run is None else run.commit,
        "processor": "" if run is None else str(run.processor), "keys": keys,
    }  # fmt: skip


def recording_sentences(figures: dict[str, Any], *, topics: bool) -> list[str]:
    """Describe one recording in words; `topics`: with one line per key."""
    state = "complete" if figures["whole"] else "truncated or still open"
    where = f", on {figures['processor']}" if topics and figures["processor"] else ""
    first, last, size = figures["first_s"], figures["last_s"], figures["bytes"]
    lines = [
        f"{figures['actor']}: {figures['messages']} messages from {first:g} to {last:g} s, {state}; "
        f"{size} B, {_per_minute(size, first, last):.2f} MB per simulated minute; "
        f"{figures['seals']} checksums; commit {figures['commit'][:12] or 'unknown'}{where}"
    ]
    if topics:
        width = max((len(one["key"]) for one in figures["keys"]), default=0)
        for one in figures["keys"]:
            lines.append(
                f"  {one['direction']:3} {one['key']:{width}} {one['messages']:7} messages "
                f"{one['bytes']:9} B {one['hertz']:6.1f} Hz"
            )
    return lines


def _per_minute(size: int, first_s: float, last_s: float) -> float:
    """Return MB per simulated minute; 0 for a recording without duration."""
    return size / (last_s - first_s) * 60e-6 if last_s > first_s else 0.0


def total_sentence(found: Sequence[dict[str, Any]]) -> str:
    """Summarise all recordings of a run in one line."""
    size = sum(one["bytes"] for one in found)
    first, last = min(one["first_s"] for one in found), max(one["last_s"] for one in found)
    rate = f", {_per_minute(size, first, last):.2f} MB per simulated minute" if last > first else ""
    cut = sum(not one["whole"] for one in found)
    state = f"{cut} truncated or still open" if cut else "all complete"
    return f"{len(found)} recordings, {state}: {last - first:g} s, {size} B{rate}"
