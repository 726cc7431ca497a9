"""Common time base of a field trial's robots, with error bounds.

A base stamps its steps on a grid of its own clock. Where clock and step count diverge, the base was
restarted, perhaps with another time: each such segment is treated as a separate clock. The bridge stamps
radio events by the clock of the same machine; it differs only if the time was set between the starts of both
processes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from acrc_testbed.results.clock_alignment import (
    AlignmentParameters,
    ClockFit,
    Stamp,
    StampedFrame,
    StampKind,
    align,
)
from acrc_testbed.results.field_recordings import FieldTrial, FieldTrialError, Moment, RobotLog, Tick
from acrc_testbed.results.result import ClockReport
from actors.messages import RadioEvents

_MAX_JUMP_US: Final = 50_000
"""Maximum jump of a clock against its step count within a segment."""
_MAX_DRIFT: Final = 1e-3
"""Maximum drift within a segment: twice the largest slew of an NTP daemon, 500 ppm (RFC 5905)."""
_MAX_AHEAD_US: Final = 1_000_000
"""Maximum time by which an event may be later than the step that delivers it; beyond, its clock was set."""
_MAX_BEHIND_US: Final = 10_000_000
"""Maximum time by which an event may be earlier than that step."""
_MAX_NOISE_US: Final = 1_000_000
"""Maximum residual noise; beyond, the frames are not those of one field trial."""


@dataclass
class ClockSegment:
    """Interval of a robot's clock in which it was not set; instants in µs of that clock."""

    robot: str
    first: int
    """Its first step."""
    last: int
    event_error: int = 0
    """Error bound of events relative to steps, µs."""
    fit: ClockFit = field(init=False)
    """Fit of this segment; if it is not aligned, of the robot's nearest aligned one."""
    is_aligned: bool = False
    """True if frames connect this segment with the reference."""
    frames: int = 0
    """Frames in common with other clocks."""


class _StepClock(NamedTuple):
    """Clock segment of a step, and the correction of its events' instants, µs."""

    clock: int
    shift: int


class AlignedClocks:
    """Conversion of the instants of all robots to the time of one of them, the reference."""

    def __init__(self, trial: FieldTrial) -> None:
        """Align all clocks. Raises FieldTrialError if the recordings contradict each other."""
        self._segments: list[ClockSegment] = []
        self._steps: dict[int, list[_StepClock]] = {}
        self.notes: list[str] = []
        """Corrections and clocks that could not be aligned, a sentence each."""
        for logs in trial.logs.values():
            before = None
            for log in logs:
                self._add_segments(log, before)
                before = log.ticks[-1] if log.ticks else before
        if not self._segments:
            raise FieldTrialError(
                f"{', '.join(str(log.path) for log in trial.all_logs())}: no robot took a step"
            )
        frames = shared_frames(trial, self._stamp)
        alignment = align(frames, len(self._segments), AlignmentParameters())
        if alignment.noise_us > _MAX_NOISE_US:
            raise FieldTrialError(
                f"{', '.join(trial.logs)}: clock offsets between common frames vary by "
                f"{alignment.noise_us / 1e6:.0f} s; the recordings must be of one field trial"
            )
        self._reference_segment = self._assign_fits(alignment.fits)
        self.reference = self._reference_segment.robot
        """Robot whose clock is the time base."""
        self.begin = min(one.fit.reference(one.first) for one in self._segments)
        """First step of all robots, µs by the reference."""
        self.span = max(one.fit.reference(one.last) for one in self._segments) - self.begin
        """Time from `begin` to the last step of all robots, µs."""
        for robot in dict.fromkeys(one.robot for one in self._segments):
            self._note_unaligned(robot)

    def instant(self, log: RobotLog, moment: Moment) -> int:
        """Convert an instant of a base's clock to the reference clock, µs."""
        return self._segments[self._steps[id(log)][moment.tick].clock].fit.reference(moment.instant)

    def reports(self, robot: str) -> tuple[ClockReport, ...]:
        """Return reports of all segments of a robot's clock."""
        return tuple(map(self._clock_report, self._segments_of(robot)))

    def _segments_of(self, robot: str) -> list[ClockSegment]:
        return [one for one in self._segments if one.robot == robot]

    def _add_segments(self, log: RobotLog, before: Tick | None) -> None:
        """Append the segments of one recording; `before`: the robot's previous step."""
        shifts = _stamp_corrections(log)
        steps = self._steps[id(log)] = []
        for number, tick in enumerate(log.ticks):
            if before is None or not _is_continuous(before, tick, log.identity.step_us):
                self._segments.append(ClockSegment(log.identity.id, tick.instant, tick.instant))
            self._segments[-1].last = tick.instant
            steps.append(_StepClock(len(self._segments) - 1, shifts.get(number, 0)))
            before = tick
        for number in shifts:
            self._segments[steps[number].clock].event_error = log.identity.step_us
        if shifts:
            self.notes.append(
                f"{log.path}: the clock for frames was set while the clock for steps ran on; "
                "corrected to within a step"
            )

    def _stamp(self, log: RobotLog, moment: Moment, kind: StampKind) -> Stamp:
        """Return a robot's record of a frame as a stamp of its step clock."""
        clock, shift = self._steps[id(log)][moment.tick]
        return Stamp(clock, moment.instant + (0 if kind is StampKind.HANDED else shift), kind)

    def _assign_fits(self, fits: Sequence[ClockFit]) -> ClockSegment:
        """Assign a fit to each segment; return the reference of the group with most robots."""
        robots: dict[int, set[str]] = {}
        for segment, fit in zip(self._segments, fits, strict=True):
            robots.setdefault(fit.group, set()).add(segment.robot)
        reference = max(sorted(robots), key=lambda group: len(robots[group]))
        for number, (segment, fit) in enumerate(zip(self._segments, fits, strict=True)):
            segment.frames, segment.is_aligned = fit.frames, fit.group == reference
            connected = [
                index
                for index, other in enumerate(fits)
                if other.group == reference and self._segments[index].robot == segment.robot
            ]
            segment.fit = fit._replace(origin=segment.first, ahead=0, offset=0.0, drift_ppm=0.0)
            if connected:
                segment.fit = fits[min(connected, key=lambda index: abs(index - number))]
        return self._segments[reference]

    def _note_unaligned(self, robot: str) -> None:
        """Add a note if frames do not connect a robot. Raises FieldTrialError for disjoint times."""
        segments = self._segments_of(robot)
        aligned = [one.is_aligned for one in segments]
        if not any(aligned):
            reference = self._segments_of(self.reference)
            first, last = min(one.first for one in segments), max(one.last for one in segments)
            gap_s = (
                max(first - max(one.last for one in reference), min(one.first for one in reference) - last)
                / 1e6
            )
            if gap_s > 0:
                raise FieldTrialError(
                    f"{self.reference} and {robot}: their recordings share no frame and are {gap_s:.0f} s "
                    "apart by their own clocks; the recordings must be of one field trial"
                )
            self.notes.append(
                f"{robot}: no common frame with {self.reference}, so its instants are those of its own "
                "clock, with an unknown error"
            )
        elif not all(aligned):
            self.notes.append(
                f"{robot}: its clock was restarted and then has no common frame with {self.reference}; "
                "assumed to have run on, with an unknown error"
            )

    def _clock_report(self, clock: ClockSegment) -> ClockReport:
        fit, known = clock.fit, clock.is_aligned
        first, last = fit.reference(clock.first), fit.reference(clock.last)
        error = scatter = causal = 0.0
        if clock is not self._reference_segment:
            ends = (clock.first, clock.last)
            error = max(fit.error(end) for end in ends) + clock.event_error
            scatter = max(fit.scatter(end) for end in ends)
            causal = max(fit.causal_bound(end) for end in ends) + clock.event_error
        return ClockReport(
            from_s=(first - self.begin) / 1e6,
            to_s=(last - self.begin) / 1e6,
            offset_s=(clock.first - first) / 1e6,
            drift_ppm=round(fit.drift_ppm, 3),
            error_s=round(error / 1e6, 6) if known else None,
            scatter_s=round(scatter / 1e6, 6) if known else None,
            surely_within_s=round(causal / 1e6, 6) if known and math.isfinite(causal) else None,
            frames=clock.frames,
        )


