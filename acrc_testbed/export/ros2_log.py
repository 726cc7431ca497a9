"""ROS 2 topics and messages of a run, and their MCAP file (profile `ros2`, CDR) for rosbag2.

RViz and Foxglove show them from the file, or live. Frames follow REP 105: `map`, and per robot `rN/odom`,
`rN/base_link` and `rN/laser`; `rN/truth` is the true pose of its base. Lengths are in m, angles in rad. Equal
entries give equal bytes.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from actors.array_types import Floats, Singles
from actors.observer.glyphs import Colour
from actors.portable import cos_sin
from actors.robot_model import RangeSensor
from firmware_bridge.ros2.message_types import STORE, encode, new
from firmware_bridge.ros2.names import LATCHED_QOS, QosProfile

Points = Singles
"""(n, 2): x and y, m."""
PlanarPose = Sequence[float] | Floats
"""x, y, m, and heading, rad: a `Pose`, or a row of an array."""
NewMessage = Callable[[Any, int], Any]
"""Returns the message of a value with a stamp, µs."""
MAP: Final = "map"
"""Frame of the floor plan."""
UNKNOWN_CELL: Final = -1
"""Value of an unknown cell of an occupancy grid; 0: free, 100: occupied."""
SHARED_TYPES: Final = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/rosout": "rcl_interfaces/msg/Log",
    "/acrc/items": "visualization_msgs/msg/MarkerArray",
    "/acrc/robots": "visualization_msgs/msg/MarkerArray",
    "/acrc/things": "visualization_msgs/msg/MarkerArray",
    "/acrc/links": "visualization_msgs/msg/MarkerArray",
}
"""Message type of each topic of the run as a whole."""
ROBOT_TYPES: Final = {
    "truth": "geometry_msgs/msg/PoseStamped",
    "amcl_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "destination": "visualization_msgs/msg/MarkerArray",
    "odom": "nav_msgs/msg/Odometry",
    "cmd_vel": "geometry_msgs/msg/Twist",
    "scan": "sensor_msgs/msg/LaserScan",
    "plan": "nav_msgs/msg/Path",
    "particles": "sensor_msgs/msg/PointCloud2",
    "local_costmap/costmap": "nav_msgs/msg/OccupancyGrid",
}
"""Message type of each topic of a robot, by `robot_topic`."""
CLOCK: Final = "/clock"
_GLOBAL_TYPES: Final = SHARED_TYPES | {CLOCK: "rosgraph_msgs/msg/Clock"}
_LATCHED: Final = frozenset({"tf_static", "map", "items", "robots", "things", "destination"})
"""Last parts of topics with durability transient local."""
_INFINITE: Final = "{sec: 9223372036, nsec: 854775807}"
_QOS: Final = (
    "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline: {ever}\n"
    "  lifespan: {ever}\n  liveliness: 1\n  liveliness_lease_duration: {ever}\n"
    "  avoid_ros_namespace_conventions: false\n"
)
"""Keep last, reliable, automatic liveliness, as numbers of rmw; rosbag2 reads them up to bag version 8."""
_TRANSIENT_LOCAL, _VOLATILE = 1, 2
_INFO: Final = 20
_FLOAT32: Final = 7
_PLANAR: Final = (0, 1, 5)
"""Rows of x, y and rotation about z in a covariance of ROS 2."""
_ADD, _DELETE_ALL = 0, 3
_CYLINDER, _LINE_LIST, _TEXT = 3, 5, 9
_LATEST: Final = 2**31 * 1_000_000
"""End of the range of a ROS 2 time, µs."""
_CHUNK: Final = 4 << 20
"""Size of a chunk of the file, bytes; readers keep one in memory."""

_Vector = tuple[float, float, float]


class LogEntry(NamedTuple):
    """One message of the log."""

    logged: int
    """Log time, µs of the run."""
    topic: str
    """Topic such as `/map` or `/acrc/r1/scan`."""
    message: Any
    """A ROS 2 message."""
    stamp: int
    """Stamp of the header, µs."""

    def encode(self) -> bytes:
        """Return the CDR bytes of the message."""
        return encode(self.message, topic_type(self.topic))


def ascending_instants(seconds: Sequence[float] | Floats) -> list[int]:
    """Return instants of the run in µs, in ascending order."""
    found: list[float] = (np.maximum.accumulate(np.asarray(seconds, np.float64)) * 1e6).tolist()
    return [round(one) for one in found]


def log_entries(
    topic: str, seconds: Sequence[float] | Floats, values: Iterable[Any], message: NewMessage
) -> Iterator[LogEntry]:
    """Yield the message of each value at its time, s; stamps ascend."""
    for at, value in zip(ascending_instants(seconds), values, strict=True):
        yield LogEntry(at, topic, message(value, at), at)


def clock_entries(seconds: Floats) -> Iterator[LogEntry]:
    """Yield the starts of steps as Clock messages."""
    return log_entries(CLOCK, seconds, seconds, lambda _, at: new("rosgraph_msgs/Clock", clock=_time(at)))


def robot_topic(robot: str, name: str) -> str:
    """Return a topic of ROBOT_TYPES. The namespace differs from those of physical robots' own topics.

    Thus neither the base of a robot nor this program's driver subscribes to it, even on the robot's router.
    """
    return f"/acrc/{robot}/{name}"


def topic_type(topic: str) -> str:
    """Return the message type of a topic."""
    return _GLOBAL_TYPES.get(topic) or ROBOT_TYPES[topic.split("/", 3)[3]]


def topic_qos(topic: str) -> QosProfile:
    """Return the quality of service of a topic's publisher."""
    return LATCHED_QOS if topic.rpartition("/")[2] in _LATCHED else QosProfile()


