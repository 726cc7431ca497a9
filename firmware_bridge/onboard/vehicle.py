"""A TurtleBot 2 with its range sensor: ports, drivers, and what the base core senses and does by them."""

import sys
from collections.abc import Callable, Sequence
from typing import Protocol

from actors.instant import Instant, in_seconds, seconds
from actors.messages import Odometry, Scan
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.events import Fed
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.serial_port import PortError, SerialPort

_RETRY = seconds(1)
"""A port that is not there is tried again so often."""


class WireDriver(Protocol):
    """What a Kobuki's and a lidar's driver have in common."""

    def due(self, now: Instant) -> bytes:
        """The bytes to write now."""

    def farewell(self) -> bytes:
        """The last bytes to write."""


class Wire:
    """One device on one port, which may come and go."""

    def __init__(
        self, open_port: Callable[[], SerialPort], driver: WireDriver, take: Callable[[Instant, bytes], None]
    ) -> None:
        """`take`: gives the driver what has come."""
        self._open = open_port
        self._driver = driver
        self._take = take
        self._port: SerialPort | None = None
        self._retry_at = Instant(0)
        self._said = ""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return () if self._port is None else (self._port.fileno(),)

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        if self._port is None:
            self._connect(now)
        data = self._exchange(lambda port: port.read()) or b""
        self._take(now, data)
        if due := self._driver.due(now):
            self._exchange(lambda port: port.write(due))

    def close(self) -> None:
        """Say farewell to the device, and give the port back."""
        last = self._driver.farewell()
        self._exchange(lambda port: port.write(last))
        if self._port is not None:
            self._port.close()

    def _connect(self, now: Instant) -> None:
        if now < self._retry_at:
            return
        self._retry_at = Instant(now + _RETRY)
        try:
            self._port = self._open()
            self._say("")
        except PortError as error:
            self._say(str(error))

    def _exchange(self, what: Callable[[SerialPort], bytes | None]) -> bytes | None:
        if self._port is None:
            return None
        try:
            return what(self._port)
        except PortError as error:
            self._say(str(error))
            self._port.close()
            self._port = None
            return None

    def _say(self, sentence: str) -> None:
        """Each thing once, into the process's log."""
        if sentence and sentence != self._said:
            sys.stderr.write(f"{sentence}\n")
            sys.stderr.flush()
        self._said = sentence


class TurtleBot:
    """A Kobuki, and a lidar if there is one."""

    def __init__(
        self,
        base: Callable[[], SerialPort],
        kobuki: KobukiDriver,
        ranger: Callable[[], SerialPort] | None = None,
        lidar: Rplidar | None = None,
    ) -> None:
        self._kobuki = kobuki
        self._lidar = lidar
        self._wires = [Wire(base, kobuki, self._feed)]
        if ranger is not None and lidar is not None:
            self._wires.append(Wire(ranger, lidar, lidar.take))

    @property
    def found(self) -> bool:
        """True while the Kobuki sends feedback."""
        return self._kobuki.found

    @property
    def wake(self) -> Instant | None:
        """Devices speak at their own pace."""
        return None

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return [number for wire in self._wires for number in wire.descriptors()]

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due."""
        for wire in self._wires:
            wire.serve(now)

    def close(self) -> None:
        """Stand, whatever was wanted."""
        for wire in self._wires:
            wire.close()

    def odometry(self) -> Odometry:
        """Pose since it was switched on, and velocity."""
        return self._kobuki.odometry.read()

    def bumper(self) -> int:
        """Bits as in Senses, of the time since the last call."""
        return self._kobuki.pressed()

    def scan(self) -> Scan | None:
        """The last sweep, once."""
        return None if self._lidar is None else self._lidar.scan()

    def command(self, now: Instant, vx: float, omega: float) -> None:
        """Want a velocity; the safety stop has the last word."""
        self._kobuki.command(now, vx, omega)

    def _feed(self, now: Instant, data: bytes) -> None:
        for event in self._kobuki.take(now, data):
            if not isinstance(event, Fed):
                sys.stdout.write(f"{in_seconds(now):.3f} {event}\n")
                sys.stdout.flush()
