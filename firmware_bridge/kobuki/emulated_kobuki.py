"""Emulated Kobuki at the byte level: accepts commands, moves a body, sends feedback.

Encoders and gyro have the errors of the simulated world (actors.world.odometry). It keeps executing the last
command, without watchdog or safety controller in the firmware: the worst case.
"""

import math
import struct
from collections import deque
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Protocol

from numpy.random import Generator

from actors.geometry import Pose
from actors.instant import START, Instant, in_seconds
from actors.portable import cos, sin
from actors.portable.draws import normals
from actors.robot_model import KobukiErrors
from firmware_bridge.kobuki import kobuki_motion
from firmware_bridge.kobuki.kobuki_packets import (
    POWER_RAILS,
    BaseControl,
    BasicSensorData,
    Command,
    FeedbackPacket,
    FrameReader,
    GeneralOutput,
    InertialSensorData,
    UnknownPacket,
    decode_commands,
    encode_feedback,
    encode_frame,
)


class BodyTruth(NamedTuple):
    """Ground truth of a body's pose and velocity."""

    pose: Pose
    v: float
    """Forward velocity, m/s."""
    omega: float
    """Turn rate, rad/s."""


class Body(Protocol):
    """Body that an emulated base drives, in a simulated world or standalone."""

    def drive(self, v: float, omega: float) -> None:
        """Set the velocity: `v` m/s forward and `omega` rad/s."""

    def advance(self, now: Instant) -> None:
        """Advance the body to `now`, unless a world moves it."""

    def truth(self) -> BodyTruth:
        """Return the current ground truth."""

    def bumper(self) -> int:
        """Return the pressed sectors: bit 0 right, 1 centre, 2 left."""


NO_ERRORS: Final = KobukiErrors(
    gyro_noise_deg=0.0, gyro_bias_deg=0.0, gyro_walk_deg=0.0, wheel_scale=0.0, slip=0.0
)
"""No errors except the protocol's resolution."""
_BYTE_US: Final = 10e6 / 115_200


@dataclass(frozen=True)
class BaseParameters:
    """Errors and initial counters of an emulated base."""

    errors: KobukiErrors = NO_ERRORS
    stamp_ms: int = 0
    left_ticks: int = 0
    right_ticks: int = 0
    angle: float = 0.0
    """Gyro angle, rad."""


@dataclass
class KobukiFaults:
    """Faults of the base, set and cleared by tests."""

    silent: bool = False
    """No feedback."""
    deaf: bool = False
    """New commands are ignored; the last one continues."""
    bumper: int = 0
    """Bumper bits that stay pressed."""
    cliff: int = 0
    wheel_drop: int = 0
    """Wheel-drop bits: the base is lifted, its wheels turn freely."""
    gyro: Literal["works", "frozen", "absent"] = "works"
    left_scale: float = 1.0
    """Scale of the encoder's ticks; 0: stopped."""
    right_scale: float = 1.0
    gyro_scale: float = 1.0
    """Scale of the gyro's rate."""
    gyro_drift: float = 0.0
    """Offset of the gyro's rate, rad/s."""
    stamp: Literal["works", "frozen", "backward", "jumping"] = "works"
    """Behaviour of the base's clock; "jumping": by 20 s per feedback."""
    battery: float = 16.0
    """Battery voltage, V."""
    buttons: int = 0
    charger: int = 0
    overcurrent: int = 0


