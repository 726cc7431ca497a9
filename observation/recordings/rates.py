"""How often messages come and how much they weigh, in simulated time."""

import math
from dataclasses import dataclass, field
from typing import Any

from actors.instant import in_seconds
from actors.runtime.bus.replay_bus import topic_of
from observation.recordings.plain import columns
from observation.recordings.topics import Recorded, short


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


def sentences(key: str, rate: Rate) -> list[str]:
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


def as_json(key: str, rate: Rate) -> dict[str, Any]:
    """The same as plain values."""
    kind = topic_of(key).kind
    return {
        "key": short(key), "type": kind.__name__, "fields": columns(kind), "messages": rate.count,
        "bytes": rate.size, "first_s": rate.first, "last_s": rate.last, "hertz": rate.hertz,
        "shortest_s": rate.shortest if rate.hertz else None, "longest_s": rate.longest,
        "spread_s": rate.spread, "smallest": rate.smallest, "largest": rate.largest,
        "bytes_per_s": rate.bytes_per_second,
    }  # fmt: skip
