"""Driver of a Kobuki, without I/O.

Every few milliseconds and after each read, the caller passes the bytes (or none) to `take` and writes the
bytes returned by `due`. One base control is sent per feedback, 50 per second, as by kobuki_driver; a base
accepts 150 per second, but not 200 (yujinrobot/kobuki, issue 140).
"""

from typing import Final

from actors.instant import Duration, Instant, milliseconds
from firmware_bridge.kobuki import kobuki_motion
from firmware_bridge.kobuki.kobuki_motion import KOBUKI_LIMITS, BaseFeedback
from firmware_bridge.kobuki.kobuki_packets import (
    LED1_GREEN,
    LED1_RED,
    POWER_RAILS,
    RECHARGE_MELODY,
    BasicSensorData,
    Command,
    FrameReader,
    GeneralOutput,
    InertialSensorData,
    SoundSequence,
    decode_feedback,
    encode_command,
    encode_frame,
)
from firmware_bridge.safety import (
    MAX_COMMAND_INTERVAL,
    BaseDriver,
    BatteryLevel,
    BatteryLimits,
    HoldCause,
    battery_level,
)

_FIELDS: Final = ("bumper", "wheel_drop", "cliff", "buttons", "charger", "overcurrent")
"""Fields of BasicSensorData with reported changes."""
_STOP_INTERVAL: Final = milliseconds(7)
"""Interval of stop commands while the wheels still turn; a base accepts 150 per second."""
_NOISY_STOP_INTERVAL: Final = milliseconds(1)
"""Interval of stop commands while the line is noisy, which fills the line. If three bytes in ten are damaged,
one command in 35 arrives intact."""
_MAX_STOPS_PER_WRITE: Final = 20
"""Maximum number of stop commands per write, 200 bytes."""
_REPEAT: Final = milliseconds(1000)
"""Interval at which outputs are repeated, because commands are not acknowledged."""
_VOLTAGES: Final = BatteryLimits(full=16.5, low=14.0, danger=13.2, margin=0.3)
"""Voltages of a battery of four lithium-ion cells: full, low, and shortly before the base switches off
(kobuki_driver, battery defaults); hysteresis: our choice, as motors lower the voltage."""
_NOISE_BYTES: Final = 100
"""Number of damaged bytes without feedback that indicates a noisy line; our choice: more than a frame."""


class KobukiDriver(BaseDriver):
    """Driver of one base."""

    def __init__(self, started: Instant) -> None:
        super().__init__(started, KOBUKI_LIMITS)
        self._reader = FrameReader(decode_feedback)
        self.reception = self._reader.reception
        """Counts of received frames and noise bytes."""
        self._outputs = POWER_RAILS
        self._outputs_due = started
        self._skipped_before = 0
        """Number of damaged bytes up to the last feedback."""
        self._sound = b""
        """Pending sound command."""
        self._fields = dict.fromkeys(_FIELDS, 0)
        self.volts: float | None = None
        """Battery voltage; None before the first feedback."""

    # --- from the base ---

    def take(self, now: Instant, data: bytes) -> list[BaseFeedback]:
        """Process bytes read (or none) and the passing of time; return the completed feedbacks."""
        feedbacks = []
        for packets in self._reader.take(data):
            basic = next((packet for packet in packets if isinstance(packet, BasicSensorData)), None)
            inertial = next((packet for packet in packets if isinstance(packet, InertialSensorData)), None)
            if basic is not None:
                feedbacks.append(BaseFeedback(now, basic, inertial))
                self._feedback(feedbacks[-1])
        self._check_silence(now)
        self.hold(HoldCause.NOISE, self._is_noisy(now))
        return feedbacks

    def pressed(self) -> int:
        """Return the bumper bits set at any time since the last call, as in SensorData.bumper."""
        bits = self._pressed_bits
        self._pressed_bits = self._fields["bumper"] if self.found else 0
        return bits

    # --- to the base ---

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now: none, or a base control and at most one other command."""
        passed = Duration(now - self._sent_at)
        if self._is_noisy(now):
            count = min(passed // _NOISY_STOP_INTERVAL, _MAX_STOPS_PER_WRITE)
            self._sent_at = now if count else self._sent_at
            self._update_allowed(now)
            return self.final_bytes() * count
        stands = self.allowed.v == 0 and self.allowed.omega == 0
        is_stop_ignored = stands and self.found and self.odometry.is_moving
        if not self._has_new_feedback and passed < (
            _STOP_INTERVAL if is_stop_ignored else MAX_COMMAND_INTERVAL
        ):
            return b""
        self._has_new_feedback, self._sent_at = False, now
        self._update_allowed(now)
        control = kobuki_motion.base_control(self.allowed.v, self.allowed.omega)
        return _frame(control) + self._other_command(now)

    def final_bytes(self) -> bytes:
        """Return the last bytes to write: a stop command."""
        return _frame(kobuki_motion.base_control(0.0, 0.0))

    def _is_noisy(self, now: Instant) -> bool:
        """Return whether noise replaces feedback."""
        silent = now - self._feedback_at > KOBUKI_LIMITS.silence
        return silent and self.reception.skipped - self._skipped_before >= _NOISE_BYTES

    def _feedback(self, feedback: BaseFeedback) -> None:
        now, basic, _ = feedback
        if not self.found:  # it may be another base, or a restarted one
            self._outputs_due = now
            self._set_found(now, True)
        self._feedback_at, self._has_new_feedback = now, True
        self._skipped_before = self.reception.skipped
        self._safety.sense(feedback)
        self.odometry.take(feedback)
        self._pressed_bits |= basic.bumper
        for name, before in self._fields.items():
            self._fields[name] = getattr(basic, name)
            self._note_change(now, name, before, self._fields[name])
        self.volts = basic.battery_dv / 10
        battery = battery_level(self.volts, self.battery, _VOLTAGES)
        if self._set_battery(now, battery):
            self._signal_battery(now, battery)

    def _signal_battery(self, now: Instant, battery: BatteryLevel) -> None:
        """Signal a low battery by LED and sound."""
        light = {BatteryLevel.LOW: LED1_RED | LED1_GREEN, BatteryLevel.DANGER: LED1_RED}
        self._outputs, self._outputs_due = POWER_RAILS | light.get(battery, 0), now
        if battery in light:
            self._sound = _frame(SoundSequence(RECHARGE_MELODY))

    def _other_command(self, now: Instant) -> bytes:
        """Return the most urgent other command, or nothing."""
        if now >= self._outputs_due:
            self._outputs_due = Instant(now + _REPEAT)
            return _frame(GeneralOutput(self._outputs))
        sound, self._sound = self._sound, b""
        return sound


def _frame(command: Command) -> bytes:
    return encode_frame(encode_command(command))
