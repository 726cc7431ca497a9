"""The clocks of the robots of a field trial turned into one time, with what is known of the error.

A base stamps its steps on a grid of its own clock. Where clock and step count diverge, the base was
restarted, perhaps with another time: each such segment is a clock of its own. The bridge stamps radio events
by a clock of the same machine, which differs only if its time was set between the starts of both processes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from acrc_testbed.results.clock_alignment import (
    AlignmentParameters,
    Fit,
    Stamp,
    StampedFrame,
    StampKind,
    align,
)
from acrc_testbed.results.field_recordings import FieldTrial, FieldTrialError, Moment, RobotLog, Tick
from acrc_testbed.results.result import ClockReport
from actors.messages import Heard, Received

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


class _TickClock(NamedTuple):
    """Which clock stamped a step, and what is to be added to the instants of the events that it brings."""

    clock: int
    shift: int


class ClockSegments:
    """All clocks of a field trial, by number; each robot's in the order of time."""

    def __init__(self, trial: FieldTrial) -> None:
        self.clocks: list[ClockSegment] = []
        self.notes: list[str] = []
        """What was put right, a sentence each."""
        self._places: dict[int, list[_TickClock]] = {}
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
            places.append(_TickClock(len(self.clocks) - 1, shifts.get(number, 0)))
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
    lags = {
        tick: log.ticks[tick].instant - max(event.instant for event in received.events)
        for tick, received in log.of(Received)
        if received.events
    }
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


def shared_frames(trial: FieldTrial, stamp: Stamping) -> list[StampedFrame]:
    """Return the frames with stamps of at least two robots, in a fixed order.

    Frames of one sender with the same bytes are left out if they could be confused: one robot has sent or
    heard two of them. `stamp` makes a robot's record of a frame a stamp.
    """
    found: dict[tuple[int, bytes], list[tuple[str, Stamp]]] = {}
    for log in trial.all_logs():
        robot = log.identity.id
        for sent in log.sent_frames():
            seen = found.setdefault((log.identity.address, sent.data), [])
            seen.append((robot, stamp(log, sent.handed, StampKind.HANDED)))
            if sent.sent is not None:
                seen.append((robot, stamp(log, sent.sent, StampKind.SENT)))
        for tick, received in log.of(Received):
            for event in received.events:
                if isinstance(event, Heard):
                    seen = found.setdefault((event.sender, event.data), [])
                    seen.append((robot, stamp(log, Moment(tick, event.instant), StampKind.HEARD)))
    return [frame for seen in found.values() if (frame := _frame(seen)) is not None]


def _frame(seen: Sequence[tuple[str, Stamp]]) -> StampedFrame | None:
    """Return the sender's best stamp and all others; None if there are not two, or they are ambiguous."""
    sent, handed = (
        [one for _, one in seen if one.kind is kind] for kind in (StampKind.SENT, StampKind.HANDED)
    )
    heard = {robot: one for robot, one in seen if one.kind is StampKind.HEARD}
    stamps = (
        *(sent or handed),
        *heard.values(),
    )  # one that was never confirmed has left all the same if heard
    if len(handed) > 1 or len(stamps) < 2 or len(seen) != len(sent) + len(handed) + len(heard):
        return None
    return StampedFrame(stamps, handed[0] if handed else None)


_MOST_NOISE_US: Final = 1_000_000
"""Clocks that agree no better have not stamped the same frames."""


class _Chosen(NamedTuple):
    """The fit that a clock goes by; `known`: it is its own."""

    fit: Fit
    known: bool


