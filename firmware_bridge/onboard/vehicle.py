"""A TurtleBot 2 with its range sensor: what the base core senses and does by them."""

import sys
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant, in_seconds
from actors.messages import Odometry, Scan
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.events import Fed
from firmware_bridge.onboard.wire import Wire
from firmware_bridge.range_sensors.depth import DepthScanner
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.serial_port import SerialPort


class Ranger(Protocol):
    """A range sensor that is plugged in."""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""

    def serve(self, now: Instant) -> None:
        """Take in what it has measured."""

    def scan(self) -> Scan | None:
        """The last sweep, once."""

    def close(self) -> None:
        """Let it rest."""


class Lidar:
    """An RPLIDAR on a port."""

    def __init__(self, open_port: Callable[[], SerialPort], driver: Rplidar) -> None:
        self._wire = Wire(open_port, driver, driver.take)
        self.descriptors = self._wire.descriptors
        self.serve = self._wire.serve
        self.close = self._wire.close
        self.scan = driver.scan


class Camera(Protocol):
    """Gives depth images."""

    def read(self, patience: float) -> NDArray[np.uint16] | None:
        """The next image, mm; None if there is none after `patience` s."""

    def close(self) -> None:
        """Give the camera back."""


class DepthRanger:
    """A depth camera; it has no descriptor, and is looked at whenever the base is served."""

    def __init__(self, camera: Camera, scanner: DepthScanner) -> None:
        self._camera = camera
        self._scanner = scanner
        self.scan = scanner.scan
        self.close = camera.close

    def descriptors(self) -> Sequence[int]:
        """None."""
        return ()

    def serve(self, now: Instant) -> None:
        """Take in an image if there is a new one."""
        image = self._camera.read(0.0)
        if image is not None:
            self._scanner.take(now, image)


class TurtleBot:
    """A Kobuki, and a range sensor if there is one."""

    def __init__(
        self, base: Callable[[], SerialPort], kobuki: KobukiDriver, ranger: Ranger | None = None
    ) -> None:
        self._kobuki = kobuki
        self._wire = Wire(base, kobuki, self._feed)
        self._ranger = ranger

    @property
    def wake(self) -> Instant | None:
        """Devices speak at their own pace."""
        return None

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return [*self._wire.descriptors(), *(self._ranger.descriptors() if self._ranger else ())]

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due."""
        self._wire.serve(now)
        if self._ranger is not None:
            self._ranger.serve(now)

    def close(self) -> None:
        """Stand, whatever was wanted."""
        self._wire.close()
        if self._ranger is not None:
            self._ranger.close()

    def odometry(self) -> Odometry:
        """Pose since it was switched on, and velocity."""
        return self._kobuki.odometry.read()

    def bumper(self) -> int:
        """Bits as in Senses, of the time since the last call."""
        return self._kobuki.pressed()

    def scan(self) -> Scan | None:
        """The last sweep, once."""
        return None if self._ranger is None else self._ranger.scan()

    def command(self, now: Instant, vx: float, omega: float) -> None:
        """Want a velocity; the safety stop has the last word."""
        self._kobuki.command(now, vx, omega)

    def _feed(self, now: Instant, data: bytes) -> None:
        for event in self._kobuki.take(now, data):
            if not isinstance(event, Fed):
                sys.stdout.write(f"{in_seconds(now):.3f} {event}\n")
                sys.stdout.flush()
