"""Vehicles as driven by the base core: a base with its guardian process, and a range sensor; TurtleBot 2."""

import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final, Protocol

from actors.geometry import ORIGIN, Pose
from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.messages import Odometry, Scan
from actors.robot_model import BatteryParameters
from actors.runtime.errors import AcrcError
from firmware_bridge.base_feedback import DriveFeedback
from firmware_bridge.kobuki import guardian
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.kobuki_motion import TRACK
from firmware_bridge.onboard.contradictions import ContradictionMonitor
from firmware_bridge.onboard.device_loop import DeviceLine, ServedDevices
from firmware_bridge.range_sensors.depth import CameraFeed, DepthError, DepthScanner
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.range_sensors.sensor import RangeReader
from firmware_bridge.safety import BaseDriver, BatteryLevel, HoldCause
from firmware_bridge.serial_port import Say, SerialPort

_HEARTBEAT_INTERVAL: Final = milliseconds(10)
"""Minimum interval of heartbeats."""
ECHO_TIMEOUT: Final = milliseconds(150)
"""Timeout of a heartbeat's echo after which the base stops; same as the guardian's."""
_HUNG_TIMEOUT: Final = seconds(2)
"""Timeout after which the guardian is replaced."""
_RESTART_DELAY: Final = milliseconds(200)
"""Delay before starting another one, during which the base sends stop."""
_EXIT_TIMEOUT_S: Final = 1.0
"""Timeout of waiting for the guardian at the end, s; it continues in the background."""


def start_guardian(
    channel: int, name: str, program: Sequence[str] = ("-S", guardian.__file__)
) -> "subprocess.Popen[bytes]":
    """Start a guardian in its own session, with isolated imports and this process's log.

    `program`: Python's arguments up to the guardian's program.
    """
    return subprocess.Popen(
        [sys.executable, "-I", *program, "beside", str(channel), name],
        pass_fds=(channel,),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        cwd="/",
    )


