"""Feedback of a ROS 2 robot's base: odometry, gyro and hazards as a DriveFeedback."""

from typing import Any, Final, NamedTuple

from actors.geometry import GREATEST_COORDINATE, Pose, wrap
from actors.instant import Duration, Instant, in_seconds, milliseconds
from actors.portable import atan2, cos_sin, hypot
from firmware_bridge.base_feedback import WheelMotion
from firmware_bridge.ros2.message_types import InvalidMessageError
from firmware_bridge.ros2.robot_clock import RobotClock, RobotTime

_SIDEWAYS: Final = 0.02
"""Sideways motion between two messages, m, above which the odometry has jumped; own choice."""
_MAX_GYRO_GAP: Final = milliseconds(250)
"""Maximum time between two messages of the gyro; own choice, five at the 20 Hz of a TurtleBot 3."""
_UNIT_TOLERANCE: Final = 0.1
"""Maximum deviation of a quaternion's norm from 1."""


class HazardStatus(NamedTuple):
    """Active hazards of a base, with the bits of a DriveFeedback."""

    bumper: int = 0
    wheel_drop: int = 0
    cliff: int = 0
    overcurrent: int = 0
    backup_limit: int = 0


def read_hazards(message: Any) -> HazardStatus:
    """Return the hazards of a HazardDetectionVector; a stalled wheel counts as over-current."""
    found = dict.fromkeys(_HAZARDS.values(), 0)
    for one in message.detections:
        name = _HAZARDS.get(one.type)
        if name is not None:
            left, right = ("left" in one.header.frame_id, "right" in one.header.frame_id)
            found[name] |= _bits(name, left, right)
    return HazardStatus(**found)


_HAZARDS: Final = {0: "backup_limit", 1: "bumper", 2: "cliff", 3: "overcurrent", 4: "wheel_drop"}
"""Types of hazards; irobot_create_msgs, HazardDetection. Others, such as near objects, are ignored."""


def _bits(name: str, left: bool, right: bool) -> int:
    if name in {"bumper", "cliff"}:
        return 4 if left else 1 if right else 2
    first, second = (left, right) if name == "overcurrent" else (right, left)
    return first | second << 1 or 3


def read_pose(message: Any) -> Pose:
    """Return the pose of an Odometry message. Raises InvalidMessageError."""
    at, q = message.pose.pose.position, message.pose.pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not (max(abs(at.x), abs(at.y)) <= GREATEST_COORDINATE and abs(norm - 1) <= _UNIT_TOLERANCE):
        raise InvalidMessageError(f"pose {at.x:g}, {at.y:g} m with a quaternion of squared norm {norm:g}")
    heading = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return Pose(at.x, at.y, heading)


class RobotFeedback(NamedTuple):
    """One odometry message with the state of the other sensors: a DriveFeedback."""

    instant: Instant
    stamp: Duration
    """On the robot's clock, without steps."""
    pose: Pose
    gyro: float | None
    """Turn by the gyro since its start, rad."""
    turn_rate: float | None
    basic: HazardStatus
    track: float
    """Distance between the wheels, m."""

    def since(self, before: "RobotFeedback") -> WheelMotion:
        """Return the motion of wheels that cause the change of the pose."""
        turn = wrap(self.pose.heading - before.pose.heading)
        dx, dy = self.pose.x - before.pose.x, self.pose.y - before.pose.y
        c, s = cos_sin(before.pose.heading + turn / 2)
        forward, sideways = c * dx + s * dy, c * dy - s * dx
        if abs(sideways) > _SIDEWAYS:  # no motion of wheels: as fast as the jump
            forward = hypot(dx, dy)
        half = turn * self.track / 2
        rotation = None if self.gyro is None or before.gyro is None else self.gyro - before.gyro
        return WheelMotion(Duration(self.stamp - before.stamp), forward - half, forward + half, rotation)


class GyroOdometry:
    """Turn by the gyro: integral of the turn rate in Imu messages."""

    def __init__(self) -> None:
        self.clock = RobotClock()
        self._angle = 0.0
        self._rate = 0.0
        self._last: RobotTime | None = None
        self._began = Instant(0)
        """Start of the integral, after a gap."""

    def take(self, arrived: Instant, message: Any) -> None:
        """Add a message. Raises InvalidMessageError."""
        rate = message.angular_velocity.z
        if not abs(rate) <= GREATEST_COORDINATE:
            raise InvalidMessageError(f"turn rate {rate:g} rad/s")
        time = self.clock.convert(arrived, message.header)
        if time is None:
            return
        if self._last is None or time.stamp - self._last.stamp > _MAX_GYRO_GAP:
            self._began = time.instant
        else:
            self._angle += (rate + self._rate) / 2 * in_seconds(time.stamp - self._last.stamp)
        self._rate, self._last = rate, time

    def read(self, at: Instant) -> tuple[float | None, float | None]:
        """Return turn, rad, and rate, rad/s, at a time; None after a gap."""
        if self._last is None or not _MAX_GYRO_GAP >= at - self._last.instant >= -_MAX_GYRO_GAP:
            return None, None
        if at - self._began < _MAX_GYRO_GAP:  # a feedback in between has no gyro
            return None, self._rate
        return self._angle + self._rate * in_seconds(at - self._last.instant), self._rate
