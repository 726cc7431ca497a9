"""Fates of frames and their copies, from a replay of the radio: whole, as arrays, and while a run goes on.

Recordings have what was heard. Who has not heard a frame, and why, the medium knows alone. It is this
project's own code, so it is replayed in this process; what came of it is kept like a robot's trace.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from acrc_testbed.replay.record_replay import GrowingReplay, Onlook, made_again, replay_actor
from acrc_testbed.replay.run_recordings import recordings, setup_of
from acrc_testbed.trace.traces import inputs, keep, kept
from actors.radio.core import RadioCore
from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Kind, Outcome
from actors.radio.radio_model import RadioSetup
from actors.radio.robot_medium import RobotMedium
from actors.runtime.core import Core

_SHORTEST_PAUSE_NS: Final = 190_000
"""Between two frames of one transceiver there is at least the turnaround, 192 µs."""
_ENDS: Final = {
    int(Kind.SENT): "sent",
    int(Kind.ACCESS_FAILURE): "access_failure",
    int(Kind.OVERFLOW): "overflow",
}


class CopyFate(NamedTuple):
    """What became of a frame at one other robot."""

    robot: str
    fate: str
    """`heard`, or why not: a name of `actors.radio.medium.state.Outcome` in lower case."""
    strength_dbm: float
    """How strongly it came there, whether it was heard or not; -inf: too weakly to count at all."""


class FrameFate(NamedTuple):
    """What became of one frame that a transceiver was handed."""

    robot: str
    tag: int
    """As its robot knows it; another one for each of the robot's frames."""
    handed: int
    """µs."""
    ended: int
    """When it had left the antenna, or was given up, µs."""
    size: int
    """Bytes of its data."""
    fate: str
    """`sent`, `access_failure` or `overflow`."""
    copies: tuple[CopyFate, ...]
    """At every other robot whose transceiver was on when it began; none of one that was not sent."""


def frame_fates(out: Path) -> list[FrameFate]:
    """Every frame of a simulated run that came to its end, in the order in which they did.

    Raises ReplayError if the radio does not do again what it did, RecordingError for damaged recordings.
    """
    path = recordings(out).get("radio")
    found = None if path is None else _kept(path)
    if path is None or found is not None:
        return found or replayed(out)
    came_of = inputs(path)
    found = replayed(out)
    keep(path, came_of, [msgspec.msgpack.encode(found)])
    return found


def replayed(out: Path) -> list[FrameFate]:
    """The same from a replay, whatever was kept."""
    watch = FrameWatch()
    replay_actor(out, "radio", Onlook(watch.prepare))
    return watch.found


def _kept(path: Path) -> list[FrameFate] | None:
    """What was kept, if it makes sense."""
    names = {outcome.name.lower() for outcome in Outcome}
    try:
        robots = {robot for robot, _ in setup_of(path, RadioSetup, "a radio").robots}
        found = [msgspec.msgpack.decode(part, type=list[FrameFate]) for part in kept(path) or ()]
    except (ValueError, RecursionError):
        return None
    frames = [frame for part in found for frame in part]
    known = all(
        frame.robot in robots and all(one.robot in robots and one.fate in names for one in frame.copies)
        for frame in frames
    )
    return frames if found and known else None


