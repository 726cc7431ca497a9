"""Recorded messages and log lines as text, table rows, JSON and series of numbers."""

import base64
import csv
import io
import json
import math
import re
import struct
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from msgspec import inspect

from acrc_testbed.recordings.topics import Growing, Recorded, TopicError, files, has_ended, short
from actors.instant import in_seconds
from actors.messages import Scan
from actors.processes.robot_logs import LogTail, check_names, robots
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.errors import printable
from actors.runtime.recording import Direction
from actors.topic import Message, Topic

TAG: Final = "kind"
"""The field that says which of several a value is, such as `heard` of the events of Received."""


def plain(value: object) -> Any:
    """The value as JSON has it: a dict for each part of a message, base64 for bytes, mm for a scan."""
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        named: dict[str, Any] = {} if tag is None else {TAG: tag}
        return named | {name: plain(_field(value, name)) for name in value.__struct_fields__}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


def _field(value: msgspec.Struct, name: str) -> object:
    if isinstance(value, Scan) and name == "ranges_mm":
        count = len(value.ranges_mm) // 2
        return struct.unpack(f"<{count}H", value.ranges_mm[: 2 * count])
    return getattr(value, name)


def columns(kind: type[Message]) -> list[str]:
    """The fields of a type of message as columns: `odometry.x`, `pose[0]`; a tuple of any length is one."""
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


def at_column(message: Message, column: str) -> Any:
    """The value at a column such as `robots[2].x`, as `plain` has it; None if the message has nothing there.

    Raises LookupError for a column that no message of this type has.
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
    return plain(value)


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


_LOG: Final = "/log"
_POLL_S: Final = 0.1
_STAMP: Final = re.compile(r" *(\d+\.\d{3}) s  step \d+  ")


class Printed(NamedTuple):
    """A line of a robot's log."""

    robot: str
    seconds: float
    """Simulated; of a line without a time that of the line before it."""
    line: str


def is_log(key: str) -> bool:
    """True for the key of a log: `r1/log`, `*/log`."""
    return key.endswith(_LOG)


def read_logs(
    out: Path, keys: Sequence[str], begin: float, end: float | None, *, follow: bool
) -> Iterator[Printed]:
    """Every line of these logs; with `follow` also what is added, to the run's end. Raises LogError."""
    if out.is_file():
        raise TopicError(f"{out}: a recording, which has no log; must be a run's folder")
    wanted = [key.removesuffix(_LOG) for key in keys]
    check_names(wanted, robots(out), str(out))
    tail, now = LogTail(out, wanted), dict[str, float]()
    while follow and not has_ended(out):
        yield from _within(tail.poll(), now, begin, end)
        time.sleep(_POLL_S)
    yield from _within(tail.close(), now, begin, end)


def _within(
    found: Iterable[tuple[str, str]], now: dict[str, float], begin: float, end: float | None
) -> Iterator[Printed]:
    for robot, line in found:
        if stamp := _STAMP.match(line):
            now[robot] = float(stamp[1])
        seconds = now.setdefault(robot, 0.0)
        if begin <= seconds and (end is None or seconds <= end):
            yield Printed(robot, seconds, line)


def shown_logs(found: Iterable[Printed], form: LineForm, *, named: bool) -> Iterator[str]:
    """Lines as they are printed; `named`: with the robot in front."""
    if form is LineForm.CSV:
        yield row(["seconds", "key", "text"])
    for one in found:
        text = _STAMP.sub("", one.line, count=1)
        if form is LineForm.JSON:
            yield json.dumps({"seconds": one.seconds, "key": one.robot + _LOG, "text": text})
        elif form is LineForm.CSV:
            yield row([one.seconds, one.robot + _LOG, text])
        else:
            yield f"{one.robot}  {one.line}" if named else one.line


@dataclass
class Rate:
    """Of the messages on one key, as they are taken in."""

    count: int = 0
    size: int = 0
    """Bytes, of all."""
    smallest: int = 0
    largest: int = 0
    first: float = math.nan
    """Simulated s, of the step of the first message ..."""
    last: float = math.nan
    """... and of the last one."""
    shortest: float = math.inf
    """Between two messages, s."""
    longest: float = 0.0
    _squares: float = field(default=0.0, repr=False)

    def take(self, one: Recorded) -> None:
        """One more message."""
        second = in_seconds(one.instant)
        if self.count:
            gap = second - self.last
            self.shortest, self.longest = min(self.shortest, gap), max(self.longest, gap)
            self._squares += gap * gap
        else:
            self.first, self.smallest = second, one.size
        self.count += 1
        self.last = second
        self.size += one.size
        self.smallest, self.largest = min(self.smallest, one.size), max(self.largest, one.size)

    @property
    def span(self) -> float:
        """From the first message to the last one, s."""
        return self.last - self.first if self.count else 0.0

    @property
    def hertz(self) -> float:
        """Messages per simulated second; 0 where there are not two of different steps."""
        return (self.count - 1) / self.span if self.span > 0 else 0.0

    @property
    def bytes_per_second(self) -> float:
        """Per simulated second; 0 as above."""
        return self.size / self.count * self.hertz if self.count else 0.0

    @property
    def spread(self) -> float:
        """Standard deviation of the time between two messages, s."""
        gaps = self.count - 1
        return math.sqrt(max(0.0, self._squares / gaps - (self.span / gaps) ** 2)) if gaps > 0 else 0.0