class GuardianLink:
    """Link to the guardian process, which is replaced after a failure. No motion is allowed unless it
    `is_operational`."""

    def __init__(
        self, name: str, start: Callable[[int, str], "subprocess.Popen[bytes]"] = start_guardian
    ) -> None:
        """Create it.

        `name`: the port, for messages. `start`: starts a guardian with a channel descriptor and the name.
        """
        self._name = name
        self._start = start
        self._channel: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._port: object | None = None
        """Port in the last message to the guardian."""
        self._number = 0
        """Number of that message."""
        self._confirmed = False
        self._pulsed_at = self._start_after = Instant(0)
        self._killed: list[subprocess.Popen[bytes]] = []
        self._unanswered_since: Instant | None = None
        """Time of the oldest heartbeat without echo."""
        self.started = 0
        """Number of started guardians."""

    def serve(self, now: Instant, port: object | None) -> None:
        """Send heartbeats, and the base's port after a change; call it continuously.

        `port`: a serial port, or the connection of a base whose guardian has its own; None: not connected.
        """
        self._receive(now)
        if self._unanswered_since is not None and now - self._unanswered_since > _HUNG_TIMEOUT:
            self._kill(now)
        if self._channel is None:
            if now < self._start_after:
                return
            self._begin()
        if port is not self._port:
            self._number = (self._number + 1) & 0xFF
            self._port, self._confirmed = port, False
            self._send(now, (b"c" if port is None else b"o") + bytes((self._number,)), port)
        elif now - self._pulsed_at >= _HEARTBEAT_INTERVAL:
            self._send(now, b"p")

    def is_operational(self, now: Instant) -> bool:
        """Return whether the guardian responds and has the port."""
        is_late = self._unanswered_since is not None and now - self._unanswered_since > ECHO_TIMEOUT
        return self._channel is not None and self._confirmed and self._port is not None and not is_late

    def close(self) -> None:
        """Let the guardian stop the wheels; wait for it up to `_EXIT_TIMEOUT_S`."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_EXIT_TIMEOUT_S)

    def _begin(self) -> None:
        self._killed = [process for process in self._killed if process.poll() is None]
        own_end, guardian_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with guardian_end:
            self._process = self._start(guardian_end.fileno(), self._name)
        own_end.setblocking(False)
        self._channel = own_end
        self.started += 1

    def _kill(self, now: Instant) -> None:
        """Kill a failed guardian."""
        self._start_after = Instant(now + _RESTART_DELAY)
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            self._process.kill()
            self._killed.append(self._process)
        self._channel = self._process = self._port = self._unanswered_since = None
        self._confirmed = False

    def _send(self, now: Instant, message: bytes, port: object | None = None) -> None:
        assert self._channel is not None
        self._pulsed_at = now
        self._unanswered_since = now if self._unanswered_since is None else self._unanswered_since
        try:
            descriptors = [port.fileno()] if isinstance(port, SerialPort) else []
            socket.send_fds(self._channel, [message], descriptors)
        except BlockingIOError:
            if port is not None:
                self._port = None  # send it again
        except OSError:
            self._kill(now)

    def _receive(self, now: Instant) -> None:
        while self._channel is not None:
            try:
                message = self._channel.recv(16)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self._kill(now)
                return
            self._unanswered_since = None
            if message == b"o" + bytes((self._number,)):
                self._confirmed = True
            elif message == guardian.NOT_READY:
                self._confirmed = False


class MotionUnknownError(AcrcError):
    """Possible motion of the base without feedback, which is missing in the odometry."""


class RangeDevice(ServedDevices, Protocol):
    """A range sensor with its connection."""

    reader: RangeReader

    def close(self) -> None:
        """Stop the sensor."""


class LidarDevice(DeviceLine):
    """An RPLIDAR on a port."""

    def __init__(self, open_port: Callable[[], SerialPort], driver: Rplidar, say: Say) -> None:
        super().__init__(open_port, driver, driver.take, say)
        self.reader: RangeReader = driver


class DepthCameraDevice:
    """A depth camera; without descriptor, it is polled by `serve`."""

    def __init__(self, feed: CameraFeed, scanner: DepthScanner, say: Say) -> None:
        self._feed = feed
        self._scanner = scanner
        self._say = say
        self.reader: RangeReader = scanner
        self.close = feed.close
        self.errors = 0
        """Number of images of the wrong size."""

    def descriptors(self) -> Sequence[int]:
        """Return no descriptors."""
        return ()

    def serve(self, now: Instant) -> None:
        """Process a new image, if any."""
        if (image := self._feed.take()) is None:
            return
        try:
            self._scanner.take(image.stamp, image.depth)
        except DepthError as error:
            if not self.errors:
                self._say(str(error))
            self.errors += 1


class BaseLine(ServedDevices, Protocol):
    """Connection to a base."""

    @property
    def port(self) -> object | None:
        """Connection that the guardian needs; None while commands cannot reach the base."""

    def close(self) -> None:
        """Send a stop and disconnect."""


class GuardedVehicle(ABC):
    """A differential base with its guardian and an optional range sensor."""

    def __init__(
        self,
        line: BaseLine,
        driver: BaseDriver,
        range_reader: RangeReader | None,
        guardian_link: GuardianLink,
        say: Say,
        monitor: ContradictionMonitor,
    ) -> None:
        self._line = line
        self._driver = driver
        self._range_reader = range_reader
        self._guardian = guardian_link
        self._say = say
        self._contradictions = monitor
        self._contradiction_causes: frozenset[HoldCause] = frozenset()

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""
        return self._line.descriptors()

    def serve(self, now: Instant) -> None:
        """Exchange data with the devices; stop without guardian or range data."""
        self._guardian.serve(now, self._line.port)
        self._driver.hold(HoldCause.NO_GUARDIAN, not self._guardian.is_operational(now))
        reader = self._range_reader
        if reader is not None:
            self._driver.hold(HoldCause.NO_RANGE_DATA, not reader.is_measuring(now))
            if reader.fault is not None:
                self._contradictions.report_range_fault(now, reader.fault)
            if (sweep := reader.sweep()) is not None:
                self._contradictions.sweep(now, sweep)
        self._line.serve(now)

    def close(self) -> None:
        """Stop the wheels and close all devices."""
        self._line.close()
        self._guardian.close()

    def odometry(self) -> Odometry:
        """Return the pose since the start, and the velocity."""
        return self._driver.odometry.read()

    def check_odometry(self) -> None:
        """Raise MotionUnknownError if the base may have moved without feedback."""
        if self._driver.odometry.unknown:
            raise MotionUnknownError(
                "no feedback from the base for too long, or it was restarted: motion in between is unknown"
            )

    def bumper(self) -> int:
        """Return the bits set since the last call, as in SensorData."""
        return self._driver.pressed()

    def scan(self) -> Scan | None:
        """Return the latest scan, once."""
        return None if self._range_reader is None else self._range_reader.scan()

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        """Command a velocity, based on data sensed at `issued`; the safety stop may refuse it."""
        self._driver.command(now, vx, omega, issued)

    def stop_reasons(self) -> tuple[str, ...]:
        """Return active stop causes and a low battery, in words."""
        stops = tuple(map(self.describe, (stop.cause for stop in self._driver.allowed.stops)))
        return (*stops, "battery low") if self._driver.battery is BatteryLevel.LOW else stops

    def describe(self, cause: HoldCause) -> str:
        """Return a cause in words."""
        return cause.value

    @abstractmethod
    def ignore_gyro(self) -> str:
        """Stop using the contradicted gyro; return the consequence in words, empty if there is none."""

    def take_feedbacks(self, now: Instant, feedbacks: Iterable[DriveFeedback]) -> None:
        """Pass contradictions of feedbacks to the safety stop; report changes of the driver's state."""
        for feedback in feedbacks:
            self._contradictions.set_command(self._driver.allowed.v, self._driver.allowed.omega)
            self._contradictions.feedback(feedback)
        for change in self._driver.changes():
            self._say(f"{in_seconds(now):.3f} {change}")
        if self._contradictions.is_gyro_contradicted and (consequence := self.ignore_gyro()):
            self._contradictions.ignore_gyro()
            self._say(f"{in_seconds(now):.3f} {consequence}")
        causes = self._contradictions.causes(now)
        for cause in causes ^ self._contradiction_causes:
            self._driver.hold(cause, cause in causes)
        self._contradiction_causes = causes


