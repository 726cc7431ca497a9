"""A ROS 2 robot as driven by the base core."""

import functools
import os
from collections.abc import Callable

import msgspec

from actors.instant import Instant
from actors.robot_model import RobotModel
from firmware_bridge.onboard.contradictions import ContradictionMonitor
from firmware_bridge.onboard.vehicle import BaseLine, GuardedVehicle, GuardianLink, start_guardian
from firmware_bridge.ros2.driver import Publications, RobotDriver
from firmware_bridge.ros2.robot_link import RobotLink, node_name
from firmware_bridge.ros2.scan_reader import LaserScanReader
from firmware_bridge.ros2.session import Ros2Session
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.safety import HoldCause
from firmware_bridge.serial_port import Say

Take = Callable[[Instant, Publications], None]


class Ros2Robot(GuardedVehicle):
    """A base and a lidar behind ROS 2 topics, with a guardian."""

    def __init__(
        self,
        connect: Callable[[RobotDriver, LaserScanReader, Take], BaseLine],
        model: RobotModel,
        started: Instant,
        guardian_link: GuardianLink,
        say: Say,
    ) -> None:
        """Create it; `connect`: returns the connection, which passes messages to driver and reader."""
        self._robot = RobotDriver(model, started)
        reader = LaserScanReader(model.sensor, say)
        line = connect(self._robot, reader, self._take)
        monitor = ContradictionMonitor(model.sensor.mount, self._robot.limits.track)
        super().__init__(line, self._robot, reader, guardian_link, say, monitor)
        self._uses_gyro = True

    def charge(self) -> float | None:
        """Return the battery's charge, 0 to 1; None: unknown."""
        return self._robot.charge

    def describe(self, cause: HoldCause) -> str:
        """Return a cause in words."""
        detail = self._robot.details.get(cause)
        return cause.value if detail is None else f"{cause.value}: {detail}"

    def ignore_gyro(self) -> str:
        """Check without the gyro from now on; the odometry does not need it."""
        was_used, self._uses_gyro = self._uses_gyro, False
        return "gyro contradicted: checks without it from now on" if was_used else ""

    def _take(self, now: Instant, publications: Publications) -> None:
        feedbacks = self._robot.take(now, publications)
        if not self._uses_gyro:
            feedbacks = [one._replace(gyro=None) for one in feedbacks]
        self.take_feedbacks(now, feedbacks)


def create_ros2_robot(base: Ros2Base, model: RobotModel, now: Callable[[], Instant], say: Say) -> Ros2Robot:
    """Create the vehicle of a robot, which may be missing at first."""
    settings = msgspec.json.encode(base).decode()

    def connect(driver: RobotDriver, reader: LaserScanReader, take: Take) -> RobotLink:
        session = Ros2Session(base, node_name("base", os.getpid()), now)
        return RobotLink(session, base, driver, reader, take, now, say)

    start = functools.partial(start_guardian, program=("-m", "firmware_bridge.ros2.guardian"))
    guardian = GuardianLink(settings, start)
    return Ros2Robot(connect, model, now(), guardian, say)
