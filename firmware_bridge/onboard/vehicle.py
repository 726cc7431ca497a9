"""TurtleBot 2 as the base core drives it: Kobuki with its guardian process, and a range sensor."""

import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, Protocol

from actors.geometry import Pose
from actors.instant import Duration, Instant, in_seconds, milliseconds, seconds
from actors.messages import Odometry, Scan
from actors.runtime.errors import AcrcError
from firmware_bridge.kobuki import guardian
from firmware_bridge.kobuki.driver import BatteryLevel, Fed, KobukiDriver
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import Basic, Inertial
from firmware_bridge.onboard.contradictions import Contradictions
from firmware_bridge.onboard.device_loop import Wire
from firmware_bridge.range_sensors.depth import CameraFeed, DepthError, DepthScanner
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.range_sensors.sensor import SensorSweep
from firmware_bridge.serial_port import SerialPort

_PULSE: Final[Duration] = milliseconds(10)
"""The least time between two pulses."""
PATIENCE: Final[Duration] = milliseconds(150)
"""A pulse that has not come back for so long: the guardian does not watch. As it does the other way round."""
_HUNG: Final[Duration] = seconds(2)
"""After so long another guardian is started."""
_PAUSE: Final[Duration] = milliseconds(200)
"""Before it is, so that the base has said stop itself."""
_FAREWELL_S: Final = 1.0
"""How long it is waited for in the end; it goes on without that."""


class Port(Protocol):
    """What the guardian is given."""

    def fileno(self) -> int:
        """The descriptor."""


class LastWord:
    """One guardian after the other, if need be; nothing may move while none `holds` the port."""

    def __init__(
        self, name: str, start: Callable[[int, str], "subprocess.Popen[bytes]"] | None = None
    ) -> None:
        """`name`: of the port, for people. `start`: a guardian with that descriptor for its channel."""
        self._name = name
        self._start = start or start_guardian
        self._channel: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._given: Port | None = None
        """The port that the guardian was told of last."""
        self._number = 0
        """Of the last message that told of a port."""
        self._confirmed = False
        self._pulsed = self._begin_at = Instant(0)
        self._ended: list[subprocess.Popen[bytes]] = []
        self._waiting: Instant | None = None
        """Since when there is a pulse that has not come back."""
        self.started = 0
        """Guardians so far."""

    def serve(self, now: Instant, port: Port | None) -> None:
        """Let the guardian know that the base lives, and of the port it has; to be called all the time."""
        self._hear(now)
        if self._waiting is not None and now - self._waiting > _HUNG:
            self._end(now)
        if self._channel is None:
            if now < self._begin_at:
                return
            self._begin()
        if port is not self._given:
            self._give(now, port)
        elif now - self._pulsed >= _PULSE:
            self._send(now, b"p")

    def holds(self, now: Instant) -> bool:
        """True while the guardian lives, and has the port."""
        late = self._waiting is not None and now - self._waiting > PATIENCE
        return self._channel is not None and self._confirmed and self._given is not None and not late

    def close(self) -> None:
        """Leave the last word to the guardian, and wait until the wheels stand, if that is soon."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_FAREWELL_S)

    def _begin(self) -> None:
        self._ended = [process for process in self._ended if process.poll() is None]
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = self._start(theirs.fileno(), self._name)
        ours.setblocking(False)
        self._channel, self._given, self._waiting = ours, None, None
        self._confirmed = False
        self.started += 1

    def _end(self, now: Instant) -> None:
        """This guardian is of no use any more."""
        self._begin_at = Instant(now + _PAUSE)
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            self._process.kill()
            self._ended.append(self._process)
        self._channel = self._process = self._given = self._waiting = None
        self._confirmed = False

    def _give(self, now: Instant, port: Port | None) -> None:
        self._number = (self._number + 1) & 0xFF
        self._given, self._confirmed = port, False
        if port is None:
            self._send(now, b"c" + bytes((self._number,)))
        else:
            self._send(now, b"o" + bytes((self._number,)), [port.fileno()])

    def _send(self, now: Instant, message: bytes, ports: list[int] | None = None) -> None:
        assert self._channel is not None
        self._pulsed = now
        self._waiting = now if self._waiting is None else self._waiting
        try:
            socket.send_fds(self._channel, [message], ports or [])
        except BlockingIOError:
            if ports:
                self._given = None  # to be told again
        except OSError:
            self._end(now)

    def _hear(self, now: Instant) -> None:
        """What has come back."""
        while self._channel is not None:
            try:
                message = self._channel.recv(16)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self._end(now)
                return
            self._waiting = None
            if message == b"o" + bytes((self._number,)):
                self._confirmed = True


def start_guardian(channel: int, name: str) -> "subprocess.Popen[bytes]":
    """Start one, in a session of its own, with nothing to load but itself; it has our log."""
    return subprocess.Popen(
        [sys.executable, "-I", "-S", guardian.__file__, "beside", str(channel), name],
        pass_fds=(channel,),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        cwd="/",
    )


ORIGIN: Final = Pose(0.0, 0.0, 0.0)
Say = Callable[[str], None]
"""Takes a line for the log; does not wait for a disk."""


class MotionUnknownError(AcrcError):
    """Odometry that is no longer what it says."""


class Ranger(Protocol):
    """A range sensor that is plugged in."""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""

    def serve(self, now: Instant) -> None:
        """Take in what it has measured."""

    def scan(self) -> Scan | None:
        """The last sweep, once."""

    def sees(self, now: Instant) -> bool:
        """True while it measures, and anything is seen."""

    def sweep(self) -> SensorSweep | None:
        """The samples of the last turn or image, once."""

    def doubts(self) -> tuple[HoldCause, ...]:
        """What it says that no sensor that measures says."""

    def close(self) -> None:
        """Let it rest."""


class Lidar:
    """An RPLIDAR on a port."""

    def __init__(self, open_port: Callable[[], SerialPort], driver: Rplidar, say: Say) -> None:
        self._wire = Wire(open_port, driver, driver.take, say)
        self.descriptors = self._wire.descriptors
        self.serve = self._wire.serve
        self.close = self._wire.close
        self.scan = driver.scan
        self.sees = driver.sees
        self.sweep = driver.sweep
        self._driver = driver

    def doubts(self) -> tuple[HoldCause, ...]:
        """That it repeats itself, as a whole or in part."""
        whole, part = self._driver.repeats, self._driver.stands_still
        return (HoldCause.REPEATS,) if whole else (HoldCause.SCAN_PART,) if part else ()


class DepthRanger:
    """A depth camera; it has no descriptor, and is looked at whenever the base is served."""

    def __init__(self, feed: CameraFeed, scanner: DepthScanner, say: Say) -> None:
        self._feed = feed
        self._scanner = scanner
        self._say = say
        self.scan = scanner.scan
        self.sees = scanner.sees
        self.sweep = scanner.sweep
        self.close = feed.close
        self.errors = 0
        """Images that cannot be this camera's."""

    def descriptors(self) -> Sequence[int]:
        """None."""
        return ()

    def doubts(self) -> tuple[HoldCause, ...]:
        """That it repeats itself."""
        return (HoldCause.REPEATS,) if self._scanner.repeats else ()

    def serve(self, now: Instant) -> None:
        """Take in an image if there is a new one."""
        if (image := self._feed.take()) is None:
            return
        try:
            self._scanner.take(image.stamp, image.depth)
        except DepthError as error:
            if not self.errors:
                self._say(str(error))
            self.errors += 1


