"""The driver of a Kobuki without I/O: bytes from the base in, events and bytes to the base out.

A shell calls, every few milliseconds and whenever bytes have come: `take` with the bytes, also with none;
then writes what `due` gives. One base control goes out per feedback, 50 a second, as kobuki_driver does; a
base hears 150 a second well and 200 not (yujinrobot/kobuki, issue 140).
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from actors.instant import Duration, Instant, milliseconds
from firmware_bridge.kobuki import motion, wire
from firmware_bridge.kobuki.motion import KobukiOdometry
from firmware_bridge.kobuki.safety import FEEDBACK_SILENCE, Allowed, HoldCause, SafetyStop, StopCause
from firmware_bridge.kobuki.wire import (
    POWER_RAILS,
    RECHARGE_MELODY,
    Basic,
    Command,
    Feedback,
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


@dataclass(frozen=True)
class Found:
    """The base has begun to send feedback."""

    instant: Instant


@dataclass(frozen=True)
class Lost:
    """The base sends no feedback any more."""

    instant: Instant
    since: Instant
    """Of its last feedback."""


@dataclass(frozen=True)
class Fed:
    """One feedback; `packets` begins with Basic."""

    instant: Instant
    packets: tuple[Feedback, ...]


class Sense(Enum):
    """Fields of Basic whose changes are events; each value is the field's name."""

    BUMPER = "bumper"
    WHEEL_DROP = "wheel_drop"
    CLIFF = "cliff"
    BUTTONS = "buttons"
    CHARGER = "charger"
    OVERCURRENT = "overcurrent"


@dataclass(frozen=True)
class FieldChanged:
    """A field of Basic has another value than before; before the first feedback all were 0."""

    instant: Instant
    sense: Sense
    before: int
    now: int


@dataclass(frozen=True)
class BatteryChanged:
    """The battery has come to another level, or its level has become known."""

    instant: Instant
    volts: float
    level: BatteryLevel


@dataclass(frozen=True)
class StopsChanged:
    """Other causes hold the base back than before."""

    instant: Instant
    stops: tuple[StopCause, ...]


