"""The clocks of the robots of a field trial turned into one time, with what is known of the error."""

import math
from typing import Final, NamedTuple

from acrc_testbed.field_trial.clock_alignment import AlignmentParameters, Fit, align
from acrc_testbed.field_trial.frame_stamps import ClockSegments, shared_frames
from acrc_testbed.field_trial.recordings import FieldTrial, FieldTrialError, Moment, RobotLog
from acrc_testbed.results.result import ClockReport

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
