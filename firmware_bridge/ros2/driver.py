"""Driver of a ROS 2 robot's base, without I/O.

The caller passes received messages to `take`, and publishes the velocity returned by `due`: after each
odometry message, at least every `MAX_COMMAND_INTERVAL`, and until the robot has stood for `_QUIET_AFTER`.
Afterwards nothing is published, so that actions of the robot, such as undocking, are not disturbed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.robot_model import RobotModel
from firmware_bridge.base_feedback import DriveLimits
from firmware_bridge.ros2.message_types import TOPIC_TYPES, InvalidMessageError
from firmware_bridge.ros2.robot_clock import NO_TIME, RobotClock
from firmware_bridge.ros2.robot_feedback import (
    GyroOdometry,
    HazardStatus,
    RobotFeedback,
    read_hazards,
    read_pose,
)
from firmware_bridge.ros2.session import ReceivedSample
from firmware_bridge.safety import (
    MAX_COMMAND_INTERVAL,
    AllowedMotion,
    BaseDriver,
    BatteryLimits,
    HoldCause,
    battery_level,
)

_SILENCE: Final = milliseconds(200)
"""Timeout of odometry; own choice, four messages of a TurtleBot."""
_STILL: Final = 0.0005
"""Maximum distance of a wheel between two messages at standstill, m; own choice: 1 cm/s at 20 Hz."""
_QUIET_AFTER: Final = seconds(1)
_CHARGES: Final = BatteryLimits(low=0.2, danger=0.05, margin=0.03)
"""Charges at which the battery is low and nearly empty, and their hysteresis; own choice, as of a Kobuki."""
_PERCENT_ABOVE: Final = 1.5
"""Percentage above which a robot publishes percent, although BatteryState has shares."""

Publications = Mapping[str, Sequence[ReceivedSample]]
"""Received publications by field of RobotTopics."""


def drive_limits(model: RobotModel) -> DriveLimits:
    """Return the limits of a robot model with a differential drive."""
    drive, track = model.drive, model.kobuki_errors.track
    return DriveLimits(
        track=track,
        speed=drive.speed,
        turn_rate=drive.turn_rate,
        speed_up=drive.acceleration,
        slow_down=drive.acceleration,
        turn_up=drive.turn_acceleration,
        turn_down=drive.turn_acceleration,
        silence=_SILENCE,
        still=_STILL,
        wheel_speed=2 * (drive.speed + drive.turn_rate * track / 2),
    )


class RobotDriver(BaseDriver):
    """Driver of one robot's base."""

    _FEEDBACK = "odometry"

    def __init__(self, model: RobotModel, started: Instant) -> None:
        super().__init__(started, drive_limits(model))
        self.details: dict[HoldCause, str] = {}
        """Explanations of active causes."""
        self._battery_model = model.battery
        self.clock = RobotClock()
        """Clock of the odometry."""
        self._gyro = GyroOdometry()
        self._hazards = HazardStatus()
        self._moved_at = started
        self._is_percent = False
        self._refused: dict[str, str] = {}
        """Last reason for refusing a message, by topic."""
        self._held: set[HoldCause] = set()
        self.charge: float | None = None
        self._handlers: dict[str, Callable[[Instant, Any], None]] = {
            "hazards": self._take_hazards,
            "dock": lambda now, one: self.hold(HoldCause.DOCKED, one.is_docked),
            "wheels": lambda now, one: self.hold(HoldCause.WHEELS_DISABLED, not one.wheels_enabled),
            "battery": self._take_battery,
            "imu": self._gyro.take,
            "odom": self._take_odometry,  # last: a feedback contains hazards and gyro
        }
        """By field of RobotTopics, in order of processing."""
        self._feedbacks: list[RobotFeedback] = []

    def take(self, now: Instant, publications: Publications) -> list[RobotFeedback]:
        """Process messages (or none) and the passing of time; return the feedbacks."""
        self._feedbacks = []
        for topic in self._handlers:
            self._process(now, topic, publications.get(topic, ()))
        self._check_silence(now)
        self._hold_changed(HoldCause.LATE_DATA, self.clock.is_late)
        self._hold_changed(HoldCause.BASE_CLOCK, self.clock.has_stepped(now))
        return self._feedbacks

    def pressed(self) -> int:
        """Return the bumper bits set at any time since the last call, as in SensorData.bumper."""
        bits, self._pressed_bits = self._pressed_bits, self._hazards.bumper
        return bits

    def due(self, now: Instant) -> AllowedMotion | None:
        """Return the velocity to publish now, if any."""
        if not self._has_new_feedback and now - self._sent_at < MAX_COMMAND_INTERVAL:
            return None
        self._has_new_feedback, self._sent_at = False, now
        self._update_allowed(now)
        v, omega, _ = self.allowed
        if v or omega or not self.found or self.odometry.is_moving:
            self._moved_at = now
        return self.allowed if now - self._moved_at < _QUIET_AFTER else None

    def _hold_changed(self, cause: HoldCause, holds: bool) -> None:
        """Set or clear a cause after a change; checks of contradictions may set it, too."""
        if holds != (cause in self._held):
            (self._held.add if holds else self._held.discard)(cause)
            self.hold(cause, holds)

    def _process(self, now: Instant, topic: str, samples: Sequence[ReceivedSample]) -> None:
        for sample in samples:
            try:
                self._handlers[topic](sample.arrived, sample.message(TOPIC_TYPES[topic]))
                reason = ""
            except InvalidMessageError as error:
                reason = str(error)
            self._note_change(now, f"{topic} refused", self._refused.get(topic, ""), reason)
            self._refused[topic] = reason

    def _take_odometry(self, arrived: Instant, message: Any) -> None:
        pose = read_pose(message)
        time = self.clock.convert(arrived, message.header)
        if time is None:
            return
        if not self.found:
            self._set_found(arrived, True)
            offset = f"{-in_seconds(self.clock.offset or NO_TIME):.3f}"
            self._note_change(arrived, "robot's clock, s ahead", "", offset)
        feedback = RobotFeedback(
            time.instant, time.stamp, pose, *self._gyro.read(time.instant), self._hazards, self.limits.track
        )
        self._safety.sense(feedback)
        self.odometry.take(feedback._replace(gyro=None))
        self._feedback_at, self._has_new_feedback = time.instant, True
        self._feedbacks.append(feedback)

    def _take_hazards(self, arrived: Instant, message: Any) -> None:
        before, self._hazards = self._hazards, read_hazards(message)
        self.hold(HoldCause.BACKUP_LIMIT, bool(self._hazards.backup_limit))
        self._pressed_bits |= self._hazards.bumper
        self._note_change(arrived, "hazards", before, self._hazards)

    def _take_battery(self, arrived: Instant, message: Any) -> None:
        """Compute the charge from the voltage by the model, else from the percentage."""
        charge, model = None, self._battery_model
        if model is not None and math.isfinite(message.voltage) and message.voltage > 0:
            charge = model.charge_at(message.voltage)
        if charge is None and message.percentage > 0:  # zero: not measured yet
            if message.percentage > _PERCENT_ABOVE and not self._is_percent:
                self._is_percent = True
                self._note_change(arrived, "battery's percentage", "0 to 1", "0 to 100")
            charge = min(1.0, message.percentage / (100 if self._is_percent else 1))
        self.charge = charge
        level = None if charge is None else battery_level(charge, self.battery, _CHARGES)
        self._set_battery(arrived, level)