Event = Found | Lost | Fed | FieldChanged | BatteryChanged | StopsChanged


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
        self._outputs = POWER_RAILS
        self._outputs_due = started
        self._skipped = 0
        """Damaged bytes until the last feedback."""
        self._sound = b""
        """A sound command that is still to be sent."""
        self._pressed = 0
        self._told: list[Event] = []
        self._senses: dict[Sense, int] = {}
        self._battery: BatteryChanged | None = None
        self.odometry = KobukiOdometry()
        self.found = False
        """True while the base sends feedback."""
        self.allowed = Allowed(0.0, 0.0, ())
        """What the safety stop gave last."""

    # --- from the base ---

    def take(self, now: Instant, data: bytes) -> list[Event]:
        """The events of the bytes that have come, and of time having passed."""
        for packets in self._reader.take(data):
            self._feedback(now, packets)
        if self.found and now - self._heard > FEEDBACK_SILENCE:
            self.found = False
            self.odometry.stand()
            self._told.append(Lost(now, self._heard))
        self._safety.hold(HoldCause.NOISE, self._noisy(now))
        told, self._told = self._told, []
        return told

    def pressed(self) -> int:
        """Bumper bits that were set at any time since the last call, as for Senses.bumper."""
        bits = self._pressed
        self._pressed = self._senses.get(Sense.BUMPER, 0) if self.found else 0
        return bits

    @property
    def reception(self) -> WireCounts:
        """Frames and noise so far."""
        return self._reader.reception

    @property
    def battery(self) -> BatteryLevel | None:
        """How full it is; None before the first feedback."""
        return None if self._battery is None else self._battery.level

    @property
    def late_commands(self) -> int:
        """Commands that were overtaken by newer ones, and left out."""
        return self._safety.late_commands

    # --- to the base ---

    def command(self, now: Instant, v: float, omega: float, issued: Instant | None = None) -> None:
        """Want `v` m/s forward and `omega` rad/s counter-clockwise from now on; the safety stop decides.

        `issued`: when it was decided, if that is not now.
        """
        self._safety.wish(now, now if issued is None else issued, v, omega)

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """Let nothing move for a cause that the base itself does not know of, or no longer for that one."""
        self._safety.hold(cause, holds)

    def due(self, now: Instant) -> bytes:
        """The bytes to write now: often none, else a base control and at most one other command."""
        passed = Duration(now - self._sent)
        if self._noisy(now):
            said = min(passed // _SHOUT, _LONGEST_SHOUT)
            self._sent = now if said else self._sent
            self._stops(now)
            return self.farewell() * said
        if not self._fed and passed < (_INSIST if self._unheeded else _OVERDUE):
            return b""
        self._fed, self._sent = False, now
        self._stops(now)
        control = motion.base_control(self.allowed.v, self.allowed.omega)
        return _framed(control) + self._other(now)

    def _stops(self, now: Instant) -> None:
        """Ask the safety stop, and tell of what has changed."""
        before, self.allowed = self.allowed, self._safety.allowed(now)
        if self.allowed.stops != before.stops:
            self._told.append(StopsChanged(now, self.allowed.stops))

    def _noisy(self, now: Instant) -> bool:
        """True while in place of feedback there is noise."""
        silent = now - self._heard > FEEDBACK_SILENCE
        return silent and self._reader.reception.skipped - self._skipped >= _NOISE_BYTES

    @property
    def _unheeded(self) -> bool:
        """True while the wheels turn although they are told to stand."""
        told = self.allowed.v == 0 and self.allowed.omega == 0
        return told and self.found and self.odometry.moves

    def farewell(self) -> bytes:
        """The last bytes to write: stand, whatever was wanted."""
        return _framed(motion.base_control(0.0, 0.0))

    # --- within ---

    def _feedback(self, now: Instant, packets: list[Feedback]) -> None:
        basic = next((packet for packet in packets if isinstance(packet, Basic)), None)
        inertial = next((packet for packet in packets if isinstance(packet, Inertial)), None)
        if basic is not None and not self.found:
            self._meet(now)
        if basic is None:
            return
        self._heard, self._fed = now, True
        self._skipped = self._reader.reception.skipped
        self._safety.sense(now, basic, inertial)
        self.odometry.take(now, basic, inertial)
        self._pressed |= basic.bumper
        self._told.append(Fed(now, tuple(packets)))
        self._notice(now, basic)

    def _meet(self, now: Instant) -> None:
        """A base has appeared, perhaps another, perhaps one that was switched off and on."""
        self.found = True
        self._outputs_due = now
        self._told.append(Found(now))

    def _notice(self, now: Instant, basic: Basic) -> None:
        """Tell what has changed since the feedback before."""
        for sense in Sense:
            value = getattr(basic, sense.value)
            before = self._senses.get(sense, 0)
            if value != before:
                self._told.append(FieldChanged(now, sense, before, value))
            self._senses[sense] = value
        volts = basic.battery_dv / 10
        known = self.battery
        here = level(volts, known)
        if here is not known:
            self._battery = BatteryChanged(now, volts, here)
            self._told.append(self._battery)
            self._warn(now, here)

    def _warn(self, now: Instant, battery: BatteryLevel) -> None:
        """Show and sound a low battery; with one that is nearly empty nothing moves."""
        self._safety.hold(HoldCause.BATTERY, battery is BatteryLevel.DANGER)
        light = {BatteryLevel.LOW: wire.LED1_RED | wire.LED1_GREEN, BatteryLevel.DANGER: wire.LED1_RED}
        self._outputs, self._outputs_due = POWER_RAILS | light.get(battery, 0), now
        if battery in light:
            self._sound = _framed(SoundSequence(RECHARGE_MELODY))

    def _other(self, now: Instant) -> bytes:
        """The most urgent other command, or nothing."""
        if now >= self._outputs_due:
            self._outputs_due = Instant(now + _REPEAT)
            return _framed(GeneralOutput(self._outputs))
        if self._sound:
            sound, self._sound = self._sound, b""
            return sound
        return b""


def _framed(command: Command) -> bytes:
    return encode_frame(encode_command(command))
