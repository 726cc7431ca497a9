"""Feedback and limits of a differential base of any make, for its safety stop, checks and odometry."""

from typing import NamedTuple, Protocol, Self

from actors.instant import Duration, Instant


class WheelMotion(NamedTuple):
    """Motion between two feedbacks."""

    advance: Duration
    """Advance of the base's clock; not positive: it stopped or stepped back."""
    left: float
    """Distance of the left wheel, m."""
    right: float
    turn: float | None
    """Turn by the gyro, rad; None: no gyro."""


class HazardState(Protocol):
    """Sensors of a base against collision and fall."""

    @property
    def bumper(self) -> int:
        """Pressed parts: bit 0 right, 1 centre, 2 left."""

    @property
    def wheel_drop(self) -> int:
        """Wheels without contact: bit 0 right, 1 left."""

    @property
    def cliff(self) -> int:
        """Cliff sensors without floor: bit 0 right, 1 centre, 2 left."""

    @property
    def overcurrent(self) -> int:
        """Motors with over-current or a stalled wheel: bit 0 left, 1 right."""


class DriveFeedback(Protocol):
    """One feedback of a base."""

    @property
    def instant(self) -> Instant:
        """Time of arrival."""

    @property
    def basic(self) -> HazardState:
        """HazardStatus."""

    @property
    def gyro(self) -> object:
        """Values of the gyro, which differ while it works and turns; None: no gyro."""

    @property
    def turn_rate(self) -> float | None:
        """Turn rate by the gyro, rad/s."""

    def since(self, before: Self) -> WheelMotion:
        """Return the motion since an earlier feedback of the same base."""


class DriveLimits(NamedTuple):
    """Geometry and limits of a base."""

    track: float
    """Distance between the wheels, m."""
    speed: float
    """Maximum speed, m/s."""
    turn_rate: float
    """Maximum turn rate, rad/s."""
    speed_up: float
    """Maximum acceleration, m/s²."""
    slow_down: float
    turn_up: float
    """Maximum turn acceleration, rad/s²."""
    turn_down: float
    silence: Duration
    """Timeout of feedback, and the required duration of feedback afterwards before motion."""
    still: float
    """Maximum distance of a wheel between two feedbacks at standstill, m."""
    wheel_speed: float
    """Maximum plausible speed of a wheel, m/s; faster feedback is wrong."""
