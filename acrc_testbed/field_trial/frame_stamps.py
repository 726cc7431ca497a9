"""Timestamps that the clocks of several robots give to the same radio frames.

A base stamps its steps on a grid of its own clock. Where clock and step count diverge, the base was
restarted, perhaps with another time: each such segment is a clock of its own. The bridge stamps
radio events by a clock of the same machine, which differs only if the machine's time was set between the
starts of both processes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.field_trial.recordings import FieldTrial, Moment, RobotLog, Tick


class StampKind(IntEnum):
    """What a stamp says of its frame."""

    HEARD = 0
    SENT = 1
    """Confirmed by the sender's transceiver."""
    HANDED = 2
    """Given to the sender's transceiver, before it has left."""


class Stamp(NamedTuple):
    """One clock's word on one frame."""

    clock: int
    instant: int
    """µs, by that clock."""
    kind: StampKind


class StampedFrame(NamedTuple):
    """One frame and its stamps, by at least two clocks."""

    stamps: tuple[Stamp, ...]
    handed: Stamp | None
    """When it was handed over, whether or not that is among the stamps."""


class Pairs(NamedTuple):
    """Two stamps of one frame each, as arrays."""

    first: NDArray[np.int64]
    """(n, 4): clock, instant, kind, number of the frame."""
    second: NDArray[np.int64]
    weight: NDArray[np.float64]
    """2 / number of the frame's stamps: all pairs of n stamps know as much as n - 1 of them."""