class Transform(NamedTuple):
    """Pose of a frame in its parent frame."""

    parent: str
    child: str
    pose: PlanarPose


class Marker(NamedTuple):
    """A shape to draw."""

    name: str
    """Unique within its topic; the part before the first `/` is its namespace."""
    kind: int
    position: _Vector
    scale: _Vector
    colour: Colour
    opacity: float = 1.0
    frame: str = MAP
    points: Sequence[Sequence[float]] = ()
    text: str = ""


def disc(name: str, at: tuple[float, float], radius: float, height: float, colour: Colour) -> Marker:
    """Return an upright cylinder that stands on the floor."""
    return Marker(name, _CYLINDER, (*at, height / 2), (2 * radius, 2 * radius, height), colour)


def lines(name: str, points: Sequence[Sequence[float]], width: float, colour: Colour) -> Marker:
    """Return straight lines, each between two consecutive points."""
    return Marker(name, _LINE_LIST, (0.0, 0.0, 0.0), (width, 0.0, 0.0), colour, points=points)


def label(name: str, text: str, size: float, colour: Colour) -> Marker:
    """Return a text above the origin of its frame."""
    return Marker(name, _TEXT, (0.0, 0.0, 2 * size), (0.0, 0.0, size), colour, text=text)


def transforms(frames: Iterable[Transform], stamp: int) -> Any:
    """Return a TFMessage."""
    return new("tf2_msgs/TFMessage", transforms=[_transform(one, stamp) for one in frames])


def placed_pose(pose: PlanarPose, stamp: int) -> Any:
    """Return a PoseStamped."""
    return new("geometry_msgs/PoseStamped", header=_header(MAP, stamp), pose=_pose(pose))


def uncertain_pose(estimate: tuple[PlanarPose, Sequence[float]], stamp: int) -> Any:
    """Return a PoseWithCovarianceStamped of a pose and its covariance: (3, 3), row by row."""
    pose, covariance = estimate
    full = np.zeros((6, 6))
    full[np.ix_(_PLANAR, _PLANAR)] = np.reshape(covariance, (3, 3))
    placed = new("geometry_msgs/PoseWithCovariance", pose=_pose(pose), covariance=full.reshape(-1))
    return new("geometry_msgs/PoseWithCovarianceStamped", header=_header(MAP, stamp), pose=placed)