class FrameWatch:
    """Looks at the medium whenever a frame has ended and its sender cannot have begun another one."""

    _robots: RobotMedium
    _medium: Medium
    _ids: tuple[str, ...]

    def __init__(self) -> None:
        self.found: list[FrameFate] = []
        self._waiting: Counter[int] = Counter()
        """Frames by transceiver of which it is not known yet what became of them."""

    def prepare(self, core: Core, step_us: int) -> None:
        """Look on from now on."""
        assert isinstance(core, RadioCore)
        self._ids, self._robots = core.robots, core.robot_medium
        medium = self._medium = core.robot_medium.medium
        submit, run, finish, switch = medium.submit, medium.run, medium.finish_frames, medium.switch

        def submitted(requests: Iterable[Request]) -> None:
            given = list(requests)
            self._waiting.update(one.transceiver for one in given)
            submit(given)

        def ran(until_ns: int) -> NDArray[np.void]:
            return np.concatenate(list(self._slices(run, until_ns)))

        def finished() -> NDArray[np.void]:
            return self._noted(finish())

        def switched(transceiver: int, powered: bool) -> None:
            switch(transceiver, powered)
            if not powered:
                del self._waiting[transceiver]

        seen = cast(Any, medium)
        seen.submit, seen.run, seen.finish_frames, seen.switch = submitted, ran, finished, switched

    @property
    def instant(self) -> int:
        """Until when it is known what became of frames, µs."""
        return self._medium.now_ns // 1000

    def _slices(self, run: Any, until_ns: int) -> Iterator[NDArray[np.void]]:
        """At once, but for while somebody has two frames to send: nothing depends on how time is cut."""
        while True:
            several = any(count > 1 for count in self._waiting.values())
            end_ns = min(until_ns, self._medium.now_ns + _SHORTEST_PAUSE_NS) if several else until_ns
            yield self._noted(run(end_ns))
            if end_ns >= until_ns:
                return

    def _noted(self, events: NDArray[np.void]) -> NDArray[np.void]:
        for event in events:
            fate = _ENDS.get(int(event["kind"]))
            if fate is not None:
                number = int(event["transceiver"])
                self._waiting[number] -= 1
                self._note(number, int(event["tag"]), int(event["instant_ns"]) // 1000, fate)
        return events

    def _note(self, number: int, serial: int, instant: int, fate: str) -> None:
        frame = self._robots.handed(number, serial)
        copies = tuple(self._copies(number)) if fate == "sent" else ()
        self.found.append(
            FrameFate(self._ids[number], frame.tag, frame.instant, instant, len(frame.data), fate, copies)
        )

    def _copies(self, number: int) -> Iterator[CopyFate]:
        outcomes, powers_mw = self._medium.frame_outcomes(number)
        for other, (outcome, power) in enumerate(zip(outcomes.tolist(), powers_mw.tolist(), strict=True)):
            if outcome != Outcome.NOT_COUNTED:
                strength = 10.0 * math.log10(power) if power > 0.0 else -math.inf
                yield CopyFate(self._ids[other], Outcome(outcome).name.lower(), round(strength, 1))


LOSSES: Final = tuple(
    one for one in Outcome if one not in (Outcome.HEARD, Outcome.FILTERED, Outcome.NOT_COUNTED)
)
"""Why a copy may be lost."""


@dataclass(frozen=True, eq=False)
class Fates:
    """Copies of frames, in the order of the instants at which these ended; (n,) each."""

    seconds: NDArray[np.float64]
    senders: NDArray[np.int64]
    """Index among the robots."""
    receivers: NDArray[np.int64]
    outcomes: NDArray[np.int64]
    """Of `Outcome`."""

    def part(self, which: NDArray[np.bool_]) -> "Fates":
        """Those that are wanted, (n,)."""
        return Fates(self.seconds[which], self.senders[which], self.receivers[which], self.outcomes[which])


def read_fates(out: Path, robots: tuple[str, ...]) -> Fates:
    """Of a run; its radio is replayed unless that was done before. AcrcError where that goes wrong.

    `robots`: in the order of the scenario.
    """
    return fates_of(frame_fates(out), robots)


def fates_of(frames: Iterable[FrameFate], robots: tuple[str, ...]) -> Fates:
    """What became of the copies of frames; `robots`: in the order of the scenario."""
    place = {robot: number for number, robot in enumerate(robots)}
    filtered = Outcome.FILTERED.name.lower()
    found = [
        (frame.ended, place[frame.robot], place[copy.robot], Outcome[copy.fate.upper()])
        for frame in frames
        for copy in frame.copies
        if copy.fate != filtered
    ]
    instants, senders, receivers, outcomes = np.array(found, np.int64).reshape(-1, 4).T
    return Fates(instants / 1e6, senders, receivers, outcomes)


def by_outcome(fates: Fates, begin: float, bins: int, bin_s: float) -> NDArray[np.float64]:
    """(bins, outcomes): copies per second from `begin` on, s, by what became of them; the last bin has what
    is later, too."""
    table = np.zeros((bins, len(Outcome)))
    places = np.clip(((fates.seconds - begin) / bin_s).astype(np.int64), 0, bins - 1)
    np.add.at(table, (places, fates.outcomes), 1)
    return table / bin_s


def fate_name(outcome: Outcome) -> str:
    """In words: "half duplex"."""
    return outcome.name.lower().replace("_", " ")


class GrowingFates:
    """Follows the radio, which is this project's own code; a context manager that closes its recording."""

    def __init__(self, out: Path, robots: tuple[str, ...]) -> None:
        """`robots`: in the order of the scenario. AcrcError where there is no radio that has begun."""
        self._robots = robots
        self._watch = FrameWatch()
        self._replay = GrowingReplay(made_again(out, "radio", Onlook(self._watch.prepare)))
        self._parts: list[bytes] = []
        """To be kept at the end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._replay.__exit__()

    def poll(self, budget_s: float) -> tuple[Fates, float, bool]:
        """What is new after about so long of computing; until when it is known, s; whether that is all.

        Raises ReplayError where the radio does otherwise than it did, RecordingError for a damaged file.
        """
        whole = self._replay.advance(budget_s)
        found, self._watch.found = self._watch.found, []
        self._parts += [msgspec.msgpack.encode(found)] if found else []
        if self._replay.ended and self._parts:
            self._replay.settle()
            keep(self._replay.path, inputs(self._replay.path), self._parts)
            self._parts = []
        return fates_of(found, self._robots), self._watch.instant / 1e6, whole