def pairs_of(frames: Sequence[StampedFrame], most: int) -> Pairs:
    """All pairs of stamps of each frame; if there are more than `most`, those of every n-th frame only."""
    sizes = [len(frame.stamps) * (len(frame.stamps) - 1) // 2 for frame in frames]
    stride = -(-sum(sizes) // most) or 1
    first, second, weight = [], [], []
    for number, frame in enumerate(frames):
        if number % stride:
            continue
        for later, one in enumerate(frame.stamps):
            for other in frame.stamps[:later]:
                first.append((*one, number))
                second.append((*other, number))
                weight.append(2 / len(frame.stamps))
    return Pairs(
        np.array(first, dtype=np.int64).reshape(-1, 4),
        np.array(second, dtype=np.int64).reshape(-1, 4),
        np.array(weight, dtype=np.float64),
    )


_STEADY_US: Final = 50_000
"""A clock that jumps by more against the count of steps is another one."""
_SLOPE: Final = 1e-3
"""And so much of the time between: twice what an NTP daemon slews at most, 500 ppm (RFC 5905)."""
_AHEAD_US: Final = 1_000_000
"""An event so much ahead of the step that brings it was stamped by a clock that was set."""
_BEHIND_US: Final = 10_000_000
"""As was one so much behind it."""


@dataclass
class ClockSegment:
    """One clock, in µs by itself."""

    robot: str
    first: int
    """Its first step."""
    last: int
    doubt: int = 0
    """By how much events may be off against steps."""


class _ClockSegment(NamedTuple):
    """Which clock stamped a step, and what is to be added to the instants of the events that it brings."""

    clock: int
    shift: int


class ClockSegments:
    """All clocks of a field trial, by number; each robot's in the order of time."""

    def __init__(self, trial: FieldTrial) -> None:
        self.clocks: list[ClockSegment] = []
        self.notes: list[str] = []
        """What was put right, a sentence each."""
        self._places: dict[int, list[_ClockSegment]] = {}
        for robot, logs in trial.logs.items():
            before: Tick | None = None
            for log in logs:
                self._lay_out(robot, log, before)
                before = log.ticks[-1] if log.ticks else before

    def of(self, robot: str) -> list[int]:
        """The numbers of a robot's clocks."""
        return [number for number, clock in enumerate(self.clocks) if clock.robot == robot]

    def clock(self, log: RobotLog, moment: Moment) -> int:
        """The number of the clock that gives the time of the steps at that moment."""
        return self._places[id(log)][moment.tick].clock

    def stamp(self, log: RobotLog, moment: Moment, kind: StampKind) -> Stamp:
        """The robot's word on a frame, by the clock of its steps."""
        place = self._places[id(log)][moment.tick]
        shift = 0 if kind is StampKind.HANDED else place.shift
        return Stamp(place.clock, moment.instant + shift, kind)

    def _lay_out(self, robot: str, log: RobotLog, before: Tick | None) -> None:
        shifts = _shifts(log)
        places = self._places[id(log)] = []
        for number, tick in enumerate(log.ticks):
            if before is None or not _runs_on(before, tick, log.identity.step_us):
                self.clocks.append(ClockSegment(robot, tick.instant, tick.instant))
            self.clocks[-1].last = tick.instant
            places.append(_ClockSegment(len(self.clocks) - 1, shifts.get(number, 0)))
            before = tick
        for number in shifts:
            self.clocks[places[number].clock].doubt = log.identity.step_us
        if shifts:
            self.notes.append(
                f"{log.path}: the clock that stamps the frames was set while the one that stamps the steps "
                "ran on; put right to within a step"
            )


def _runs_on(before: Tick, tick: Tick, step_us: int) -> bool:
    """True if a clock has gone as far as the count of steps."""
    due = (tick.step - before.step) * step_us
    return abs(tick.instant - before.instant - due) <= _STEADY_US + _SLOPE * abs(due)


def _shifts(log: RobotLog) -> dict[int, int]:
    """By tick, what to add to the instants of its events where another clock has stamped them.

    The newest event of a message is not later than the step that brings it, and hardly earlier.
    """
    lags = {moment.tick: log.ticks[moment.tick].instant - moment.instant for moment in log.newest}
    runs: list[list[int]] = [[]]
    for tick, lag in lags.items():
        if _is_plausible(lag):
            runs.append([])
        elif runs[-1] and _is_plausible(lag - lags[runs[-1][0]]):
            runs[-1].append(tick)
        else:
            runs.append([tick])
    return {tick: min(lags[one] for one in run) for run in runs for tick in run}


def _is_plausible(lag: int) -> bool:
    return -_AHEAD_US <= lag <= _BEHIND_US


Stamping = Callable[[RobotLog, Moment, StampKind], Stamp]


@dataclass
class _Sightings:
    """Everything that is said of the frames of one sender with the same bytes."""

    sent: list[Stamp] = field(default_factory=list)
    handed: list[Stamp] = field(default_factory=list)
    heard: dict[str, list[Stamp]] = field(default_factory=dict)
    """By the robot that has heard it."""

    @property
    def is_unique(self) -> bool:
        """True if nobody has sent or heard two such frames."""
        return len(self.handed) <= 1 and all(len(stamps) == 1 for stamps in self.heard.values())


def shared_frames(trial: FieldTrial, stamp: Stamping) -> list[StampedFrame]:
    """The frames with stamps of at least two robots, in a fixed order, without those that might be mixed up.

    `stamp` makes a robot's word on a frame a stamp.
    """
    found: dict[tuple[int, bytes], _Sightings] = {}
    for log in trial.all_logs():
        identity = log.identity
        for sent in log.sent:
            sightings = found.setdefault((identity.address, sent.data), _Sightings())
            sightings.handed.append(stamp(log, sent.handed, StampKind.HANDED))
            if sent.sent is not None:
                sightings.sent.append(stamp(log, sent.sent, StampKind.SENT))
        for heard in log.heard:
            sightings = found.setdefault((heard.sender, heard.data), _Sightings())
            sightings.heard.setdefault(identity.id, []).append(stamp(log, heard.heard, StampKind.HEARD))
    return [
        frame
        for sightings in found.values()
        if sightings.is_unique and len((frame := _frame(sightings)).stamps) > 1
    ]


def _frame(sightings: _Sightings) -> StampedFrame:
    """The sender's best stamp and all others; one that was never confirmed has left all the same if heard."""
    heard = [stamp for stamps in sightings.heard.values() for stamp in stamps]
    handed = sightings.handed[0] if sightings.handed else None
    return StampedFrame((*(sightings.sent or sightings.handed), *heard), handed)
