"""Where the clocks of a field trial's robots run on without a step: each such segment is a clock of its own.

A robot's base stamps the steps on a grid of its own clock, so that its clock and the count of steps go
together. Where they do not, the base was started again, perhaps with another time. The bridge stamps what the
radio says by a clock of the same machine, which is another one only if the machine's time was set between the
two processes' starts.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

from observation.field_trial.clocks.frame_stamps import Stamp, StampKind
from observation.field_trial.recordings import FieldTrial
from observation.field_trial.robot_log import Moment, RobotLog, Tick

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