class AlignedClocks:
    """Turns the instants of all robots into the time of one of them, the reference."""

    def __init__(self, trial: FieldTrial, parameters: AlignmentParameters | None = None) -> None:
        """Raises FieldTrialError if the recordings contradict one another."""
        self._segments = ClockSegments(trial)
        self._clocks = self._segments.clocks
        if not self._clocks:
            raise FieldTrialError(
                f"{', '.join(str(log.path) for log in trial.all_logs())}: no robot has taken a step in there"
            )
        frames = shared_frames(trial, self._segments.stamp)
        alignment = align(frames, len(self._clocks), parameters or AlignmentParameters())
        if alignment.noise_us > _MOST_NOISE_US:
            raise FieldTrialError(
                f"{', '.join(trial.logs)}: their clocks disagree by {alignment.noise_us / 1e6:.0f} s from "
                "one common frame to the next; the recordings should be of one field trial"
            )
        self._fits = alignment.fits
        self._main = self._largest_group()
        self._chosen = [self._choose(number) for number in range(len(self._clocks))]
        self._robots = list(dict.fromkeys(clock.robot for clock in self._clocks))
        for robot in self._robots:
            self._check_overlap(robot)
        unaligned = [sentence for robot in self._robots if (sentence := self._doubt(robot))]
        self.notes = [*self._segments.notes, *unaligned]
        """What was put right and what could not be, a sentence each."""

    @property
    def reference(self) -> str:
        """The robot whose time it is."""
        return self._clocks[self._main].robot

    @property
    def begin(self) -> int:
        """When the first robot took its first step, µs by the reference."""
        pairs = zip(self._clocks, self._chosen, strict=True)
        return min(chosen.fit.reference(clock.first) for clock, chosen in pairs)

    @property
    def span(self) -> int:
        """From there to the last step of all, µs."""
        pairs = zip(self._clocks, self._chosen, strict=True)
        return max(chosen.fit.reference(clock.last) for clock, chosen in pairs) - self.begin

    def instant(self, log: RobotLog, moment: Moment) -> int:
        """What the reference showed when the base's clock showed `moment`, µs."""
        return self._chosen[self._segments.clock(log, moment)].fit.reference(moment.instant)

    def reports(self, robot: str) -> tuple[ClockReport, ...]:
        """Every segment of the robot's clock."""
        begin = self.begin
        return tuple(self._report(number, begin) for number in self._segments.of(robot))

    def _largest_group(self) -> int:
        """The reference of the group with most robots, the first one of these."""
        robots: dict[int, set[str]] = {}
        for clock, fit in zip(self._clocks, self._fits, strict=True):
            robots.setdefault(fit.group, set()).add(clock.robot)
        return max(sorted(robots), key=lambda group: len(robots[group]))

    def _choose(self, number: int) -> _Chosen:
        """A clock's own fit; where frames do not connect it, that of the same robot's nearest one."""
        fit, clock = self._fits[number], self._clocks[number]
        if fit.group == self._main:
            return _Chosen(fit, known=True)
        kin = [one for one in self._segments.of(clock.robot) if self._fits[one].group == self._main]
        if not kin:
            return _Chosen(fit._replace(origin=clock.first, ahead=0, offset=0.0, drift_ppm=0.0), known=False)
        nearest = min(kin, key=lambda one: abs(one - number))
        return _Chosen(self._fits[nearest], known=False)

    def _known(self, robot: str) -> list[bool]:
        return [self._chosen[number].known for number in self._segments.of(robot)]

    def _doubt(self, robot: str) -> str | None:
        """What cannot be said of the robot's time."""
        known = self._known(robot)
        if all(known):
            return None
        if not any(known):
            return (
                f"{robot}: no frame connects its clock with that of {self.reference}, so its instants are "
                "left as its own clock gave them, with an error that is unknown"
            )
        return (
            f"{robot}: its clock was started again, and then no frame connects it with that of "
            f"{self.reference}; it is taken to have run on, with an error that is unknown"
        )

    def _check_overlap(self, robot: str) -> None:
        """A robot that no frame connects should at least have been out at the same time."""
        if any(self._known(robot)):
            return
        (first, last), (begin, end) = self._span(robot), self._span(self.reference)
        apart = max(first - end, begin - last) / 1e6
        if apart > 0:
            raise FieldTrialError(
                f"{self.reference} and {robot}: no frame connects their recordings, and {apart:.0f} s lie "
                "between them by their own clocks; the recordings should be of one field trial"
            )

    def _span(self, robot: str) -> tuple[int, int]:
        """By the robot's own clock."""
        clocks = [self._clocks[number] for number in self._segments.of(robot)]
        return min(clock.first for clock in clocks), max(clock.last for clock in clocks)

    def _report(self, number: int, begin: int) -> ClockReport:
        clock, (fit, known) = self._clocks[number], self._chosen[number]
        first, last = fit.reference(clock.first), fit.reference(clock.last)
        error = scatter = surely = 0.0
        if number != self._main:
            ends = (clock.first, clock.last)
            error = max(fit.error(end) for end in ends) + clock.doubt
            scatter = max(fit.scatter(end) for end in ends)
            surely = max(fit.surely_within(end) for end in ends) + clock.doubt
        return ClockReport(
            from_s=(first - begin) / 1e6,
            to_s=(last - begin) / 1e6,
            offset_s=(clock.first - first) / 1e6,
            drift_ppm=round(fit.drift_ppm, 3),
            error_s=round(error / 1e6, 6) if known else None,
            scatter_s=round(scatter / 1e6, 6) if known else None,
            surely_within_s=round(surely / 1e6, 6) if known and math.isfinite(surely) else None,
            frames=self._fits[number].frames,
        )
