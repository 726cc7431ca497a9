"""What each recording of a run holds, in figures."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from actors.instant import in_seconds
from actors.runtime.recording import Direction
from observation.recordings import rates
from observation.recordings.rates import Rate
from observation.recordings.topics import Growing, files, short


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
        "keys": [{"direction": way, **rates.as_json(key, rate)} for (way, key), rate in found.topics.items()],
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