class EmulatedKobuki:
    """One base, switched on at START; random numbers come from `generator`."""

    def __init__(
        self,
        body: Body,
        generator: Generator,
        parameters: BaseParameters = BaseParameters(),
    ) -> None:
        self._body = body
        self._generator = generator
        self._p = parameters
        self._reader = FrameReader(decode_commands)
        self.reception = self._reader.reception
        """Counts of received frames and noise bytes."""
        self._now = START
        self._feedbacks = 0
        self._pose = body.truth().pose
        errors = parameters.errors
        left, right, bias = normals(generator, 3).tolist()
        self._scale = (1 + left * errors.wheel_scale, 1 + right * errors.wheel_scale)
        self._left = self._right = self._angle = self._rate = 0.0
        """Measured distances of the wheels, m, angle and rate of the gyro, errors included."""
        self._bias = bias * math.radians(errors.gyro_bias_deg)
        self._frozen: InertialSensorData | None = None
        self._last_stamp = parameters.stamp_ms
        self._line: deque[tuple[Instant, bytes]] = deque()
        """Start time and bytes of frames to send."""
        self._sent = 0
        """Number of sent bytes of the first frame."""
        self.faults = KobukiFaults()
        self.outputs = POWER_RAILS
        """Last setting of digital outputs, power rails and LEDs."""
        self.commands: deque[tuple[Instant, Command]] = deque(maxlen=1024)
        """Last commands with their time of arrival."""

    def take(self, now: Instant, data: bytes) -> None:
        """Accept bytes from the driver whose last one arrives `now`."""
        if self.faults.deaf:
            return
        for commands in self._reader.take(data):
            for command in commands:
                self.commands.append((now, command))
                self._execute(command)

    def run(self, now: Instant) -> bytes:
        """Advance to `now`; return the bytes sent to the driver, at 11 520 per second."""
        self._body.advance(now)
        truth = self._body.truth()
        period = self._p.errors.feedback
        while (self._feedbacks + 1) * period <= now:
            self._feedbacks += 1
            at = Instant(self._feedbacks * period)
            self._measure(truth, at, now)
            data = encode_frame(b"".join(map(encode_feedback, self._packets(at))))
            if not self.faults.silent:
                self._line.append((at, data))  # at most 164 bytes take 14 ms: the previous one has been sent
        self._measure(truth, now, now)
        return self._sent_bytes(now)

    # --- motion ---

    def _execute(self, command: Command) -> None:
        if isinstance(command, BaseControl):
            self._body.drive(*((0.0, 0.0) if self.faults.wheel_drop else kobuki_motion.velocity(command)))
        elif isinstance(command, GeneralOutput):
            self.outputs = command.flags

    def _measure(self, truth: BodyTruth, until: Instant, now: Instant) -> None:
        """Add the motion since the last measurement up to `until`, interpolated towards `truth` at `now`."""
        if until == self._now:
            return
        share = (until - self._now) / (now - self._now)
        forward, turn = _motion(self._pose, truth.pose)
        forward, turn = forward * share, turn * share
        course = self._pose.heading + turn / 2
        chord = forward * _chord(turn)
        self._pose = (
            truth.pose
            if until == now
            else self._pose._replace(
                x=self._pose.x + chord * cos(course),
                y=self._pose.y + chord * sin(course),
                heading=self._pose.heading + turn,
            )
        )
        time = in_seconds(until - self._now)
        self._now = until
        errors = self._p.errors
        noise = normals(self._generator, 4).tolist()
        left, right = forward - turn * errors.track / 2, forward + turn * errors.track / 2
        left = left * self._scale[0] + noise[0] * errors.slip * math.sqrt(abs(left))
        right = right * self._scale[1] + noise[1] * errors.slip * math.sqrt(abs(right))
        self._left += left * self.faults.left_scale
        self._right += right * self.faults.right_scale
        turn = turn * self.faults.gyro_scale + self.faults.gyro_drift * time
        measured_turn = (
            turn + self._bias * time + noise[2] * math.radians(errors.gyro_noise_deg) * math.sqrt(time)
        )
        self._angle += measured_turn
        self._rate = measured_turn / time
        self._bias += noise[3] * math.radians(errors.gyro_walk_deg) * math.sqrt(time)

    # --- feedback ---

    def _packets(self, at: Instant) -> list[FeedbackPacket]:
        per_tick = self._p.errors.tick_um * 1e-6
        basic = BasicSensorData(
            stamp_ms=self._stamp(at),
            bumper=self._body.bumper() | self.faults.bumper,
            wheel_drop=self.faults.wheel_drop,
            cliff=self.faults.cliff,
            left_ticks=(self._p.left_ticks + math.floor(self._left / per_tick)) & 0xFFFF,
            right_ticks=(self._p.right_ticks + math.floor(self._right / per_tick)) & 0xFFFF,
            left_pwm=0,
            right_pwm=0,
            buttons=self.faults.buttons,
            charger=self.faults.charger,
            battery_dv=round(10 * self.faults.battery),
            overcurrent=self.faults.overcurrent,
        )
        inertial, raw = self._gyro()
        floor = [200 if self.faults.cliff & bit else 2000 for bit in (1, 2, 4)]
        packets: list[FeedbackPacket] = [
            basic,
            UnknownPacket(3, bytes(3)),
            inertial,
            UnknownPacket(5, struct.pack("<3H", *floor)),
            UnknownPacket(6, bytes(2)),
            raw,
            UnknownPacket(16, bytes(16)),
        ]
        absent = (inertial, raw) if self.faults.gyro == "absent" else ()
        return [packet for packet in packets if packet not in absent]

    def _stamp(self, at: Instant) -> int:
        """Return the base's clock, ms."""
        correct_ms = self._p.stamp_ms + at // 1000
        if self.faults.stamp == "works":
            self._last_stamp = correct_ms
        else:
            self._last_stamp += {"frozen": 0, "backward": -20, "jumping": 20_000}[self.faults.stamp]
        return self._last_stamp & 0xFFFF

    def _gyro(self) -> tuple[InertialSensorData, UnknownPacket]:
        resolution = math.radians(self._p.errors.gyro_resolution_deg)
        angle = math.remainder(self._p.angle + self._angle, math.tau)
        rate = math.degrees(self._rate)
        inertial = InertialSensorData(round(angle / resolution), kobuki_motion.to_int16(round(rate * 100)))
        if self.faults.gyro == "frozen":
            inertial = self._frozen = self._frozen or inertial
        else:
            self._frozen = None
        z = kobuki_motion.to_int16(round(rate / 0.00875))
        return inertial, UnknownPacket(13, struct.pack("<BB6h", self._feedbacks & 0xFF, 6, 0, 0, z, 0, 0, z))

    def _sent_bytes(self, now: Instant) -> bytes:
        """Return the bytes sent completely by `now`."""
        out = b""
        while self._line:
            started, data = self._line[0]
            sent = max(self._sent, math.floor((now - started) / _BYTE_US))
            out += data[self._sent : sent]
            if sent < len(data):
                self._sent = sent
                break
            self._line.popleft()
            self._sent = 0
        return out


def _motion(before: Pose, after: Pose) -> tuple[float, float]:
    """Return length, m, and turn, rad, of the arc between two poses."""
    turn = math.remainder(after.heading - before.heading, math.tau)
    course = before.heading + turn / 2
    chord = cos(course) * (after.x - before.x) + sin(course) * (after.y - before.y)
    return chord / _chord(turn), turn


def _chord(turn: float) -> float:
    """Return the ratio of chord to arc length for a turn, rad."""
    return sin(turn / 2) / (turn / 2) if turn else 1.0
