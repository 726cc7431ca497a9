"""The driver of a Kobuki without I/O: bytes from the base in, feedback and bytes to the base out.

A shell calls, every few milliseconds and whenever bytes have come: `take` with the bytes, also with none;
then writes what `due` gives. One base control goes out per feedback, 50 a second, as kobuki_driver does; a
base hears 150 a second well and 200 not (yujinrobot/kobuki, issue 140).
"""

from enum import Enum
from typing import Final, NamedTuple

from actors.instant import Duration, Instant, milliseconds
from firmware_bridge.kobuki import motion, wire
from firmware_bridge.kobuki.motion import KobukiOdometry
from firmware_bridge.kobuki.safety import FEEDBACK_SILENCE, AllowedMotion, HoldCause, SafetyStop
from firmware_bridge.kobuki.wire import (
    POWER_RAILS,
    RECHARGE_MELODY,
    BaseFeedback,
    Basic,
    Command,
    FrameReader,
    GeneralOutput,
    Inertial,
    SoundSequence,
    WireCounts,
    decode_feedback,
    encode_command,
    encode_frame,
)


class BatteryLevel(Enum):
    """From full to empty."""

    FULL = "full"
    FAIR = "fair"
    LOW = "low"
    DANGER = "danger"


def level(volts: float, before: BatteryLevel | None = None) -> BatteryLevel:
    """The level at `volts`; `before`: the level until now."""
    if volts <= _DANGER_V + _MARGIN_V * (before is BatteryLevel.DANGER):
        return BatteryLevel.DANGER
    low = before in {BatteryLevel.LOW, BatteryLevel.DANGER}
    if volts <= _LOW_V + _MARGIN_V * low:
        return BatteryLevel.LOW
    if volts >= _FULL_V - _MARGIN_V * (before is BatteryLevel.FULL):
        return BatteryLevel.FULL
    return BatteryLevel.FAIR


class StateChange(NamedTuple):
    """A change of a base: that it sends feedback, a field of its feedback, its battery, or what stops it."""

    instant: Instant
    what: str
    before: object
    """Of a field before the first feedback: 0."""
    now: object

    def __str__(self) -> str:
        return f"{self.what}: {self.before} -> {self.now}"


_FIELDS: Final = ("bumper", "wheel_drop", "cliff", "buttons", "charger", "overcurrent")
"""Fields of Basic whose changes are reported."""
_OVERDUE: Final[Duration] = milliseconds(40)
"""A base control is sent after so long even without feedback; own choice, two feedbacks."""
_INSIST: Final[Duration] = milliseconds(7)
"""Stop is said so often while the wheels still turn: 150 a second are heard well."""
_SHOUT: Final[Duration] = milliseconds(1)
"""And so often, as often as the line carries it, while so much of it is damaged that no feedback comes. Where
three bytes in ten are, the ten bytes of a command come through one time in 35."""
_LONGEST_SHOUT: Final = 20
"""Stops that are said at once at most, 200 bytes."""
_REPEAT: Final[Duration] = milliseconds(1000)
"""Outputs are sent again so often: nothing on this wire is acknowledged."""
_FULL_V, _LOW_V, _DANGER_V = 16.5, 14.0, 13.2
"""Voltages of a battery of four lithium-ion cells: full and above, low and below, so low that the base soon
switches itself off; kobuki_driver, battery defaults."""
_MARGIN_V: Final = 0.3
"""A level is left upwards only so far above its limit; own choice: motors pull the voltage down."""
_NOISE_BYTES: Final = 100
"""Damaged bytes in place of feedback, from which on the line and not the base is to blame; own choice: more
than a frame's."""


