"""Clock of a ROS 2 robot: its stamps on our clock, late messages, and steps of the clock.

The smallest difference between arrival and stamp is the offset of the clocks plus the shortest latency.
Later differences above it are delays: a sustained delay looks like a clock that was set back, and both make
the data invalid. A clock that was set is accepted after some messages if forward, else after some seconds.
"""

from typing import Any, Final, NamedTuple

from actors.instant import Duration, Instant, milliseconds, seconds

_MAX_DELAY: Final = milliseconds(150)
"""Maximum delay of a message beyond the shortest one; own choice: 4.6 cm of a TurtleBot 4."""
_CONFIRMATIONS: Final = 3
"""Consecutive messages that confirm a clock that was set forward; own choice: one stamp may be wrong."""
_DRIFT_PPM: Final = 200
"""Maximum drift of two clocks, µs per s; own choice, twice that of common quartz oscillators."""
_GIVE_UP: Final = seconds(3.5)
"""Duration of late messages after which the clock counts as set back; own choice, longer than the gap in the
odometry after which a base process restarts with an uncertain pose."""
_REST: Final = seconds(2)
"""Stop after a step of the clock was accepted; own choice, as after a contradiction."""


NO_TIME: Final = Duration(0)


class RobotTime(NamedTuple):
    """Time of a message."""

    instant: Instant
    """On our clock, as if it had arrived after the shortest latency."""
    stamp: Duration
    """On the robot's clock, without steps."""


class RobotClock:
    """Clock of one topic's stamps; topics of a robot may come from several computers."""

    def __init__(self) -> None:
        self.offset: Duration | None = None
        """Our clock minus the robot's, including the shortest latency; None before the first message."""
        self._base = NO_TIME
        """The same before the first step, for stamps without steps."""
        self._received: int | None = None
        """Last stamp received, ..."""
        self._used: int | None = None
        """... and used."""
        self._arrived = Instant(0)
        self._stepped_at: Instant | None = None
        self._late_since: Instant | None = None
        self._early = 0
        """Number of consecutive messages before the shortest latency."""

    @property
    def is_late(self) -> bool:
        """True if the last message was too late."""
        return self._late_since is not None

    def has_stepped(self, now: Instant) -> bool:
        """Return whether the clock was set a short time ago."""
        return self._stepped_at is not None and now - self._stepped_at < _REST

    def convert(self, arrived: Instant, header: Any, duration: Duration = NO_TIME) -> RobotTime | None:
        """Return the end of a measurement that begins at the header's stamp; None: it must not be used."""
        stamp = header.stamp.sec * 1_000_000 + header.stamp.nanosec // 1000 + duration
        if stamp == self._received:
            return None
        self._received, difference = stamp, Duration(arrived - stamp)
        if self.offset is None:
            self.offset, self._base, self._arrived = difference, difference, arrived
        offset = Duration(self.offset + (arrived - self._arrived) * _DRIFT_PPM // 1_000_000)
        self._early = self._early + 1 if difference < offset - _MAX_DELAY else 0
        if 0 < self._early < _CONFIRMATIONS:
            return None
        is_late = difference > offset + _MAX_DELAY
        self._late_since = (self._late_since or arrived) if is_late else None
        has_given_up = self._late_since is not None and arrived - self._late_since > _GIVE_UP
        if self._early or has_given_up:  # the clock was set
            self._base = Duration(self._base + difference - offset)
            self._used, self._early, offset = None, 0, difference
            self._stepped_at = arrived
        self.offset, self._arrived = min(offset, difference), arrived
        if is_late or (self._used is not None and stamp <= self._used):
            return None
        self._used = stamp
        return RobotTime(Instant(stamp + self.offset), Duration(stamp + self._base))
