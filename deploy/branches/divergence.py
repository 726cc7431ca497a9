"""Where two runs that begin alike part: the first message that differs, and each robot's first."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.instant import in_seconds
from actors.messages import DRIVE, RECEIVED, ROSTER, SENSES, TRANSMIT, TRUTH, Truth
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.codec import decode
from actors.runtime.difference import first_difference
from actors.runtime.recording import Entry, read_recording
from actors.topic import sender
from actors.wording import brief
from observation.replay.record_pass import STAMP, read_pass
from observation.replay.run_recordings import recordings

_ORDER: Final = tuple(topic.pattern for topic in (RECEIVED, SENSES, TRANSMIT, DRIVE, ROSTER, TRUTH))
"""In a step, causes before effects: Senses counts what Received brings. So does Aired, a step before."""


@dataclass(frozen=True)
class Divergence:
    """Where two runs part."""

    step: int
    key: str
    words: str
    """Step, message, field and both values."""
    robots: Mapping[str, float]
    """When each robot first did otherwise, s; absent: never."""


class _Difference(NamedTuple):
    """A message that one run has, and the other has otherwise or not at all; sorted by what comes first."""

    step: int
    rank: int
    key: str
    one: bytes | None
    """The hash of the message in the first run; None if it is missing."""
    other: bytes | None


class _Trails:
    """What world and radio of one run have sent and taken, by key."""

    def __init__(self, out: Path) -> None:
        self._files = recordings(out)
        self.trails: dict[str, list[tuple[int, bytes]]] = {}
        for actor in ("world", "radio"):
            for (_, key), trail in read_pass(actor, self._files[actor]).trails.items():
                if topic_of(key).pattern in _ORDER:
                    self.trails.setdefault(key, list(STAMP.iter_unpack(bytes(trail))))

    def message(self, sha256: bytes, actors: Sequence[str]) -> bytes | None:
        """The bytes with this hash, as one of these actors has received them."""
        for actor, path in self._files.items():
            if not any(actor == one or actor.startswith(f"{one}.") for one in actors):
                continue
            for item in read_recording(path):
                if isinstance(item, Entry) and item.sha256 == sha256 and item.payload is not None:
                    return item.payload
        return None


def divergence(one: Path, other: Path, step_us: int, name: str = "run") -> Divergence | None:
    """Where the recordings of `other` part from those of `one`, which is called `name`; None: never.

    That a jammer is switched on, or a loss ordered, is a change that somebody made, not what follows from it.
    """
    first, second = _Trails(one), _Trails(other)
    places = sorted(
        place
        for key in dict.fromkeys((*first.trails, *second.trails))
        for place in _places(key, first.trails.get(key, []), second.trails.get(key, []))
    )
    robots: dict[str, float] = {}
    for place in places:
        robot = sender(place.key)
        if robot is not None:
            robots.setdefault(robot, in_seconds(place.step * step_us))
    for place in places:
        words = _words(place, first, second, name)
        if words is not None:
            return Divergence(place.step, place.key, f"step {place.step}: {place.key}: {words}", robots)
    return None


def _places(
    key: str, one: Sequence[tuple[int, bytes]], other: Sequence[tuple[int, bytes]]
) -> Iterator[_Difference]:
    """The messages on a key that differ, up to the first that cannot come of what was ordered alone."""
    rank, again = _ORDER.index(topic_of(key).pattern), dict(other)
    there = dict(one)
    for step in sorted(there.keys() | again.keys()):
        if there.get(step) != again.get(step):
            yield _Difference(step, rank, key, there.get(step), again.get(step))
            if key != TRUTH.key():
                return


def _words(place: _Difference, first: _Trails, second: _Trails, name: str) -> str | None:
    """What differs; None if it is a jammer or an ordered loss alone."""
    topic = topic_of(place.key)
    robot = place.key.split("/")[2]
    receivers = ("radio",) if topic in (TRUTH, TRANSMIT) else ("world",) if topic == DRIVE else (robot,)
    found = [
        None if sha256 is None else trails.message(sha256, receivers)
        for sha256, trails in ((place.one, first), (place.other, second))
    ]
    then, now = (None if data is None else decode(topic, place.key, data) for data in found)
    if place.one is None:
        return f"only in the branch: {brief(now)}"
    if place.other is None:
        return f"only in the {name}: {brief(then)}"
    if isinstance(now, Truth) and isinstance(then, Truth):
        now, then = (msgspec.structs.replace(truth, jams=(), losses=()) for truth in (now, then))
        if now == then:
            return None
    found_at = None if now is None or then is None else first_difference(now, then)
    if found_at is None:
        return "other bytes"
    return f"{found_at.field} is {brief(found_at.one)}; in the {name} it was {brief(found_at.other)}"
