"""Guardian process of a ROS 2 robot: publishes stop commands until it stands if the base process fails.

`python -I -m firmware_bridge.ros2.guardian beside CHANNEL BASE` is started by a base process and has a
session of its own; BASE: the settings as JSON. `alone BASE`: after all processes were killed. The rest is as
in firmware_bridge.kobuki.guardian. A Create 3 stops by itself 0.5 s after the last command, a TurtleBot 3
does not (ROBOTIS-GIT/turtlebot3, issue 1154).
"""

import os
import sys
import time
from collections import deque
from collections.abc import Sequence
from typing import Final

import msgspec

from actors.geometry import Pose, wrap
from actors.instant import Instant, milliseconds
from actors.portable import hypot
from firmware_bridge.kobuki import guardian
from firmware_bridge.ros2.message_types import ODOMETRY, InvalidMessageError
from firmware_bridge.ros2.robot_feedback import read_pose
from firmware_bridge.ros2.robot_link import node_name
from firmware_bridge.ros2.session import Ros2Session
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.ros2.velocity_commands import CommandPublisher

_WINDOW: Final = 5
"""Number of odometry messages for detecting standstill, 0.2 s."""
_SPAN: Final = milliseconds(150)
"""Minimum time between the first and the last of them."""
_STILL: Final = 0.002
"""Maximum change of a standing robot's pose within the window, m and rad; own choice: 1 cm/s."""


class PoseStandstill:
    """Detector of standstill from a robot's odometry."""

    def __init__(self) -> None:
        self._poses: deque[tuple[Instant, int, Pose]] = deque(maxlen=_WINDOW)

    @property
    def is_reached(self) -> bool:
        """True if the pose was constant during a full window."""
        if len(self._poses) < _WINDOW or self._poses[-1][0] - self._poses[0][0] < _SPAN:
            return False
        _, _, first = self._poses[0]
        return all(
            hypot(one.x - first.x, one.y - first.y) <= _STILL
            and abs(wrap(one.heading - first.heading)) <= _STILL
            for _, _, one in self._poses
        )

    def take(self, arrived: Instant, stamp: int, pose: Pose) -> None:
        """Add a pose; a message with a repeated stamp is ignored."""
        if not self._poses or self._poses[-1][1] != stamp:
            self._poses.append((arrived, stamp, pose))


class RobotStop:
    """Sender of stop commands to a ROS 2 robot."""

    def __init__(self, base: Ros2Base, part: str) -> None:
        """Start to connect; `part`: of the node's name."""
        self._session = Ros2Session(base, node_name(part, os.getppid()), _now)
        self._publisher = CommandPublisher(self._session, base)
        self._odometry = self._session.subscribe(base.topic("odom"), ODOMETRY, hidden=True)
        self._standstill = PoseStandstill()
        self._opened = b""
        """Last message that announced the base's connection."""

    @property
    def is_ready(self) -> bool:
        """True: a lost router may return."""
        return True

    @property
    def is_standing(self) -> bool:
        """True if the robot has stood since `reset`."""
        return self._standstill.is_reached

    def reset(self) -> None:
        """Forget the odometry received."""
        self._standstill = PoseStandstill()

    def take(self, message: bytes, descriptors: Sequence[int]) -> bytes:
        """Return the answer to a message: that a stop can be sent, or NOT_READY."""
        self._publisher.update(_now())
        self._odometry.take()
        if message[:1] in {b"o", b"c"}:
            self._opened = message
        return self._opened if self._publisher.is_ready and self._opened[:1] == b"o" else guardian.NOT_READY

    def send(self) -> bool:
        """Publish one stop command and read odometry; return True."""
        now = _now()
        self._publisher.update(now)
        self._publisher.put(now, 0.0, 0.0)
        for sample in self._odometry.take():
            try:
                message = sample.message(ODOMETRY)
                stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
                self._standstill.take(sample.arrived, stamp, read_pose(message))
            except InvalidMessageError:
                continue
        return True

    def close(self) -> None:
        """Close the session."""
        self._session.close()


def _now() -> Instant:
    return Instant(time.time_ns() // 1000)


def main(argv: Sequence[str]) -> int:
    """Run the guardian; return the exit code: 0 unless the robot may still drive."""
    guardian.ignore_signals()
    base = msgspec.json.decode(argv[-1], type=Ros2Base)
    sender = RobotStop(base, "guardian")
    if argv[0] == "beside":
        said = guardian.watch_parent(int(argv[1]), sender)
    else:
        said = guardian.stop_until_standstill(sender)
    return guardian.report(base.topic("command"), said)


if __name__ == "__main__":
    os._exit(main(sys.argv[1:]))  # threads of Zenoh may wait for a router that has ended
