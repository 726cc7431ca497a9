"""Limits of acceleration, as ramps of the velocity that is sent."""

from dataclasses import dataclass

from actors.bounds import check
from actors.instant import Duration, Instant, in_seconds, milliseconds


@dataclass(frozen=True)
class RampParameters:
    """How quickly the velocity may change; kobuki_driver's defaults, but for braking."""

    speed_up: float = 0.3
    """m/s²."""
    slow_down: float = 0.6
    """The same, towards standing. Own choice, above kobuki_driver's 0.36: navigation plans with 1.0
    (actors.robot.local_planning.dwa_parameters), and on this base comes to stand later than it means to."""
    turn_up: float = 3.5
    """rad/s²."""
    turn_down: float = 4.2
    """The same, towards standing."""
    longest: Duration = milliseconds(60)  # noqa: RUF009 - a NewType makes no object
    """More time than this between two commands counts as this; own choice, three feedbacks: a host that
    slept makes no jump."""

    def __post_init__(self) -> None:
        rates = ("speed_up", "slow_down", "turn_up", "turn_down")
        check("ramp", self, positive=rates, most=dict.fromkeys(rates, 10))


class Ramp:
    """The velocity that was last sent, and how far it may go from there."""

    def __init__(self, parameters: RampParameters) -> None:
        self._p = parameters
        self._at: Instant | None = None
        self.v = 0.0
        self.omega = 0.0

    def halt(self, now: Instant) -> None:
        """Stand at once."""
        self.set(now, 0.0, 0.0)

    def set(self, now: Instant, v: float, omega: float) -> None:
        """Go on from another velocity."""
        self._at, self.v, self.omega = now, v, omega

    def towards(self, now: Instant, v: float, omega: float) -> tuple[float, float]:
        """The velocity for now on the way to the wanted one, m/s and rad/s."""
        passed = 0 if self._at is None else max(0, min(now - self._at, self._p.longest))
        time = in_seconds(passed)
        p = self._p
        self.set(
            now,
            _next(self.v, v, p.speed_up * time, p.slow_down * time),
            _next(self.omega, omega, p.turn_up * time, p.turn_down * time),
        )
        return self.v, self.omega


def _next(value: float, wanted: float, up: float, down: float) -> float:
    """As near to `wanted` as one step goes; a change of sign pauses at 0."""
    if value < 0:
        return -_next(-value, -wanted, up, down)
    if wanted > value:
        return min(wanted, value + up)
    return max(wanted, value - down, 0.0) if value > 0 else max(wanted, -up)