def odometry(frame: str, child: str, pose: PlanarPose, velocity: Sequence[float], stamp: int) -> Any:
    """Return an Odometry; `velocity`: as for `twist`, in the child's frame. Covariances are 0 (unknown).

    The odometry's errors since switch-on have no bound; the filter models those of a single motion.
    """
    unknown = np.zeros(36)
    placed = new("geometry_msgs/PoseWithCovariance", pose=_pose(pose), covariance=unknown)
    moving = new("geometry_msgs/TwistWithCovariance", twist=twist(velocity), covariance=unknown)
    header = _header(frame, stamp)
    return new("nav_msgs/Odometry", header=header, child_frame_id=child, pose=placed, twist=moving)


def twist(velocity: Sequence[float] | Floats) -> Any:
    """Return a Twist of (x, y, turn rate), m/s and rad/s."""
    vx, vy, omega = map(float, velocity)
    return new("geometry_msgs/Twist", linear=_vector(vx, vy), angular=_vector(0.0, 0.0, omega))


def laser_scan(frame: str, sensor: RangeSensor, ranges: Singles, stamp: int) -> Any:
    """Return a LaserScan of (rays,) ranges, m, counter-clockwise; inf: no echo within range (REP 117)."""
    return new(
        "sensor_msgs/LaserScan", header=_header(frame, stamp), angle_min=sensor.first_angle,
        angle_max=sensor.first_angle + (sensor.rays - 1) * sensor.increment,
        angle_increment=sensor.increment, time_increment=0.0, scan_time=1 / sensor.rate,
        range_min=sensor.range_min, range_max=sensor.range_max, ranges=ranges,
        intensities=np.zeros(0, np.float32),
    )  # fmt: skip


def path(points: Points, stamp: int) -> Any:
    """Return a Path in the map frame; it is empty when the plan was dropped."""
    poses = [placed_pose((x, y, 0.0), stamp) for x, y in points]
    return new("nav_msgs/Path", header=_header(MAP, stamp), poses=poses)


def point_cloud(points: Points, stamp: int) -> Any:
    """Return a PointCloud2 in the map frame with z = 0."""
    fields = [
        new("sensor_msgs/PointField", name=name, offset=4 * number, datatype=_FLOAT32, count=1)
        for number, name in enumerate("xyz")
    ]
    data = np.pad(points.astype("<f4"), ((0, 0), (0, 1))).tobytes()
    return new(
        "sensor_msgs/PointCloud2", header=_header(MAP, stamp), height=1, width=len(points), fields=fields,
        is_bigendian=False, point_step=12, row_step=len(data), data=np.frombuffer(data, np.uint8),
        is_dense=True,
    )  # fmt: skip


def occupancy_grid(corner: PlanarPose, cell: float, values: NDArray[np.int8], stamp: int) -> Any:
    """Return an OccupancyGrid of (rows, columns) cells of edge `cell`, m, with the first one at `corner`."""
    rows, columns = values.shape
    info = new(
        "nav_msgs/MapMetaData", map_load_time=_time(stamp), resolution=cell, width=columns, height=rows,
        origin=_pose(corner),
    )  # fmt: skip
    return new("nav_msgs/OccupancyGrid", header=_header(MAP, stamp), info=info, data=values.reshape(-1))


def marker_array(markers: Sequence[Marker], stamp: int) -> Any:
    """Return a MarkerArray that replaces all markers of its topic."""
    drawn = [_marker(label("", "", 0.0, (0, 0, 0)), 0, stamp, _DELETE_ALL)]
    drawn += [_marker(one, number, stamp, _ADD) for number, one in enumerate(markers)]
    return new("visualization_msgs/MarkerArray", markers=drawn)


def log_line(robot: str, text: str, stamp: int) -> Any:
    """Return a Log message of level INFO."""
    return new(
        "rcl_interfaces/Log", stamp=_time(stamp), level=_INFO, name=robot, msg=text, file="", function="",
        line=0,
    )  # fmt: skip


