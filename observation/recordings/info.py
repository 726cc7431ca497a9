"""Size, messages and rates of each recording and key of a run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from actors.instant import in_seconds
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.recording import Direction
from observation.recordings.lines import columns
from observation.recordings.topics import Growing, Recorded, files, short


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
