"""The log as ROS 2 has it, by a reader of another library, beside what was recorded."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN
from actors.geometry import Pose
from actors.messages import DRIVE, SENSES
from observation.evidence.recorded import taken
from observation.evidence.run_evidence import RunEvidence
from observation.robot_logs.robot_entries import occupancy
from tests.robot_logs.conftest import Log

ADD, DELETE_ALL = 0, 3
CYLINDER, LINES = 3, 5


def stamp(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def pose(told: Any) -> Pose:
    turned = told.orientation
    assert turned.x == turned.y == 0 and turned.z**2 + turned.w**2 == pytest.approx(1)
    return Pose(told.position.x, told.position.y, 2 * math.atan2(turned.z, turned.w))


def placed(transform: Any) -> Pose:
    shift, turned = transform.transform.translation, transform.transform.rotation
    return Pose(shift.x, shift.y, 2 * math.atan2(turned.z, turned.w))


def near(one: Pose, other: Pose) -> bool:
    turned = math.remainder(one.heading - other.heading, math.tau)
    return math.hypot(one.x - other.x, one.y - other.y) < 1e-9 and abs(turned) < 1e-9


def shapes(log: Log, topic: str) -> dict[float, list[Any]]:
    """By second what is drawn from then on; every message begins with taking all away."""
    found = {}
    for logged, message in log[topic]:
        first, *markers = message.markers
        assert first.action == DELETE_ALL and all(one.action == ADD for one in markers)
        found[logged / 1e9] = markers
    return found


def test_a_player_of_bags_finds_what_it_needs_in_the_file(ros2_file: Path) -> None:
    with ros2_file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2" and summary is not None
        (about,) = reader.iter_metadata()
        assert (about.name, about.metadata) == ("rosbag2", {"serialized_metadata": ""})
        latched = set()
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert (qos["history"], qos["reliability"], qos["liveliness"]) == (1, 1, 1)
            assert (qos["durability"], qos["depth"]) in {(1, 1), (2, 10)}
            if qos["durability"] == 1:
                latched.add(channel.topic)
        assert latched == {"/map", "/tf_static", "/places", "/robots", "/things"}
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times) and times[0] == 0


def test_every_topic_has_its_type(ros2_file: Path) -> None:
    with ros2_file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = {one.topic: summary.schemas[one.schema_id].name for one in summary.channels.values()}
    own = {
        "truth": "geometry_msgs/msg/PoseStamped",
        "pose": "geometry_msgs/msg/PoseStamped",
        "goal": "geometry_msgs/msg/PoseStamped",
        "odom": "nav_msgs/msg/Odometry",
        "cmd_vel": "geometry_msgs/msg/Twist",
        "scan": "sensor_msgs/msg/LaserScan",
        "plan": "nav_msgs/msg/Path",
        "local_costmap": "nav_msgs/msg/OccupancyGrid",
        "particles": "sensor_msgs/msg/PointCloud2",
    }
    assert found == {f"/{robot}/{name}": kind for robot in ("r1", "r2") for name, kind in own.items()} | {
        "/tf": "tf2_msgs/msg/TFMessage",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/map": "nav_msgs/msg/OccupancyGrid",
        "/places": "visualization_msgs/msg/MarkerArray",
        "/robots": "visualization_msgs/msg/MarkerArray",
        "/things": "visualization_msgs/msg/MarkerArray",
        "/links": "visualization_msgs/msg/MarkerArray",
        "/rosout": "rcl_interfaces/msg/Log",
    }


def test_commanded_velocities_are_those_that_the_world_received(ros2: Log, out: Path) -> None:
    sent = [(robot, drive.vx, drive.omega) for robot, drive in taken(out / "world" / "world.mcap", DRIVE)]
    for robot in ("r1", "r2"):
        told = [(message.linear.x, message.angular.z) for _, message in ros2[f"/{robot}/cmd_vel"]]
        assert told == [tuple(velocity) for one, *velocity in sent if one == robot]
        assert any(forward for forward, _ in told)
    assert [at for at, _ in ros2["/r2/cmd_vel"]] == [at for at, _ in ros2["/r2/odom"]]


def test_true_and_estimated_poses_are_those_of_every_step(ros2: Log, evidence: RunEvidence) -> None:
    for index, robot in enumerate(evidence.robots):
        true = ros2[f"/{robot}/truth"]
        assert [logged for logged, _ in true] == [round(second * 1e6) * 1000 for second in evidence.seconds]
        for (logged, message), wanted in zip(true, evidence.true[:, index].tolist(), strict=True):
            assert stamp(message.header.stamp) == logged and message.header.frame_id == "map"
            assert near(pose(message.pose), Pose(*wanted))
        held = evidence.held[:, index]
        told = [message for _, message in ros2[f"/{robot}/pose"]]
        wanted_poses = held[~np.isnan(held[:, 0])].tolist()
        assert len(told) == len(wanted_poses) > 70
        assert all(near(pose(m.pose), Pose(*w)) for m, w in zip(told, wanted_poses, strict=True))


def test_frames_lead_from_the_map_to_the_estimate_and_to_the_truth(ros2: Log, evidence: RunEvidence) -> None:
    frames: dict[tuple[int, str], tuple[str, Pose]] = {}
    for logged, message in ros2["/tf"]:
        for one in message.transforms:
            assert stamp(one.header.stamp) == logged
            frames[logged, one.child_frame_id] = (one.header.frame_id, placed(one))
    for index, robot in enumerate(evidence.robots):
        compared = 0
        for logged, message in ros2[f"/{robot}/pose"]:
            parent, odom = frames[logged, f"{robot}/odom"]
            between, base = frames[logged, f"{robot}/base_link"]
            assert (parent, between) == ("map", f"{robot}/odom")
            assert near(odom.compose(base), pose(message.pose))
            parent, true = frames[logged, f"{robot}/truth"]
            step = int(np.flatnonzero(np.isclose(evidence.seconds, logged / 1e9))[0])
            assert parent == "map" and near(true, Pose(*evidence.true[step, index].tolist()))
            compared += 1
        assert compared > 70
    ((_, static),) = ros2["/tf_static"]
    assert [(one.header.frame_id, one.child_frame_id) for one in static.transforms] == [
        ("r1/base_link", "r1/laser"),
        ("r2/base_link", "r2/laser"),
    ]
    assert static.transforms[0].transform.translation.x == -0.1  # turtlebot2.toml


def test_scans_are_as_recorded_and_infinite_where_nothing_was(ros2: Log, out: Path) -> None:
    recorded = [
        scan
        for path in (out / "r1" / "r1.mcap", out / "r1" / "r1.1.mcap")
        for _, senses in taken(path, SENSES)
        if not senses.halt
        for scan in (*senses.earlier_scans, *([senses.scan] if senses.scan else []))
    ]
    told = [message for _, message in ros2["/r1/scan"]]
    assert [stamp(one.header.stamp) for one in told] == [scan.stamp * 1000 for scan in recorded]
    seen = infinite = 0
    for message, scan in zip(told, recorded, strict=True):
        ranges = np.array(message.ranges)
        millimetres = np.frombuffer(scan.ranges_mm, "<u2")
        nothing = millimetres == 65535
        assert message.header.frame_id == "r1/laser" and len(ranges) == len(millimetres)
        assert np.isposinf(ranges[nothing]).all()
        assert np.abs(ranges[~nothing] - millimetres[~nothing] / 1000).max() < 1e-6
        last = message.angle_min + (len(ranges) - 1) * message.angle_increment
        assert last == pytest.approx(message.angle_max, abs=1e-5)
        seen, infinite = seen + int((~nothing).sum()), infinite + int(nothing.sum())
    assert seen > 1000 and infinite > 1000


def test_the_map_is_the_robots_map(ros2: Log, evidence: RunEvidence) -> None:
    ((_, told),) = ros2["/map"]
    grid = evidence.grid
    assert (told.info.height, told.info.width) == grid.cells.shape
    assert told.info.resolution == pytest.approx(grid.resolution)
    assert pose(told.info.origin) == (*grid.origin, 0.0)
    cells = np.array(told.data).reshape(grid.cells.shape)
    for kind, value in ((FREE, 0), (OCCUPIED, 100), (UNKNOWN, -1)):
        assert (grid.cells == kind).any() and (cells[grid.cells == kind] == value).all()


def test_costs_have_the_numbers_of_an_occupancy_grid() -> None:
    costs = np.array([[0, 1, 252, 253, 254, 255]], np.uint8)
    assert occupancy(costs).tolist() == [[0, 1, 98, 99, 100, -1]]
    every = occupancy(np.arange(255, dtype=np.uint8))
    assert (np.diff(every) >= 0).all()


def test_a_cost_map_lies_around_its_robot(ros2: Log) -> None:
    held = {logged: pose(message.pose) for logged, message in ros2["/r1/pose"]}
    for logged, message in ros2["/r1/local_costmap"]:
        side = message.info.width * message.info.resolution
        middle = pose(message.info.origin).compose(Pose(side / 2, side / 2, 0.0))
        assert math.dist(middle[:2], held[logged][:2]) < 0.2
        assert min(message.data) >= -1 and max(message.data) == 100


def test_what_navigation_means_begins_at_the_robot_and_ends_at_its_goal(ros2: Log) -> None:
    goals = ros2["/r1/goal"]
    plan = next(message for _, message in ros2["/r1/plan"] if message.poses)
    held = pose(ros2["/r1/pose"][0][1].pose)
    assert math.dist(pose(plan.poses[0].pose)[:2], held[:2]) < 0.3
    assert math.dist(pose(plan.poses[-1].pose)[:2], pose(goals[0][1].pose)[:2]) < 0.3


def test_particles_are_where_the_robot_holds_itself_to_be(ros2: Log) -> None:
    _, message = ros2["/r1/particles"][-1]
    points = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 3)
    assert message.point_step == 12 and message.width == len(points) > 100
    last = pose(ros2["/r1/pose"][-1][1].pose)
    assert np.hypot(*(points[:, :2].mean(axis=0) - last[:2])) < 0.3 and not points[:, 2].any()


def test_orders_put_things_there_and_take_them_away(ros2: Log) -> None:
    things = shapes(ros2, "/things")
    kinds = {second: sorted(one.type for one in found) for second, found in things.items()}
    assert kinds[1.0] == [CYLINDER] and kinds[2.0] == [CYLINDER, CYLINDER]
    assert kinds[3.0] == [CYLINDER, CYLINDER, LINES] and kinds[4.0] == [CYLINDER, LINES]
    (obstacle,) = things[1.0]
    assert (obstacle.pose.position.x, obstacle.pose.position.y, obstacle.scale.x) == (14.0, 12.0, 0.4)
    (door,) = (one for one in things[4.0] if one.type == LINES)
    middle = np.mean([(one.x, one.y) for one in door.points], axis=0)
    assert math.dist(middle, (12.5, 9.4)) < 0.6


def test_places_and_bodies_are_in_the_robots_colours_and_states(ros2: Log, evidence: RunEvidence) -> None:
    places = shapes(ros2, "/places")[0.0]
    wanted = [place for body in evidence.setup.robots for place in body.places]
    assert [(one.pose.position.x, one.pose.position.y) for one in places] == wanted
    assert [one.ns for one in places] == ["r1"] * 3 + ["r2"] * 3
    red, orange = places[0].color, places[-1].color
    assert (red.r, red.b) == (0.0, pytest.approx(178 / 255)) and orange.r == pytest.approx(213 / 255)
    opacity = {
        second: {one.ns: one.color.a for one in found if one.type == CYLINDER}
        for second, found in shapes(ros2, "/robots").items()
    }
    assert opacity[0.0]["r2"] == pytest.approx(0.9) and opacity[4.0]["r2"] == pytest.approx(0.4)
    assert opacity[6.0]["r2"] == pytest.approx(0.9)
    assert all(one.frame_locked for one in shapes(ros2, "/robots")[0.0])


def test_a_frozen_robot_logs_nothing(ros2: Log) -> None:
    logged = np.array([one for one, _ in ros2["/r2/odom"]]) / 1e9
    assert not ((logged > 4.0) & (logged < 5.9)).any() and (logged > 6.0).any()


def test_who_heard_whom_is_a_line_between_them(ros2: Log, evidence: RunEvidence) -> None:
    links = shapes(ros2, "/links")
    second, (line,) = next((second, found) for second, found in links.items() if found)
    step = round(second / 0.1)
    ends = [(one.x, one.y) for one in line.points]
    assert ends == [tuple(one) for one in evidence.true[step, :, :2].tolist()]
    assert any(second - 1 <= copy.second <= second for copy in evidence.receptions)