class TurtleBot(GuardedVehicle):
    """A Kobuki with its guardian and an optional range sensor."""

    def __init__(
        self,
        open_base: Callable[[], SerialPort],
        kobuki: KobukiDriver,
        ranger: RangeDevice | None,
        guardian_link: GuardianLink,
        say: Say,
        mount: Pose = ORIGIN,
        battery: BatteryParameters | None = None,
    ) -> None:
        """Create it; `mount`: pose of the range sensor on the body."""
        line = DeviceLine(open_base, kobuki, self._take, say)
        reader, monitor = (None, None) if ranger is None else (ranger.reader, mount)
        super().__init__(line, kobuki, reader, guardian_link, say, ContradictionMonitor(monitor, TRACK))
        self._battery = battery
        self._kobuki = kobuki
        self._ranger = ranger

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""
        return [*super().descriptors(), *(self._ranger.descriptors() if self._ranger else ())]

    def serve(self, now: Instant) -> None:
        """Exchange bytes with the devices; stop without guardian or range data."""
        if self._ranger is not None:
            self._ranger.serve(now)
        super().serve(now)

    def close(self) -> None:
        """Stop the wheels and close all devices."""
        super().close()
        if self._ranger is not None:
            self._ranger.close()

    def charge(self) -> float | None:
        """Return the battery's charge by its voltage, 0 to 1; None: unknown."""
        volts = self._kobuki.volts
        return None if volts is None or self._battery is None else self._battery.charge_at(volts)

    def ignore_gyro(self) -> str:
        """Compute the heading from the wheels if the gyro is constant."""
        if not self._kobuki.odometry.gyro_is_constant:
            return ""
        self._kobuki.odometry.uses_wheel_heading = True
        return "gyro frozen: heading computed from the wheels"

    def _take(self, now: Instant, data: bytes) -> None:
        feedbacks = self._kobuki.take(now, data)
        if self._kobuki.odometry.uses_wheel_heading:
            feedbacks = [one._replace(gyro=None) for one in feedbacks]
        self.take_feedbacks(now, feedbacks)