def _is_continuous(before: Tick, tick: Tick, step_us: int) -> bool:
    """Return whether a clock advanced as much as the step count."""
    expected = (tick.step - before.step) * step_us
    return abs(tick.instant - before.instant - expected) <= _MAX_JUMP_US + _MAX_DRIFT * abs(expected)


def _stamp_corrections(log: RobotLog) -> dict[int, int]:
    """Return the corrections of event instants by tick, where another clock has stamped the events.

    The newest event of a message is shortly before the step that delivers it.
    """
    lags = {
        tick: log.ticks[tick].instant - max(event.instant for event in received.events)
        for tick, received in log.messages_of(RadioEvents)
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
    return -_MAX_AHEAD_US <= lag <= _MAX_BEHIND_US


StampFunction = Callable[[RobotLog, Moment, StampKind], Stamp]


def shared_frames(trial: FieldTrial, stamp: StampFunction) -> list[StampedFrame]:
    """Return the frames with stamps of at least two robots, in a fixed order.

    Frames of one sender with equal bytes are skipped if a robot has sent or heard more than one of them.
    `stamp`: converts a robot's record of a frame.
    """
    stamps_by_frame: dict[tuple[int, bytes], list[tuple[str, Stamp]]] = {}
    for log in trial.all_logs():
        robot = log.identity.id
        for sent in log.sent_frames():
            stamps = stamps_by_frame.setdefault((log.identity.address, sent.data), [])
            stamps.append((robot, stamp(log, sent.handed, StampKind.HANDED)))
            if sent.sent is not None:
                stamps.append((robot, stamp(log, sent.sent, StampKind.SENT)))
        for tick, event in log.received_frames():
            stamps = stamps_by_frame.setdefault((event.sender, event.data), [])
            stamps.append((robot, stamp(log, Moment(tick, event.instant), StampKind.HEARD)))
    return [frame for stamps in stamps_by_frame.values() if (frame := _stamped_frame(stamps)) is not None]


def _stamped_frame(robot_stamps: Sequence[tuple[str, Stamp]]) -> StampedFrame | None:
    """Return the sender's best stamp and all receivers'; None for fewer than two or ambiguous stamps."""
    sent, handed = (
        [one for _, one in robot_stamps if one.kind is kind] for kind in (StampKind.SENT, StampKind.HANDED)
    )
    heard = {robot: one for robot, one in robot_stamps if one.kind is StampKind.HEARD}
    stamps = (*(sent or handed), *heard.values())  # an unconfirmed frame was sent if a robot heard it
    if len(handed) > 1 or len(stamps) < 2 or len(robot_stamps) != len(sent) + len(handed) + len(heard):
        return None
    return StampedFrame(stamps, handed[0] if handed else None)