class TurtleBot:
    """A Kobuki, a guardian that has the last word to it, and a range sensor if there is one."""

    def __init__(
        self,
        base: Callable[[], SerialPort],
        kobuki: KobukiDriver,
        ranger: Ranger | None,
        last_word: LastWord,
        say: Say,
        mount: Pose = ORIGIN,
    ) -> None:
        """`mount`: of the range sensor on the body."""
        self._contradictions = Contradictions(None if ranger is None else mount)
        self._held: frozenset[HoldCause] = frozenset()
        self._kobuki = kobuki
        self._wire = Wire(base, kobuki, self._feed, say)
        self._ranger = ranger
        self._last_word = last_word
        self._say = say

    @property
    def wake(self) -> Instant | None:
        """Devices speak at their own pace."""
        return None

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return [*self._wire.descriptors(), *(self._ranger.descriptors() if self._ranger else ())]

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; nothing may move unseen, or without a guardian."""
        self._last_word.serve(now, self._wire.port)
        self._kobuki.hold(HoldCause.UNWATCHED, not self._last_word.holds(now))
        if self._ranger is not None:
            self._ranger.serve(now)
            self._kobuki.hold(HoldCause.BLIND, not self._ranger.sees(now))
            for cause in self._ranger.doubts():
                self._contradictions.repeated(now, cause)
            if (sweep := self._ranger.sweep()) is not None:
                self._contradictions.sweep(now, sweep)
        self._wire.serve(now)

    def close(self) -> None:
        """Stand, whatever was wanted."""
        self._wire.close()
        self._last_word.close()
        if self._ranger is not None:
            self._ranger.close()

    def odometry(self) -> Odometry:
        """Pose since it was switched on, and velocity."""
        return self._kobuki.odometry.read()

    def check_odometry(self) -> None:
        """Raises MotionUnknownError if the base may have moved unheard."""
        if self._kobuki.odometry.unknown:
            raise MotionUnknownError(
                "the base was not heard for too long, or has been switched off and on: "
                "what it moved meanwhile is not known"
            )

    def bumper(self) -> int:
        """Bits as in Senses, of the time since the last call."""
        return self._kobuki.pressed()

    def scan(self) -> Scan | None:
        """The last sweep, once."""
        return None if self._ranger is None else self._ranger.scan()

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        """Want a velocity, decided from what was sensed at `issued`; the safety stop has the last word."""
        self._kobuki.command(now, vx, omega, issued)

    def held(self) -> tuple[str, ...]:
        """Why the safety stop lets it not drive as is wanted; and whether its battery runs low."""
        stops = tuple(stop.cause.value for stop in self._kobuki.allowed.stops)
        return (*stops, "the battery is low") if self._kobuki.battery is BatteryLevel.LOW else stops

    def _feed(self, now: Instant, data: bytes) -> None:
        for event in self._kobuki.take(now, data):
            if isinstance(event, Fed):
                self._compare(event)
            else:
                self._say(f"{in_seconds(now):.3f} {event}")
        odometry = self._kobuki.odometry
        if self._contradictions.gyro_judged and odometry.gyro_is_still:
            odometry.trust_wheels()
            self._contradictions.on_wheels()
            self._say(f"{in_seconds(now):.3f} the gyro stands still: the heading is that of the wheels")
        causes = self._contradictions.causes(now)
        for cause in causes ^ self._held:
            self._kobuki.hold(cause, cause in causes)
        self._held = causes

    def _compare(self, fed: Fed) -> None:
        """Compare what the base says with what else is known."""
        basic = next(packet for packet in fed.packets if isinstance(packet, Basic))
        inertial = next((packet for packet in fed.packets if isinstance(packet, Inertial)), None)
        self._contradictions.commanded(self._kobuki.allowed.v, self._kobuki.allowed.omega)
        gyro = None if self._kobuki.odometry.on_wheels else inertial
        self._contradictions.feedback(fed.instant, basic, gyro)