def rate_sentences(key: str, rate: Rate) -> list[str]:
    """What is on a key: its fields, how often, how much."""
    kind = topic_of(key).kind
    return [
        f"{short(key)}  {kind.__name__}: {', '.join(columns(kind))}",
        f"  {rate.count} messages from {rate.first:g} to {rate.last:g} s{_often(rate)}",
        f"  {rate.size} B, {rate.size / rate.count:.0f} B each on average, {rate.smallest} to "
        f"{rate.largest} B, {rate.bytes_per_second:.0f} B/s",
    ]


def _often(rate: Rate) -> str:
    if not rate.hertz:
        return ", all of one step"
    return (
        f": {rate.hertz:.2f} Hz, {rate.shortest:g} to {rate.longest:g} s apart, "
        f"standard deviation {rate.spread:.3f} s"
    )


def rate_as_json(key: str, rate: Rate) -> dict[str, Any]:
    """The same as plain values."""
    kind = topic_of(key).kind
    return {
        "key": short(key), "type": kind.__name__, "fields": columns(kind), "messages": rate.count,
        "bytes": rate.size, "first_s": rate.first, "last_s": rate.last, "hertz": rate.hertz,
        "shortest_s": rate.shortest if rate.hertz else None, "longest_s": rate.longest,
        "spread_s": rate.spread, "smallest": rate.smallest, "largest": rate.largest,
        "bytes_per_s": rate.bytes_per_second,
    }  # fmt: skip


@dataclass
class RecordingInfo:
    """One process's recording."""

    actor: str
    path: Path
    size: int
    """Bytes."""
    seals: int = 0
    """Checksums, all of them true."""
    whole: bool = False
    """True: the process closed it. False: it was cut, or the run goes on."""
    commit: str = ""
    """Of the testbed that wrote it; empty where not even the first record is there."""
    processor: str = ""
    topics: dict[tuple[Direction, str], Rate] = field(default_factory=dict)
    """By direction and key, in the order in which they occur."""
    first: float = 0.0
    """Simulated s, when the step of its first message began ..."""
    last: float = 0.0
    """... and that of its last one."""

    @property
    def messages(self) -> int:
        """In it, in both directions."""
        return sum(rate.count for rate in self.topics.values())

    @property
    def bytes_per_minute(self) -> float:
        """Of the file, per simulated minute; 0 for one without a span."""
        return self.size / (self.last - self.first) * 60 if self.last > self.first else 0.0


def info(target: Path) -> list[RecordingInfo]:
    """Of every recording in a run's folder, or of the one that is named. Raises RecordingError."""
    return [_read(actor, path) for actor, path in files(target).items()]


def _read(actor: str, path: Path) -> RecordingInfo:
    found = RecordingInfo(actor, path, path.stat().st_size)
    instants: list[float] = []
    with Growing(path) as growing:
        for one in growing.poll():
            found.topics.setdefault((one.direction, one.key), Rate()).take(one)
            instants[1:] = [in_seconds(one.instant)]
        found.seals, found.whole = growing.reading.seals, growing.reading.whole
        if growing.run is not None:
            found.commit = growing.run.commit
            found.processor = str(growing.run.processor)
    if instants:
        found.first, found.last = instants[0], instants[-1]
    return found


def as_json(found: RecordingInfo) -> dict[str, Any]:
    """One recording as plain values."""
    return {
        "actor": found.actor, "file": str(found.path), "messages": found.messages, "bytes": found.size,
        "first_s": found.first, "last_s": found.last, "whole": found.whole, "seals": found.seals,
        "commit": found.commit, "processor": found.processor,
        "keys": [{"direction": way, **rate_as_json(key, rate)} for (way, key), rate in found.topics.items()],
    }  # fmt: skip


def sentences(found: RecordingInfo, *, topics: bool) -> list[str]:
    """What it says of one recording, a line each; `topics`: with a line for each key."""
    state = "whole" if found.whole else "cut, or not closed yet"
    where = f", on {found.processor}" if topics and found.processor else ""
    lines = [
        f"{found.actor}: {found.messages} messages from {found.first:g} to {found.last:g} s, {state}; "
        f"{found.size} B, {found.bytes_per_minute / 1e6:.2f} MB per simulated minute; {found.seals} seals; "
        f"commit {found.commit[:12] or 'unknown'}{where}"
    ]
    if topics:
        width = max((len(short(key)) for _, key in found.topics), default=0)
        for (direction, key), rate in found.topics.items():
            lines.append(
                f"  {direction:3} {short(key):{width}} {rate.count:7} messages {rate.size:9} B "
                f"{rate.hertz:6.1f} Hz"
            )
    return lines


def total(found: Sequence[RecordingInfo]) -> str:
    """What it says of all recordings of a run."""
    size = sum(one.size for one in found)
    span = max(one.last for one in found) - min(one.first for one in found)
    rate = f", {size / span * 60 / 1e6:.2f} MB per simulated minute" if span > 0 else ""
    cut = sum(not one.whole for one in found)
    state = f"{cut} cut, or not closed yet" if cut else "all whole"
    return f"{len(found)} recordings, {state}: {span:g} s, {size} B{rate}"
