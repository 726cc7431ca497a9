"""A log in the schemas that Foxglove publishes, as Protocol Buffers in an MCAP file."""

from functools import singledispatchmethod
from typing import Any, Final

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid as GridMessage
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp

from actors.geometry import ORIGIN, Pose
from actors.portable import cos_sin
from observation.robot_logs.contents import (
    MAP,
    Content,
    Disc,
    Grid,
    Label,
    LineList,
    LoggedPlan,
    LoggedScan,
    MarkedScene,
    MarkedShape,
    PlacedMotion,
    PlacedPose,
    PointSet,
    RobotWords,
    Schema,
    Transforms,
    flat,
)

_TYPES: Final[dict[type[Content], Any]] = {
    Transforms: FrameTransforms,
    PlacedPose: PoseInFrame,
    PlacedMotion: Odometry,
    LoggedScan: LaserScan,
    LoggedPlan: PosesInFrame,
    PointSet: PointCloud,
    Grid: GridMessage,
    MarkedScene: SceneUpdate,
    RobotWords: Log,
}


class FoxgloveForm:
    """Messages of Foxglove."""

    profile = ""
    encoding = "protobuf"
    about: Final[dict[str, dict[str, str]]] = {}

    def schema(self, kind: type[Content]) -> Schema:
        """Its definition with all that it is made of, each before what needs it."""
        found = FileDescriptorSet()
        _add(found, _TYPES[kind].DESCRIPTOR.file, set())
        return Schema(
            _TYPES[kind].DESCRIPTOR.full_name, "protobuf", found.SerializeToString(deterministic=True)
        )

    def channel(self, *, latched: bool) -> dict[str, str]:
        """Nothing: Foxglove shows the last message of every topic."""
        return {}

    def encode(self, content: Content, stamp: int) -> bytes:
        """The message, its fields in the order of their numbers."""
        message = self._message(
            content, Timestamp(seconds=stamp // 1_000_000, nanos=stamp % 1_000_000 * 1000)
        )
        return bytes(message.SerializeToString(deterministic=True))

    @singledispatchmethod
    def _message(self, content: Any, stamp: Timestamp) -> Any:
        raise AssertionError(f"{type(content).__name__} is no content")

    @_message.register
    def _(self, content: Transforms, stamp: Timestamp) -> Any:
        return FrameTransforms(
            transforms=[
                FrameTransform(
                    timestamp=stamp, parent_frame_id=one.parent, child_frame_id=one.child,
                    translation=Vector3(x=one.pose.x, y=one.pose.y), rotation=_turned(one.pose.heading),
                )
                for one in content.every
            ]
        )  # fmt: skip

    @_message.register
    def _(self, content: PlacedPose, stamp: Timestamp) -> Any:
        return PoseInFrame(timestamp=stamp, frame_id=content.frame, pose=_pose(content.pose))

    @_message.register
    def _(self, content: PlacedMotion, stamp: Timestamp) -> Any:
        return Odometry(
            timestamp=stamp, frame_id=content.frame, body_frame_id=content.child, pose=_pose(content.pose),
            linear_velocity=Vector3(x=content.vx, y=content.vy), angular_velocity=Vector3(z=content.omega),
        )  # fmt: skip

    @_message.register
    def _(self, content: LoggedScan, stamp: Timestamp) -> Any:
        sensor = content.sensor
        return LaserScan(
            timestamp=stamp, frame_id=content.frame, pose=_pose(ORIGIN), start_angle=sensor.first_angle,
            end_angle=sensor.first_angle + (sensor.rays - 1) * sensor.increment,
            ranges=content.ranges.tolist(),
        )  # fmt: skip

    @_message.register
    def _(self, content: LoggedPlan, stamp: Timestamp) -> Any:
        poses = [_pose(Pose(x, y, 0.0)) for x, y in content.points.tolist()]
        return PosesInFrame(timestamp=stamp, frame_id=MAP, poses=poses)

    @_message.register
    def _(self, content: PointSet, stamp: Timestamp) -> Any:
        fields = [
            PackedElementField(name=name, offset=4 * number, type=PackedElementField.FLOAT32)
            for number, name in enumerate("xyz")
        ]
        return PointCloud(
            timestamp=stamp, frame_id=MAP, pose=_pose(ORIGIN), point_stride=12, fields=fields,
            data=flat(content.points),
        )  # fmt: skip

    @_message.register
    def _(self, content: Grid, stamp: Timestamp) -> Any:
        columns = content.values.shape[1]
        field = PackedElementField(name="occupancy", offset=0, type=PackedElementField.INT8)
        return GridMessage(
            timestamp=stamp, frame_id=MAP, pose=_pose(content.corner), column_count=columns,
            cell_size=Vector2(x=content.cell, y=content.cell), row_stride=columns, cell_stride=1,
            fields=[field], data=content.values.tobytes(),
        )  # fmt: skip

    @_message.register
    def _(self, content: MarkedScene, stamp: Timestamp) -> Any:
        before = SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletion.ALL)
        return SceneUpdate(deletions=[before], entities=[_entity(shape, stamp) for shape in content.shapes])

    @_message.register
    def _(self, content: RobotWords, stamp: Timestamp) -> Any:
        return Log(timestamp=stamp, level=Log.INFO, name=content.robot, message=content.text)


def _add(found: FileDescriptorSet, file: Any, seen: set[str]) -> None:
    for needed in file.dependencies:
        if needed.name not in seen:
            _add(found, needed, seen)
    seen.add(file.name)
    file.CopyToProto(found.file.add())


def _entity(shape: MarkedShape, stamp: Timestamp) -> SceneEntity:
    red, green, blue = (part / 255 for part in shape.colour)
    colour = Color(r=red, g=green, b=blue, a=shape.opacity)
    entity = SceneEntity(
        timestamp=stamp, frame_id=shape.frame, id=shape.name, frame_locked=shape.frame != MAP
    )
    match shape.form:
        case Disc(x, y, radius, height):
            size = Vector3(x=2 * radius, y=2 * radius, z=height)
            pose = _pose(Pose(x, y, 0.0), height / 2)
            disc = CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=colour)
            entity.cylinders.append(disc)
        case LineList(points, width):
            ends = [Point3(x=x, y=y) for x, y in points]
            kind = LinePrimitive.LINE_LIST
            line = LinePrimitive(type=kind, pose=_pose(ORIGIN), thickness=width, points=ends, color=colour)
            entity.lines.append(line)
        case Label(x, y, text, size_m):
            pose = _pose(Pose(x, y, 0.0), 2 * size_m)
            words = TextPrimitive(pose=pose, billboard=True, font_size=size_m, color=colour, text=text)
            entity.texts.append(words)
    return entity


def _pose(pose: Pose, z: float = 0.0) -> PoseMessage:
    return PoseMessage(position=Vector3(x=pose.x, y=pose.y, z=z), orientation=_turned(pose.heading))


def _turned(heading: float) -> Quaternion:
    cosine, sine = cos_sin(heading / 2)
    return Quaternion(z=sine, w=cosine)