def write(file: Path, entries: Iterable[LogEntry], left_out: Counter[str]) -> Counter[str]:
    """Write or replace a file, and return the number of messages by topic. Raises OSError.

    `left_out` counts entries whose instant exceeds a ROS 2 time, by topic.
    """
    counts = Counter[str]()
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.NONE, enable_data_crcs=True)
        writer.start(profile="ros2", library="acrc")
        # Without it, rosbag2 of ROS 2 Jazzy and later expects QoS as words and rejects numbers.
        writer.add_metadata("rosbag2", {"serialized_metadata": ""})
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for one in entries:
            if not (0 <= one.logged < _LATEST and 0 <= one.stamp < _LATEST):
                left_out[one.topic] += 1
                continue
            if one.topic not in channels:
                channels[one.topic] = _channel(writer, one.topic, schemas)
            sequence = counts[one.topic]
            writer.add_message(
                channels[one.topic], one.logged * 1000, one.encode(), one.stamp * 1000, sequence
            )
            counts[one.topic] += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _channel(writer: Writer, topic: str, schemas: dict[str, int]) -> int:
    kind, qos = topic_type(topic), topic_qos(topic)
    if kind not in schemas:
        text, _ = STORE.generate_msgdef(kind, ros_version=2)
        schemas[kind] = writer.register_schema(kind, "ros2msg", text.encode())
    durability = _TRANSIENT_LOCAL if qos.transient_local else _VOLATILE
    profile = _QOS.format(depth=qos.depth, durability=durability, ever=_INFINITE)
    return int(writer.register_channel(topic, "cdr", schemas[kind], {"offered_qos_profiles": profile}))


def _marker(one: Marker, number: int, stamp: int, action: int) -> Any:
    red, green, blue = (part / 255 for part in one.colour)
    nothing = np.zeros(0, np.uint8)
    return new(
        "visualization_msgs/Marker", header=_header(one.frame, stamp), ns=one.name.partition("/")[0],
        id=number, type=one.kind, action=action,
        pose=new("geometry_msgs/Pose", position=_point(*one.position), orientation=_rotation(0.0)),
        scale=_vector(*one.scale), color=new("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=one.opacity),
        lifetime=new("builtin_interfaces/Duration", sec=0, nanosec=0), frame_locked=one.frame != MAP,
        points=[_point(x, y) for x, y in one.points], colors=[], texture_resource="",
        texture=new("sensor_msgs/CompressedImage", header=_header("", 0), format="", data=nothing),
        uv_coordinates=[], text=one.text, mesh_resource="",
        mesh_file=new("visualization_msgs/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )  # fmt: skip


def _transform(one: Transform, stamp: int) -> Any:
    x, y, heading = map(float, one.pose)
    placed = new("geometry_msgs/Transform", translation=_vector(x, y), rotation=_rotation(heading))
    header = _header(one.parent, stamp)
    return new("geometry_msgs/TransformStamped", header=header, child_frame_id=one.child, transform=placed)


def _pose(pose: PlanarPose) -> Any:
    x, y, heading = map(float, pose)
    return new("geometry_msgs/Pose", position=_point(x, y), orientation=_rotation(heading))


def _point(x: float, y: float, z: float = 0.0) -> Any:
    return new("geometry_msgs/Point", x=x, y=y, z=z)


def _vector(x: float, y: float, z: float = 0.0) -> Any:
    return new("geometry_msgs/Vector3", x=x, y=y, z=z)


def _rotation(heading: float) -> Any:
    cosine, sine = cos_sin(heading / 2)
    return new("geometry_msgs/Quaternion", x=0.0, y=0.0, z=sine, w=cosine)


def _header(frame: str, stamp: int) -> Any:
    return new("std_msgs/Header", stamp=_time(stamp), frame_id=frame)


def _time(stamp: int) -> Any:
    seconds, rest = divmod(stamp, 1_000_000)
    return new("builtin_interfaces/Time", sec=seconds, nanosec=rest * 1000)
