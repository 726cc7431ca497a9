"""A log as ROS 2 bags have it: CDR messages of its own packages, in an MCAP file of the profile `ros2`.

Definitions are those of ROS 2 Humble, which later releases read as well.
"""

from functools import singledispatchmethod
from typing import Any, Final

import numpy as np
from rosbags.typesys import Stores, get_typestore

from actors.geometry import Pose
from actors.portable import cos_sin
from observation.robot_logs.contents import (
    MAP,
    Content,
    Disc,
    Grid,
    Label,
    LineList,
    LoggedCommand,
    LoggedPlan,
    LoggedScan,
    MarkedScene,
    MarkedShape,
    PlacedMotion,
    PlacedPose,
    PointSet,
    RobotWords,
    Schema,
    Transform,
    Transforms,
    flat,
)

_TYPES: Final[dict[type[Content], str]] = {
    Transforms: "tf2_msgs/msg/TFMessage",
    PlacedPose: "geometry_msgs/msg/PoseStamped",
    PlacedMotion: "nav_msgs/msg/Odometry",
    LoggedCommand: "geometry_msgs/msg/Twist",
    LoggedScan: "sensor_msgs/msg/LaserScan",
    LoggedPlan: "nav_msgs/msg/Path",
    PointSet: "sensor_msgs/msg/PointCloud2",
    Grid: "nav_msgs/msg/OccupancyGrid",
    MarkedScene: "visualization_msgs/msg/MarkerArray",
    RobotWords: "rcl_interfaces/msg/Log",
}
_FOR_EVER: Final = "{sec: 9223372036, nsec: 854775807}"
_QOS: Final = (
    "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline: {ever}\n"
    "  lifespan: {ever}\n  liveliness: 1\n  liveliness_lease_duration: {ever}\n"
    "  avoid_ros_namespace_conventions: false\n"
)
"""Keep the last, reliable, automatic, in the numbers of rmw; what rosbag2 takes up to version 8 of a bag."""
_TRANSIENT_LOCAL, _VOLATILE, _DEPTH = 1, 2, 10
_INFO: Final = 20
_FLOAT32: Final = 7
_ALL: Final = 3
"""The action that takes away what a topic has drawn."""


