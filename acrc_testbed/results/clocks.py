"""The clocks of the robots of a field trial turned into one time, with what is known of the error.

A base stamps its steps on a grid of its own clock. Where clock and step count diverge, the base was
restarted, perhaps with another time: each such segment is a clock of its own. The bridge stamps radio events
by a clock of the same machine, which differs only if its time was set between the starts of both processes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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


_MOST_NOISE_US: Final = 1_000_000
"""Clocks that agree no better have not stamped the same frames."""


@dataclass
class ClockSegment:
    """One clock of a robot, until it is set; instants in µs by itself."""

    robot: str
    first: int
    """Its first step."""
    last: int
    doubt: int = 0
    """By how much events may be off against steps."""
    fit: Fit = field(init=False)
    """Its own, or else that of the robot's nearest segment that frames connect with the reference."""
    known: bool = False
    """True if it is its own."""
    frames: int = 0
    """Frames in common with other clocks."""


class _StepClock(NamedTuple):
    """The clock of a step, and what is to be added to the instants of the events that it brings."""

    clock: int
    shift: int


class AlignedClocks:
    """Conversion of the instants of all robots to the time of one of them, the reference."""

    def __init__(self, trial: FieldTrial) -> None:
        """Raises FieldTrialError if the recordings contradict one another."""
        self._segments: list[ClockSegment] = []
        self._steps: dict[int, list[_StepClock]] = {}
        self.notes: list[str] = []
        """Corrections, and what could not be aligned, a sentence each."""
        for logs in trial.logs.values():
            before: Tick | None = None
            for log in logs:
                self._lay_out(log, before)
                before = log.ticks[-1] if log.ticks else before
        if not self._segments:
            raise FieldTrialError(
                f"{', '.join(str(log.path) for log in trial.all_logs())}: no robot has taken a step in there"
            )
        frames = shared_frames(trial, self._stamp)
        alignment = align(frames, len(self._segments), AlignmentParameters())
        if alignment.noise_us > _MOST_NOISE_US:
            raise FieldTrialError(
                f"{', '.join(trial.logs)}: their clocks disagree by {alignment.noise_us / 1e6:.0f} s from "
                "one common frame to the next; the recordings should be of one field trial"
            )
        self._main = self._choose(alignment.fits)
        self.reference = self._main.robot
        """The robot whose time it is."""
        self.begin = min(one.fit.reference(one.first) for one in self._segments)
        """When the first robot took its first step, µs by the reference."""
        self.span = max(one.fit.reference(one.last) for one in self._segments) - self.begin
        """From there to the last step of all, µs."""
        for robot in dict.fromkeys(one.robot for one in self._segments):
            self._note_unaligned(robot)

    def instant(self, log: RobotLog, moment: Moment) -> int:
        """Return what the reference showed when the base's clock showed `moment`, µs."""
        return self._segments[self._steps[id(log)][moment.tick].clock].fit.reference(moment.instant)

    def reports(self, robot: str) -> tuple[ClockReport, ...]:
        """Return every segment of the robot's clock."""
        return tuple(map(self._report, self._of(robot)))

    def _of(self, robot: str) -> list[ClockSegment]:
        return [one for one in self._segments if one.robot == robot]

    def _lay_out(self, log: RobotLog, before: Tick | None) -> None:
        """Append the segments of one recording, which follows the step `before`."""
        shifts = _shifts(log)
        steps = self._steps[id(log)] = []
        for number, tick in enumerate(log.ticks):
            if before is None or not _runs_on(before, tick, log.identity.step_us):
                self._segments.append(ClockSegment(log.identity.id, tick.instant, tick.instant))
            self._segments[-1].last = tick.instant
            steps.append(_StepClock(len(self._segments) - 1, shifts.get(number, 0)))
            before = tick
        for number in shifts:
            self._segments[steps[number].clock].doubt = log.identity.step_us
        if shifts:
            self.notes.append(
                f"{log.path}: the clock that stamps the frames was set while the one that stamps the steps "
                "ran on; put right to within a step"
            )

    def _stamp(self, log: RobotLog, moment: Moment, kind: StampKind) -> Stamp:
        """Return the robot's record of a frame as a stamp of the clock of its steps."""
        clock, shift = self._steps[id(log)][moment.tick]
        return Stamp(clock, moment.instant + (0 if kind is StampKind.HANDED else shift), kind)

    def _choose(self, fits: Sequence[Fit]) -> ClockSegment:
        """Give each segment its fit; return the reference of the group with most robots."""
        robots: dict[int, set[str]] = {}
        for segment, fit in zip(self._segments, fits, strict=True):
            robots.setdefault(fit.group, set()).add(segment.robot)
        main = max(sorted(robots), key=lambda group: len(robots[group]))
        for number, (segment, fit) in enumerate(zip(self._segments, fits, strict=True)):
            segment.frames, segment.known = fit.frames, fit.group == main
            kin = [
                place
                for place, other in enumerate(fits)
                if other.group == main and self._segments[place].robot == segment.robot
            ]
            segment.fit = fit._replace(origin=segment.first, ahead=0, offset=0.0, drift_ppm=0.0)
            if kin:
                segment.fit = fits[min(kin, key=lambda place: abs(place - number))]
        return self._segments[main]

    def _note_unaligned(self, robot: str) -> None:
        """Note a robot that frames do not connect; it should at least have been out at the same time."""
        segments = self._of(robot)
        known = [one.known for one in segments]
        if not any(known):
            main = self._of(self.reference)
            first, last = min(one.first for one in segments), max(one.last for one in segments)
            apart = max(first - max(one.last for one in main), min(one.first for one in main) - last) / 1e6
            if apart > 0:
                raise FieldTrialError(
                    f"{self.reference} and {robot}: no frame connects their recordings, and {apart:.0f} s "
                    "lie between them by their own clocks; the recordings should be of one field trial"
                )
            self.notes.append(
                f"{robot}: no frame connects its clock with that of {self.reference}, so its instants are "
                "left as its own clock gave them, with an error that is unknown"
            )
        elif not all(known):
            self.notes.append(
                f"{robot}: its clock was started again, and then no frame connects it with that of "
                f"{self.reference}; it is taken to have run on, with an error that is unknown"
            )

    def _report(self, clock: ClockSegment) -> ClockReport:
        fit, known = clock.fit, clock.known
        first, last = fit.reference(clock.first), fit.reference(clock.last)
        error = scatter = surely = 0.0
        if clock is not self._main:
            ends = (clock.first, clock.last)
            error = max(fit.error(end) for end in ends) + clock.doubt
            scatter = max(fit.scatter(end) for end in ends)
            surely = max(fit.surely_within(end) for end in ends) + clock.doubt
        return ClockReport(
            from_s=(first - self.begin) / 1e6,
            to_s=(last - self.begin) / 1e6,
            offset_s=(clock.first - first) / 1e6,
            drift_ppm=round(fit.drift_ppm, 3),
            error_s=round(error / 1e6, 6) if known else None,
            scatter_s=round(scatter / 1e6, 6) if known else None,
            surely_within_s=round(surely / 1e6, 6) if known and math.isfinite(surely) else None,
            frames=clock.frames,
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
