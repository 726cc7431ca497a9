"""One robot's body in the simulated world, as the base that drives it has it."""

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import Drive
from actors.portable import cos, sin
from actors.world.body import Bodies
from firmware_bridge.kobuki.body import BodyTruth


class RobotBody:
    """A kobuki.body.Body that the simulated world moves."""

    def __init__(self, bodies: Bodies, index: int) -> None:
        self._bodies = bodies
        self._index = index
        self._wanted = (0.0, 0.0)
        """As it was told last: m/s, rad/s."""

    def drive(self, v: float, omega: float) -> None:
        """As in Body."""
        self._wanted = (v, omega)

    @property
    def is_told_to_stand(self) -> bool:
        """True if the wheels were last told not to turn; the body brakes as it can."""
        return self._wanted == (0.0, 0.0)

    def hold(self, now: Instant) -> None:
        """Go on as last told: of a watchdog in a Kobuki nothing is known, so it should be safe without.

        To be called before every move of the bodies, whose own drives forget a wish after a while.
        """
        v, omega = self._wanted
        self._bodies.command(self._index, Drive(0, v, 0.0, omega, 0), now)

    def advance(self, now: Instant) -> None:
        """As in Body: somebody else moves it."""

    def truth(self) -> BodyTruth:
        """As in Body."""
        x, y, heading, vx, vy, omega = self._bodies.truth(self._index)
        return BodyTruth(Pose(x, y, heading), vx * cos(heading) + vy * sin(heading), omega)

    def bumper(self) -> int:
        """As in Body: pressed at any time since the last call."""
        return self._bodies.senses(self._index, 0, Instant(0), 0, False).bumper