class Ros2Form:
    """Messages of ROS 2."""

    profile = "ros2"
    encoding = "cdr"
    about: Final = {"rosbag2": {"serialized_metadata": ""}}
    """Without it rosbag2 of ROS 2 Jazzy and later reads QoS as words, and refuses numbers."""

    def __init__(self) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._kinds: dict[str, Any] = dict(self._store.types)

    def schema(self, kind: type[Content]) -> Schema:
        """Its definition with all that it is made of."""
        text, _ = self._store.generate_msgdef(_TYPES[kind], ros_version=2)
        return Schema(_TYPES[kind], "ros2msg", text.encode())

    def channel(self, *, latched: bool) -> dict[str, str]:
        """The quality of service at which it is offered."""
        depth, durability = (1, _TRANSIENT_LOCAL) if latched else (_DEPTH, _VOLATILE)
        qos = _QOS.format(depth=depth, durability=durability, ever=_FOR_EVER)
        return {"offered_qos_profiles": qos}

    def encode(self, content: Content, stamp: int) -> bytes:
        """The message in CDR, little-endian."""
        message = self._message(content, stamp)
        return bytes(self._store.serialize_cdr(message, _TYPES[type(content)]))

    def _of(self, kind: str, **fields: Any) -> Any:
        package, name = kind.split("/")
        return self._kinds[f"{package}/msg/{name}"](**fields)

    @singledispatchmethod
    def _message(self, content: Any, stamp: int) -> Any:
        raise AssertionError(f"{type(content).__name__} is no content")

    @_message.register
    def _(self, content: Transforms, stamp: int) -> Any:
        return self._of("tf2_msgs/TFMessage", transforms=[self._transform(t, stamp) for t in content.every])

    @_message.register
    def _(self, content: PlacedPose, stamp: int) -> Any:
        return self._stamped(content.frame, content.pose, stamp)

    @_message.register
    def _(self, content: PlacedMotion, stamp: int) -> Any:
        unknown = np.zeros(36)  # as bases publish it that estimate none
        pose = self._of("geometry_msgs/PoseWithCovariance", pose=self._pose(content.pose), covariance=unknown)
        uncertain = self._of(
            "geometry_msgs/TwistWithCovariance", twist=self._twist(content), covariance=unknown
        )
        return self._of(
            "nav_msgs/Odometry", header=self._header(content.frame, stamp), child_frame_id=content.child,
            pose=pose, twist=uncertain,
        )  # fmt: skip

    @_message.register
    def _(self, content: LoggedCommand, stamp: int) -> Any:
        return self._twist(content)

    @_message.register
    def _(self, content: LoggedScan, stamp: int) -> Any:
        sensor = content.sensor
        return self._of(
            "sensor_msgs/LaserScan", header=self._header(content.frame, stamp), angle_min=sensor.first_angle,
            angle_max=sensor.first_angle + (sensor.rays - 1) * sensor.increment,
            angle_increment=sensor.increment, time_increment=0.0, scan_time=1 / sensor.rate,
            range_min=sensor.range_min, range_max=sensor.range_max, ranges=content.ranges,
            intensities=np.zeros(0, np.float32),
        )  # fmt: skip

    @_message.register
    def _(self, content: LoggedPlan, stamp: int) -> Any:
        poses = [self._stamped(MAP, Pose(x, y, 0.0), stamp) for x, y in content.points.tolist()]
        return self._of("nav_msgs/Path", header=self._header(MAP, stamp), poses=poses)

    @_message.register
    def _(self, content: PointSet, stamp: int) -> Any:
        fields = [
            self._of("sensor_msgs/PointField", name=name, offset=4 * number, datatype=_FLOAT32, count=1)
            for number, name in enumerate("xyz")
        ]
        data = flat(content.points)
        return self._of(
            "sensor_msgs/PointCloud2", header=self._header(MAP, stamp), height=1, width=len(content.points),
            fields=fields, is_bigendian=False, point_step=12, row_step=len(data),
            data=np.frombuffer(data, np.uint8), is_dense=True,
        )  # fmt: skip

    @_message.register
    def _(self, content: Grid, stamp: int) -> Any:
        rows, columns = content.values.shape
        info = self._of(
            "nav_msgs/MapMetaData", map_load_time=self._time(stamp), resolution=content.cell, width=columns,
            height=rows, origin=self._pose(content.corner),
        )  # fmt: skip
        data = content.values.reshape(-1)
        return self._of("nav_msgs/OccupancyGrid", header=self._header(MAP, stamp), info=info, data=data)

    @_message.register
    def _(self, content: MarkedScene, stamp: int) -> Any:
        nothing = MarkedShape("", Label(0.0, 0.0, "", 0.0), (0, 0, 0))
        markers = [self._marker(nothing, 0, stamp, action=_ALL)]
        markers += [self._marker(shape, number, stamp) for number, shape in enumerate(content.shapes)]
        return self._of("visualization_msgs/MarkerArray", markers=markers)

    @_message.register
    def _(self, content: RobotWords, stamp: int) -> Any:
        return self._of(
            "rcl_interfaces/Log", stamp=self._time(stamp), level=_INFO, name=content.robot, msg=content.text,
            file="", function="", line=0,
        )  # fmt: skip

    def _marker(self, shape: MarkedShape, number: int, stamp: int, action: int = 0) -> Any:
        kind, (x, y, z), scale, points = _drawn(shape)
        red, green, blue = (part / 255 for part in shape.colour)
        placed = self._of("geometry_msgs/Pose", position=self._point(x, y, z), orientation=self._turned(0.0))
        return self._of(
            "visualization_msgs/Marker", header=self._header(shape.frame, stamp),
            ns=shape.name.partition("/")[0], id=number, type=kind, action=action, pose=placed,
            scale=self._vector(*scale),
            color=self._of("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=shape.opacity),
            lifetime=self._of("builtin_interfaces/Duration", sec=0, nanosec=0),
            frame_locked=shape.frame != MAP, points=[self._point(*point) for point in points], colors=[],
            texture_resource="", texture=self._no_texture, uv_coordinates=[],
            text=shape.form.text if isinstance(shape.form, Label) else "", mesh_resource="",
            mesh_file=self._of("visualization_msgs/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )  # fmt: skip

    @property
    def _no_texture(self) -> Any:
        header = self._header("", 0)
        nothing = np.zeros(0, np.uint8)
        return self._of("sensor_msgs/CompressedImage", header=header, format="", data=nothing)

    def _transform(self, one: Transform, stamp: int) -> Any:
        placed = self._of(
            "geometry_msgs/Transform", translation=self._vector(one.pose.x, one.pose.y),
            rotation=self._turned(one.pose.heading),
        )  # fmt: skip
        header = self._header(one.parent, stamp)
        return self._of(
            "geometry_msgs/TransformStamped", header=header, child_frame_id=one.child, transform=placed
        )

    def _twist(self, content: PlacedMotion | LoggedCommand) -> Any:
        linear, angular = self._vector(content.vx, content.vy), self._vector(0.0, 0.0, content.omega)
        return self._of("geometry_msgs/Twist", linear=linear, angular=angular)

    def _stamped(self, frame: str, pose: Pose, stamp: int) -> Any:
        return self._of("geometry_msgs/PoseStamped", header=self._header(frame, stamp), pose=self._pose(pose))

    def _pose(self, pose: Pose) -> Any:
        turned = self._turned(pose.heading)
        return self._of("geometry_msgs/Pose", position=self._point(pose.x, pose.y), orientation=turned)

    def _point(self, x: float, y: float, z: float = 0.0) -> Any:
        return self._of("geometry_msgs/Point", x=x, y=y, z=z)

    def _vector(self, x: float, y: float, z: float = 0.0) -> Any:
        return self._of("geometry_msgs/Vector3", x=x, y=y, z=z)

    def _turned(self, heading: float) -> Any:
        cosine, sine = cos_sin(heading / 2)
        return self._of("geometry_msgs/Quaternion", x=0.0, y=0.0, z=sine, w=cosine)

    def _header(self, frame: str, stamp: int) -> Any:
        return self._of("std_msgs/Header", stamp=self._time(stamp), frame_id=frame)

    def _time(self, stamp: int) -> Any:
        seconds, rest = divmod(stamp, 1_000_000)
        return self._of("builtin_interfaces/Time", sec=seconds, nanosec=rest * 1000)


_Spot = tuple[float, float, float]


def _drawn(shape: MarkedShape) -> tuple[int, _Spot, _Spot, list[_Spot]]:
    """A marker's type, position, scale and points."""
    match shape.form:
        case Disc(x, y, radius, height):
            return 3, (x, y, height / 2), (2 * radius, 2 * radius, height), []
        case LineList(points, width):
            return 5, (0.0, 0.0, 0.0), (width, 0.0, 0.0), [(x, y, 0.0) for x, y in points]
        case Label(x, y, _, size):
            return 9, (x, y, 2 * size), (0.0, 0.0, size), []
