"""The guardian of a ROS 2 robot: answers to heartbeats, stop commands, and standstill by odometry."""

import time

import numpy as np

from actors.geometry import Pose
from actors.instant import Instant
from firmware_bridge.kobuki.guardian import NOT_READY, stop_until_standstill
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.guardian import PoseStandstill, RobotStop
from firmware_bridge.ros2.settings import Ros2Base
from tests.helpers import free_port
from tests.ros2.routers import start_router
from tests.ros2.sdk import message
from tests.ros2.test_session import session, wait_for


def odometry(stamp_s: int, x: float) -> bytes:
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    still = {"twist": {"linear": zero, "angular": zero}, "covariance": np.zeros(36)}
    pose = {"position": {**zero, "x": x}, "orientation": {**zero, "w": 1.0}}
    header = {"stamp": {"sec": stamp_s, "nanosec": 0}, "frame_id": "odom"}
    fields = {"header": header, "child_frame_id": "base_link", "twist": still}
    fields["pose"] = {"pose": pose, "covariance": np.zeros(36)}
    made = message(message_types.STORE, message_types.ODOMETRY, fields)
    return message_types.encode(made, message_types.ODOMETRY)


def test_it_is_ready_once_commands_reach_the_robot_and_stops_it_until_standstill() -> None:
    port = free_port()
    base = Ros2Base(kind="ros2", router=f"tcp/127.0.0.1:{port}", namespace="/r1")
    router, stop = start_router(port), RobotStop(base, "guardian")
    try:
        assert stop.take(b"o\x05", ()) == NOT_READY
        with session(base, "robot") as robot:
            commands = robot.subscribe("/r1/cmd_vel", message_types.TWIST)
            poses = robot.publisher("/r1/odom", message_types.ODOMETRY)
            wait_for(lambda: stop.take(b"p", ()) == b"o\x05")
            assert stop.take(b"c\x06", ()) == NOT_READY  # the base lost its connection
            time.sleep(0.2)  # subscriptions reach the publishers' sessions
            for second in range(8):
                poses.put(odometry(second, 0.1 * min(second, 3)), second)
                time.sleep(0.06)
                assert stop.send()
                assert not stop.is_standing or second >= 6
            said = stop_until_standstill(stop)
            wait_for(lambda: commands.publishers)
            sample = commands.take()[-1]
            twist = message_types.decode(sample.payload, message_types.TWIST)
            assert (twist.linear.x, twist.angular.z) == (0.0, 0.0)
            assert said.endswith("until the wheels stood")
            stop.reset()
            assert not stop.is_standing
        said = stop_until_standstill(stop, limit_s=0.1)
        assert "no standstill was detected" in said
    finally:
        stop.close()
        router.close()  # type: ignore[no-untyped-call]


def test_repeated_and_short_odometry_is_no_standstill() -> None:
    repeated, fast = PoseStandstill(), PoseStandstill()
    for number in range(10):
        repeated.take(Instant(50_000 * number), 7, Pose(1.0, 2.0, 0.0))
        fast.take(Instant(1000 * number), number, Pose(1.0, 2.0, 0.0))
    assert not repeated.is_reached and not fast.is_reached
