"""What the sensors of a robot say against one another: it stands, and is told who is not to be believed.

Without I/O, clock and chance: the same feedbacks, commands and sweeps give the same causes.
"""

import math
from typing import Final

from actors.geometry import Pose, wrap
from actors.instant import Duration, Instant, milliseconds, seconds
from firmware_bridge.kobuki.motion import METRES_PER_TICK, TRACK, signed
from firmware_bridge.kobuki.packets import Basic, Inertial
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.onboard.motion_checks import MotionChecks
from firmware_bridge.onboard.motion_track import MotionTrack, Moved
from firmware_bridge.onboard.scan_checks import ScanChecks
from firmware_bridge.range_sensors.sensor import SensorSweep

REST: Final[Duration] = seconds(2)
"""So long a robot stands for a contradiction that shows in motion only; then it may try again. Own choice."""
_STRIKES: Final = 3
"""Once the same shows so often, it stands until its base is started again; own choice, ..."""
_FORGIVEN: Final[Duration] = seconds(60)
"""... unless so much time is between."""
_FOR_GOOD: Final[Duration] = seconds(1e9)
_LONGEST_GAP: Final[Duration] = milliseconds(200)
"""Between two feedbacks; after a longer one nothing is known of the motion between."""


class Contradictions:
    """Feed it what the sensors say, and ask it before anything moves."""

    def __init__(self, mount: Pose | None) -> None:
        """`mount`: of the range sensor on the body; None = there is none."""
        self._motion = MotionTrack()
        self._checks = MotionChecks()
        self._scans = None if mount is None else ScanChecks(mount)
        self._last: tuple[Instant, Basic, Inertial | None] | None = None
        self._commanded = (0.0, 0.0)
        self._until: dict[HoldCause, Instant] = {}
        self._strikes: dict[HoldCause, int] = {}
        self.gyro_judged = False
        """Wheels and scans agree on a turn that the gyro has not seen; without scans, wheels and command."""

    def feedback(self, now: Instant, basic: Basic, inertial: Inertial | None) -> None:
        """Take in what a base says; see `commanded` for what it was told meanwhile."""
        last, self._last = self._last, (now, basic, inertial)
        if last is None or now - last[0] > _LONGEST_GAP or basic.wheel_drop:
            self._forget()
            return
        before = last[1]
        left, right = (
            signed(a - b) * METRES_PER_TICK
            for a, b in ((basic.left_ticks, before.left_ticks), (basic.right_ticks, before.right_ticks))
        )
        turn = (right - left) / TRACK
        if inertial is not None and last[2] is not None:
            turn = wrap(math.radians((inertial.angle_cdeg - last[2].angle_cdeg) / 100))
        moved = Moved(now, left, right, turn, *self._commanded)
        self._motion.take(moved)
        cause = self._checks.take(moved, basic)
        if cause is not None:
            self.gyro_judged |= cause is HoldCause.GYRO and self._scans is None
            self._tell(now, cause)

    def commanded(self, v: float, omega: float) -> None:
        """What the base is told from now on, m/s and rad/s."""
        self._commanded = (v, omega)

    def sweep(self, now: Instant, sweep: SensorSweep) -> None:
        """Take in a sweep of the range sensor."""
        cause = None if self._scans is None else self._scans.take(sweep, self._motion)
        self.gyro_judged |= cause is HoldCause.GYRO
        if cause is not None and self._commanded != (0.0, 0.0):
            self._tell(now, cause)

    def repeated(self, now: Instant, cause: HoldCause) -> None:
        """The range sensor itself shows that; it is over a rest after it was last said."""
        self._until[cause] = Instant(now + REST)

    def on_wheels(self) -> None:
        """The heading is that of the wheels from now on: the gyro contradicts nobody any more."""
        self.gyro_judged = False
        self._until.pop(HoldCause.GYRO, None)
        self._strikes.pop(HoldCause.GYRO, None)
        self._forget()

    def causes(self, now: Instant) -> frozenset[HoldCause]:
        """For which nothing may move now."""
        return frozenset(cause for cause, until in self._until.items() if now < until)

    def _tell(self, now: Instant, cause: HoldCause) -> None:
        until = self._until.get(cause)
        if until is not None and now < until:
            return
        fresh = until is None or now - until > _FORGIVEN
        self._strikes[cause] = strikes = 1 if fresh else self._strikes[cause] + 1
        if cause is HoldCause.BLOCKED:  # mostly true: it tries again, ever more seldom
            rest = min(REST << (strikes - 1), _FORGIVEN)
        else:
            rest = REST if strikes < _STRIKES else _FOR_GOOD
        self._until[cause] = Instant(now + rest)
        self._checks.forget()
        if cause is not HoldCause.GYRO:  # of which scans say more while the robot comes to stand
            self._forget()

    def _forget(self) -> None:
        self._motion.forget()
        self._checks.forget()
        if self._scans is not None:
            self._scans.forget()
