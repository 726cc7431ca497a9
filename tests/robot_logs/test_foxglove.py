"""The log in Foxglove's schemas, by the descriptors in the file, beside the one that ROS 2 has."""

import numpy as np
import pytest

from tests.robot_logs.conftest import Log
from tests.robot_logs.test_ros2 import pose


def test_topics_and_instants_are_those_of_the_other_form(foxglove: Log, ros2: Log) -> None:
    assert foxglove.keys() == ros2.keys() - {"/r1/cmd_vel", "/r2/cmd_vel"}
    for topic, messages in foxglove.items():
        assert [logged for logged, _ in messages] == [logged for logged, _ in ros2[topic]]


def test_every_topic_has_its_schema(foxglove: Log) -> None:
    names = {topic: messages[0][1].DESCRIPTOR.full_name for topic, messages in foxglove.items()}
    assert {topic: name for topic, name in names.items() if not topic.startswith("/r2")} == {
        "/tf": "foxglove.FrameTransforms",
        "/tf_static": "foxglove.FrameTransforms",
        "/map": "foxglove.Grid",
        "/places": "foxglove.SceneUpdate",
        "/robots": "foxglove.SceneUpdate",
        "/things": "foxglove.SceneUpdate",
        "/links": "foxglove.SceneUpdate",
        "/rosout": "foxglove.Log",
        "/r1/truth": "foxglove.PoseInFrame",
        "/r1/pose": "foxglove.PoseInFrame",
        "/r1/goal": "foxglove.PoseInFrame",
        "/r1/odom": "foxglove.Odometry",
        "/r1/scan": "foxglove.LaserScan",
        "/r1/plan": "foxglove.PosesInFrame",
        "/r1/local_costmap": "foxglove.Grid",
        "/r1/particles": "foxglove.PointCloud",
    }


@pytest.mark.parametrize("topic", ["/r1/truth", "/r2/truth", "/r1/pose", "/r2/pose", "/r1/goal"])
def test_poses_are_those_of_the_other_form(topic: str, foxglove: Log, ros2: Log) -> None:
    for (logged, one), (_, other) in zip(foxglove[topic], ros2[topic], strict=True):
        assert one.frame_id == "map" and one.timestamp.ToNanoseconds() == logged
        assert pose(one.pose) == pose(other.pose)


def test_frames_are_those_of_the_other_form(foxglove: Log, ros2: Log) -> None:
    for topic in ("/tf", "/tf_static"):
        for (_, one), (_, other) in zip(foxglove[topic], ros2[topic], strict=True):
            for mine, theirs in zip(one.transforms, other.transforms, strict=True):
                parent, child = mine.parent_frame_id, mine.child_frame_id
                assert (parent, child) == (theirs.header.frame_id, theirs.child_frame_id)
                shift, turned = theirs.transform.translation, theirs.transform.rotation
                assert (mine.translation.x, mine.translation.y) == (shift.x, shift.y)
                assert (mine.rotation.z, mine.rotation.w) == (turned.z, turned.w)


def test_scans_and_grids_are_those_of_the_other_form(foxglove: Log, ros2: Log) -> None:
    for (_, one), (_, other) in zip(foxglove["/r2/scan"], ros2["/r2/scan"], strict=True):
        assert list(one.ranges) == list(other.ranges) and one.frame_id == "r2/laser"
        assert one.start_angle == pytest.approx(other.angle_min)
        assert one.end_angle == pytest.approx(other.angle_max)
        assert one.timestamp.ToNanoseconds() == other.header.stamp.sec * 10**9 + other.header.stamp.nanosec
    for topic in ("/map", "/r1/local_costmap"):
        for (_, one), (_, other) in zip(foxglove[topic], ros2[topic], strict=True):
            (field,) = one.fields
            assert (field.name, field.offset, field.type) == ("occupancy", 0, 2)  # INT8
            assert np.frombuffer(one.data, np.int8).tolist() == list(other.data)
            assert (one.column_count, one.row_stride, one.cell_stride) == (other.info.width,) * 2 + (1,)
            assert one.cell_size.x == one.cell_size.y == pytest.approx(other.info.resolution)
            assert pose(one.pose) == pose(other.info.origin)


def test_plans_and_particles_are_those_of_the_other_form(foxglove: Log, ros2: Log) -> None:
    for (_, one), (_, other) in zip(foxglove["/r1/plan"], ros2["/r1/plan"], strict=True):
        assert list(map(pose, one.poses)) == [pose(there.pose) for there in other.poses]
    for (_, one), (_, other) in zip(foxglove["/r1/particles"], ros2["/r1/particles"], strict=True):
        assert one.data == bytes(other.data) and one.point_stride == other.point_step
        assert [(field.name, field.type) for field in one.fields] == [("x", 7), ("y", 7), ("z", 7)]


def test_a_scene_replaces_the_one_before_it(foxglove: Log, ros2: Log) -> None:
    for topic in ("/places", "/robots", "/things", "/links"):
        for (_, one), (_, other) in zip(foxglove[topic], ros2[topic], strict=True):
            assert [deletion.type for deletion in one.deletions] == [1]  # ALL
            assert len(one.entities) == len(other.markers) - 1
            assert len({entity.id for entity in one.entities}) == len(one.entities)
    door = next(one for _, scene in foxglove["/things"] for one in scene.entities if one.lines)
    lines = [one for _, scene in foxglove["/links"] for entity in scene.entities for one in entity.lines]
    assert len(door.lines[0].points) == 2 and {(line.type, len(line.points)) for line in lines} == {(2, 2)}


def test_words_are_those_of_the_other_form(foxglove: Log, ros2: Log) -> None:
    mine = [(one.name, one.message) for _, one in foxglove["/rosout"]]
    assert mine == [(one.name, one.msg) for _, one in ros2["/rosout"]]
    assert ("r1", "planning to r1/0") in mine
