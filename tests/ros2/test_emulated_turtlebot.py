"""The emulated robots: rates, mounts, watchdogs and faults, as the sources of the real ones describe them."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from actors.floor.map_file import load_map
from actors.geometry import Pose
from actors.installation.repository import REPOSITORY
from actors.instant import Instant, seconds
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.names import EndpointKind
from firmware_bridge.ros2.session import Ros2Session
from firmware_bridge.ros2.settings import RouterLink
from tests.ros2 import definitions
from tests.ros2.emulation import TurtlebotProcess, robots_world
from tests.ros2.test_session import wait_for
from tests.ros2.turtlebots import EmulatedTurtlebot, TurtlebotWorld

EPOCH_NS = 1_700_000_000_000_000_000


class TopicRecorder:
    """A world with both robots, r1 and r2, and all that they published."""

    def __init__(self) -> None:
        self.world = TurtlebotWorld(robots_world(["turtlebot4", "turtlebot3_burger"]), EPOCH_NS)
        self.seen: dict[tuple[str, str], list[dict[str, Any]]] = {}

    def run(self, duration_s: float, **commands: tuple[float, float]) -> None:
        """Advance; `commands`: velocity by robot, sent every 50 ms."""
        end = self.world.now + seconds(duration_s)
        while self.world.now < end:
            for robot, (v, omega) in commands.items():
                self.robot(robot).take_command(v, omega, self.world.now)
            for one in self.world.advance(Instant(self.world.now + 50_000)):
                self.seen.setdefault((one.robot, one.topic), []).append(one.fields)

    def robot(self, name: str) -> EmulatedTurtlebot:
        return self.world.robots[name]

    def last(self, robot: str, topic: str) -> dict[str, Any]:
        return self.seen[robot, topic][-1]


def stamp(fields: dict[str, Any]) -> float:
    """Return the stamp of a message, s since the start."""
    at = fields["header"]["stamp"]
    return float(at["sec"] - EPOCH_NS // 10**9 + at["nanosec"] * 1e-9)


def test_topics_have_the_robots_rates() -> None:
    recorder = TopicRecorder()
    recorder.run(0.2)
    assert len(recorder.seen.pop(("r1", "hazard_detection"))) == 1
    recorder.seen.clear()
    recorder.run(4.0)
    counts = {key: len(found) for key, found in recorder.seen.items()}
    assert counts == {  # hazards have not changed
        ("r1", "scan"): 32,
        ("r1", "odom"): 80,
        ("r1", "imu"): 160,
        ("r1", "wheel_status"): 160,
        ("r1", "battery_state"): 4,
        ("r1", "dock_status"): 4,
        ("r2", "scan"): 20,
        **{("r2", topic): 80 for topic in ("odom", "imu", "battery_state", "sensor_state")},
    }


def test_a_create_stops_without_commands_and_a_turtlebot_3_never_does() -> None:
    recorder = TopicRecorder()
    recorder.run(1.0, r1=(0.2, 0.0), r2=(0.2, 0.0))
    recorder.run(1.5)
    assert recorder.world.speed("r1") == pytest.approx(0.0, abs=0.01)
    assert recorder.world.speed("r2") == pytest.approx(0.2, abs=0.01)
    recorder.robot("r2").run_node(False, recorder.world.now)  # the firmware's heartbeat ends
    recorder.run(0.4)
    assert recorder.world.speed("r2") == pytest.approx(0.2, abs=0.01)
    recorder.run(0.6)
    assert recorder.world.speed("r2") == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("robot", "mount"), [("r1", Pose(-0.04, 0.0, math.pi / 2)), ("r2", Pose(-0.032, 0.0, 0.0))]
)
def test_echoes_lie_on_the_walls_of_the_map(robot: str, mount: Pose) -> None:
    recorder = TopicRecorder()
    recorder.run(0.5)
    scan, (x, y, heading) = recorder.last(robot, "scan"), recorder.world.pose(robot)
    ranges, limit = scan["ranges"].astype(float), 5.0
    angles = scan["angle_min"] + np.arange(len(ranges)) * scan["angle_increment"] + mount.heading + heading
    near = (ranges > scan["range_min"]) & (ranges > 0) & (ranges < limit)
    assert near.sum() > 100
    lidar = (
        x + mount.x * math.cos(heading) - mount.y * math.sin(heading),
        y + mount.x * math.sin(heading) + mount.y * math.cos(heading),
    )
    hits = np.stack([lidar[0] + ranges * np.cos(angles), lidar[1] + ranges * np.sin(angles)], axis=1)[near]
    grid = load_map(REPOSITORY / "maps/corridor.yaml")
    rows, columns = np.nonzero(grid.blocking)
    cells = np.stack([columns, rows], axis=1) * grid.resolution + np.array(grid.origin) + grid.resolution / 2
    distances, _ = KDTree(cells).query(hits)
    assert np.quantile(distances, 0.9) < 0.12  # a mount turned by 90° gives 0.5 m and more


@pytest.mark.parametrize(
    ("state", "rays", "increment"),
    [("works", 1080, 0.005806980188935995), ("short", 269, 0.023379595950245857)],
)
def test_scans_have_the_headers_of_recorded_ones(state: str, rays: int, increment: float) -> None:
    """Compares with two real robots: turtlebot/turtlebot4, issues 312 and 664."""
    recorder = TopicRecorder()
    recorder.robot("r1").faults.scan = state
    recorder.run(0.2)
    scan = recorder.last("r1", "scan")
    assert len(scan["ranges"]) == rays and scan["header"]["frame_id"] == "rplidar_link"
    names = ("angle_min", "angle_max", "angle_increment", "range_min", "range_max")
    assert [np.float32(scan[name]) for name in names] == pytest.approx(
        [-3.1241390705108643, 3.1415927410125732, increment, 0.15000000596046448, 12.0], rel=1e-6
    )
    assert scan["scan_time"] == pytest.approx(0.1216442659497261, rel=0.05)
    assert scan["time_increment"] == pytest.approx(scan["scan_time"] / (rays - 1))


def test_odometry_follows_the_robot_and_its_faults() -> None:
    recorder = TopicRecorder()
    start = recorder.world.pose("r1")
    recorder.run(2.0, r1=(0.2, 0.3))
    x, y, heading = recorder.world.pose("r1")
    found = recorder.last("r1", "odom")["pose"]["pose"]
    assert found["position"]["x"] == pytest.approx(x - start[0], abs=0.03)  # the start's heading is 0
    assert found["position"]["y"] == pytest.approx(y - start[1], abs=0.03)
    turned = 2 * math.atan2(found["orientation"]["z"], found["orientation"]["w"])
    assert turned == pytest.approx(heading, abs=0.03)
    recorder.robot("r1").shift_odometry(Pose(1.0, -2.0, 0.0))
    recorder.run(0.1)
    jumped = recorder.last("r1", "odom")["pose"]["pose"]["position"]
    assert jumped["x"] == pytest.approx(found["position"]["x"] + 1.0, abs=0.03)
    assert jumped["y"] == pytest.approx(found["position"]["y"] - 2.0, abs=0.03)
    recorder.robot("r1").reset_odometry()
    recorder.robot("r1").faults.odom_scale = 2.0
    recorder.run(1.0, r1=(0.2, 0.0))
    doubled = recorder.last("r1", "odom")["pose"]["pose"]["position"]
    assert math.hypot(doubled["x"], doubled["y"]) == pytest.approx(0.4, abs=0.06)


def test_scan_faults_change_what_they_name() -> None:
    recorder = TopicRecorder()
    faults = recorder.robot("r1").faults
    recorder.run(0.3)
    shown = recorder.last("r1", "scan")
    for state, same_ranges, same_stamp in (("frozen", True, True), ("repeated", True, False)):
        faults.scan = state
        recorder.run(0.3)
        found = recorder.last("r1", "scan")
        assert (np.array_equal(found["ranges"], shown["ranges"]), stamp(found) == stamp(shown)) == (
            same_ranges,
            same_stamp,
        )
    faults.scan, before = "stopped", len(recorder.seen["r1", "scan"])
    recorder.run(0.5)
    assert len(recorder.seen["r1", "scan"]) == before
    faults.scan = "alternating"
    recorder.run(0.5)
    counts = [len(one["ranges"]) for one in recorder.seen["r1", "scan"][before:]]
    assert sorted(set(counts)) == [720, 1080] and counts[0] != counts[1]
    shown_ranges = {}
    for state in ("empty", "blind", "mixed"):
        faults.scan = state
        recorder.run(0.3)
        shown_ranges[state] = recorder.last("r1", "scan")["ranges"]
    assert len(shown_ranges["empty"]) == 0 and np.isposinf(shown_ranges["blind"]).all()
    mixed = shown_ranges["mixed"]
    assert np.isnan(mixed).any() and np.isneginf(mixed).any() and (mixed == 0).any() and (mixed > 12).any()
    faults.scan, faults.scan_turn = "works", math.pi / 2
    recorder.run(0.3)
    turned = recorder.last("r1", "scan")["ranges"][: -1080 // 4]
    assert np.mean(np.abs(turned - shown["ranges"][1080 // 4 :]) < 0.1) > 0.9  # the first ray is 90° further
    faults.scan, faults.scan_delay = "works", 0.4
    recorder.run(1.0)
    assert recorder.world.now * 1e-6 - stamp(recorder.last("r1", "scan")) >= 0.4


def test_the_clock_of_a_base_differs_from_that_of_its_lidar() -> None:
    recorder = TopicRecorder()
    recorder.robot("r1").faults.clock, recorder.robot("r1").faults.base_clock = -1.0, 100.0
    recorder.run(0.5)
    now = recorder.world.now * 1e-6
    assert stamp(recorder.last("r1", "scan")) == pytest.approx(now - 1.0, abs=0.3)
    assert stamp(recorder.last("r1", "odom")) == pytest.approx(now + 99.0, abs=0.1)
    assert stamp(recorder.last("r2", "odom")) == pytest.approx(now, abs=0.1)


def test_the_odometry_of_a_turtlebot_3_has_the_heading_of_its_gyro() -> None:
    recorder = TopicRecorder()
    for robot in ("r1", "r2"):
        recorder.robot(robot).faults.imu = "frozen"
    recorder.run(2.0, r1=(0.0, 0.5), r2=(0.0, 0.5))
    turned = {
        robot: recorder.last(robot, "odom")["pose"]["pose"]["orientation"]["z"] for robot in ("r1", "r2")
    }
    assert turned["r1"] > 0.3 and turned["r2"] == 0.0
    recorder.robot("r2").faults.imu = "stopped"
    seen = len(recorder.seen["r2", "odom"])
    recorder.run(0.5)
    assert len(recorder.seen["r2", "odom"]) == seen


def test_the_counts_and_values_of_an_lds_vary_as_its_driver_lets_them() -> None:
    recorder = TopicRecorder()
    recorder.run(3.0)
    scans = recorder.seen["r2", "scan"]
    assert len({len(one["ranges"]) for one in scans}) > 5
    assert all(
        np.isnan(one["ranges"]).any() and (one["range_min"], one["range_max"]) == (0, 100) for one in scans
    )
    assert recorder.last("r2", "battery_state")["percentage"] == 80  # percent, of the robot's own making


def test_a_base_that_refuses_says_so_only_where_it_does_on_the_robot() -> None:
    recorder = TopicRecorder()
    for robot in ("r1", "r2"):
        faults = recorder.robot(robot).faults
        faults.has_estop = True
        recorder.run(0.5, **{robot: (0.2, 0.0)})
        assert recorder.world.speed(robot) < 0.01
        faults.has_estop, faults.ignores_commands = False, True
        recorder.run(0.5, **{robot: (0.2, 0.0)})
        assert recorder.world.speed(robot) < 0.01
    assert {one["wheels_enabled"] for one in recorder.seen["r1", "wheel_status"]} == {True, False}
    assert {one["torque"] for one in recorder.seen["r2", "sensor_state"]} == {True, False}
    faults = recorder.robot("r1").faults
    faults.ignores_commands = False
    faults.hazards.add("backup_limit")
    recorder.run(0.5, r1=(-0.1, 0.0))
    assert recorder.world.speed("r1") < 0.01
    assert [one["type"] for one in recorder.last("r1", "hazard_detection")["detections"]] == [0]
    recorder.run(0.5, r1=(0.1, 0.0))
    assert recorder.world.speed("r1") > 0.05


def test_a_create_backs_off_from_a_wall_and_backs_up_a_metre_at_most() -> None:
    recorder = TopicRecorder()
    recorder.world.move_robot("r1", Pose(12.0, 12.5, -math.pi / 2))
    while not recorder.robot("r1")._bumped and recorder.world.now < seconds(20.0):
        recorder.run(0.05, r1=(0.2, 0.0))
    at_wall = recorder.world.pose("r1")
    recorder.run(0.3, r1=(0.2, 0.0))
    assert recorder.world.pose("r1")[1] > at_wall[1] + 0.01  # it does so by itself
    recorder.run(1.0, r1=(0.0, 0.0))
    kinds = [
        [one["type"] for one in shown["detections"]] for shown in recorder.seen["r1", "hazard_detection"]
    ]
    assert kinds == [[], [1], []]
    recorder.world.move_robot("r1", Pose(12.0, 12.5, math.pi))
    recorder.run(10.0, r1=(-0.2, 0.0))
    assert recorder.world.pose("r1")[0] - 12.0 == pytest.approx(1.0, abs=0.1)
    assert [one["type"] for one in recorder.last("r1", "hazard_detection")["detections"]] == [0]
    recorder.run(2.0, r1=(0.2, 0.0))
    assert recorder.last("r1", "hazard_detection")["detections"] == []


def test_a_robot_is_driven_over_the_sdk_across_a_restart_of_its_router(tmp_path: Path) -> None:
    """Shows a rival publisher of `cmd_vel` as well, and a second robot behind zenoh-bridge-ros2dds."""
    world, bridged = robots_world(["turtlebot4", "turtlebot4"]), {"bridge": "ros2dds", "stamped": False}
    with TurtlebotProcess(tmp_path, world, domain=3, r2=bridged) as robots:
        link = RouterLink(router=robots.router, domain=3, namespace="/r1")
        with Ros2Session(link, "base", lambda: Instant(time.monotonic_ns() // 1000)) as session:
            kind = definitions.TWIST_STAMPED
            publisher = session.publisher("/r1/cmd_vel", kind)
            scans = session.subscribe("/r1/scan", definitions.SCAN)

            def drive() -> bool:
                now = message_types.new("builtin_interfaces/Time", sec=0, nanosec=0)
                header = message_types.new("std_msgs/Header", stamp=now, frame_id="")
                stamped = message_types.new("geometry_msgs/TwistStamped", header=header, twist=twist(0.1))
                publisher.put(message_types.encode(stamped, kind), time.time_ns())
                return robots.where("r1").speed > 0.05

            wait_for(drive)
            robots.order("rival r1 teleop 0")
            wait_for(lambda: "/r1/teleop" in _publishers(session))
            robots.order("rival r1 off 0")
            wait_for(lambda: _publishers(session) == {"/r1/base"})
            robots.order("router r1 off")
            wait_for(lambda: robots.where("r1").speed < 0.01)
            assert not drive()
            robots.order("router r1 on")
            wait_for(drive)
            scans.take()
            wait_for(scans.take)
        _drive_a_bridged_robot(robots)
        assert robots.errors == ""


def _drive_a_bridged_robot(robots: TurtlebotProcess) -> None:
    link = RouterLink(router=robots.router, namespace="/r2", bridge="ros2dds")
    with Ros2Session(link, "base", lambda: Instant(time.monotonic_ns() // 1000)) as session:
        publisher = session.publisher("/r2/cmd_vel", definitions.TWIST)
        odometry = session.subscribe("/r2/odom", definitions.ODOMETRY)

        def drive() -> bool:
            publisher.put(message_types.encode(twist(0.1), definitions.TWIST), time.time_ns())
            return robots.where("r2").speed > 0.05

        wait_for(drive)
        wait_for(odometry.take)
        found = {(one.kind, one.topic, one.type) for one in session.endpoints()}
        assert (EndpointKind.SUBSCRIPTION, "/r2/cmd_vel", definitions.TWIST) in found
        assert (EndpointKind.PUBLISHER, "/r2/hazard_detection", definitions.HAZARDS) in found


def twist(v: float) -> Any:
    forward = message_types.new("geometry_msgs/Vector3", x=v, y=0.0, z=0.0)
    return message_types.new(
        "geometry_msgs/Twist",
        linear=forward,
        angular=message_types.new("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0),
    )


def _publishers(session: Ros2Session) -> set[str]:
    return {
        one.node
        for one in session.endpoints()
        if one.topic == "/r1/cmd_vel" and one.kind is EndpointKind.PUBLISHER
    }