class KobukiDriver:
    """One base on one wire."""

    def __init__(self, started: Instant) -> None:
        self._reader = FrameReader(decode_feedback)
        self._safety = SafetyStop(started)
        self._heard: Instant = started
        self._sent: Instant = Instant(started - _OVERDUE)
        self._fed = False
        """Feedback has come since the last base control."""
        self._outputs = POWER_RAILS
        self._outputs_due = started
        self._skipped = 0
        """Damaged bytes until the last feedback."""
        self._sound = b""
        """A sound command that is still to be sent."""
        self._pressed = 0
        self._changes: list[StateChange] = []
        self._fields = dict.fromkeys(_FIELDS, 0)
        self.battery: BatteryLevel | None = None
        """None before the first feedback."""
        self.odometry = KobukiOdometry()
        self.found = False
        """True while the base sends feedback."""
        self.allowed = AllowedMotion(0.0, 0.0, ())
        """What the safety stop gave last."""

    # --- from the base ---

    def take(self, now: Instant, data: bytes) -> list[BaseFeedback]:
        """Take in bytes, also none, and the passing of time; return the feedbacks that they complete."""
        feedbacks = []
        for packets in self._reader.take(data):
            basic = next((packet for packet in packets if isinstance(packet, Basic)), None)
            inertial = next((packet for packet in packets if isinstance(packet, Inertial)), None)
            if basic is not None:
                feedbacks.append(BaseFeedback(now, basic, inertial))
                self._feedback(feedbacks[-1])
        if self.found and now - self._heard > FEEDBACK_SILENCE:
            self.found = False
            self.odometry.stand()
            self._changes.append(StateChange(now, "feedback", True, False))
        self._safety.hold(HoldCause.NOISE, self._noisy(now))
        return feedbacks

    def changes(self) -> list[StateChange]:
        """Return what has changed since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def pressed(self) -> int:
        """Return the bumper bits that were set at any time since the last call, as for Senses.bumper."""
        bits = self._pressed
        self._pressed = self._fields["bumper"] if self.found else 0
        return bits

    @property
    def reception(self) -> WireCounts:
        """Frames and noise so far."""
        return self._reader.reception

    # --- to the base ---

    def command(self, now: Instant, v: float, omega: float, issued: Instant | None = None) -> None:
        """Command `v` m/s forward and `omega` rad/s counter-clockwise; the safety stop decides.

        `issued`: when it was decided, if that is not now.
        """
        self._safety.command(now, now if issued is None else issued, v, omega)

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """Let nothing move for a cause that the base itself does not know of, or no longer for that one."""
        self._safety.hold(cause, holds)

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now: often none, else a base control and at most one other command."""
        passed = Duration(now - self._sent)
        if self._noisy(now):
            count = min(passed // _SHOUT, _LONGEST_SHOUT)
            self._sent = now if count else self._sent
            self._ask_safety_stop(now)
            return self.farewell() * count
        if not self._fed and passed < (_INSIST if self._unheeded else _OVERDUE):
            return b""
        self._fed, self._sent = False, now
        self._ask_safety_stop(now)
        control = motion.base_control(self.allowed.v, self.allowed.omega)
        return _framed(control) + self._other(now)

    def farewell(self) -> bytes:
        """Return the last bytes to write: stand, whatever was commanded."""
        return _framed(motion.base_control(0.0, 0.0))

    def _ask_safety_stop(self, now: Instant) -> None:
        before, self.allowed = self.allowed, self._safety.allowed(now)
        if self.allowed.stops != before.stops:
            self._changes.append(StateChange(now, "stops", before.stops, self.allowed.stops))

    def _noisy(self, now: Instant) -> bool:
        """Return whether noise comes in place of feedback."""
        silent = now - self._heard > FEEDBACK_SILENCE
        return silent and self._reader.reception.skipped - self._skipped >= _NOISE_BYTES

    @property
    def _unheeded(self) -> bool:
        """True while the wheels turn although they are told to stand."""
        stand = self.allowed.v == 0 and self.allowed.omega == 0
        return stand and self.found and self.odometry.moves

    def _feedback(self, feedback: BaseFeedback) -> None:
        now, basic, _ = feedback
        if not self.found:  # perhaps another base, or one that was switched off and on
            self.found, self._outputs_due = True, now
            self._changes.append(StateChange(now, "feedback", False, True))
        self._heard, self._fed = now, True
        self._skipped = self._reader.reception.skipped
        self._safety.sense(feedback)
        self.odometry.take(feedback)
        self._pressed |= basic.bumper
        for name, before in self._fields.items():
            if before != (value := getattr(basic, name)):
                self._changes.append(StateChange(now, name, before, value))
                self._fields[name] = value
        battery = level(basic.battery_dv / 10, self.battery)
        if battery is not self.battery:
            self._changes.append(StateChange(now, "battery", self.battery, battery))
            self.battery = battery
            self._warn(now, battery)

    def _warn(self, now: Instant, battery: BatteryLevel) -> None:
        """Show and sound a low battery; with one that is nearly empty nothing moves."""
        self._safety.hold(HoldCause.BATTERY, battery is BatteryLevel.DANGER)
        light = {BatteryLevel.LOW: wire.LED1_RED | wire.LED1_GREEN, BatteryLevel.DANGER: wire.LED1_RED}
        self._outputs, self._outputs_due = POWER_RAILS | light.get(battery, 0), now
        if battery in light:
            self._sound = _framed(SoundSequence(RECHARGE_MELODY))

    def _other(self, now: Instant) -> bytes:
        """Return the most urgent other command, or nothing."""
        if now >= self._outputs_due:
            self._outputs_due = Instant(now + _REPEAT)
            return _framed(GeneralOutput(self._outputs))
        sound, self._sound = self._sound, b""
        return sound


def _framed(command: Command) -> bytes:
    return encode_frame(encode_command(command))
