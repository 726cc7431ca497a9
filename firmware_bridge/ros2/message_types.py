"""ROS 2 message types: CDR encoding, and type hashes of REP 2016, by rosbags.

Types used here have the same definition, and so the same hash, from Humble to Kilted; a test compares them.
"""

from functools import cache
from typing import Any, Final

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SCAN: Final = "sensor_msgs/msg/LaserScan"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
IMU: Final = "sensor_msgs/msg/Imu"
BATTERY: Final = "sensor_msgs/msg/BatteryState"
TWIST: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
HAZARDS: Final = "irobot_create_msgs/msg/HazardDetectionVector"
DOCK: Final = "irobot_create_msgs/msg/DockStatus"
WHEELS: Final = "irobot_create_msgs/msg/WheelStatus"
_DEFINITIONS: Final = {
    "irobot_create_msgs/msg/HazardDetection": "std_msgs/Header header\nuint8 type",
    HAZARDS: "std_msgs/Header header\nHazardDetection[] detections",
    DOCK: "std_msgs/Header header\nbool dock_visible\nbool is_docked",
    WHEELS: "std_msgs/Header header\nint16 current_ma_left\nint16 current_ma_right\nint16 pwm_left\n"
    "int16 pwm_right\nbool wheels_enabled",
}
"""Fields of iRobot's types, which rosbags does not contain; iRobotEducation/irobot_create_msgs."""
TOPIC_TYPES: Final = {
    "scan": SCAN,
    "odom": ODOMETRY,
    "imu": IMU,
    "battery": BATTERY,
    "hazards": HAZARDS,
    "dock": DOCK,
    "wheels": WHEELS,
}
"""Type of each topic that a base publishes, by field of `RobotTopics`."""
COMMAND_TYPES: Final = {
    "Twist": TWIST,
    "TwistStamped": TWIST_STAMPED,
}
"""Types of velocity commands, by value of `Ros2Base.command`."""
STORE: Final = get_typestore(Stores.ROS2_HUMBLE)
for _kind, _text in _DEFINITIONS.items():
    STORE.register(get_types_from_msg(_text, _kind))
MAX_BYTES: Final = 1 << 20
"""Maximum size of a received message; own choice, far above a scan of 3200 rays."""


class InvalidMessageError(ValueError):
    """Bytes that are not a message of the expected type."""


def new(kind: str, **fields: Any) -> Any:
    """Return a message; `kind`: such as `geometry_msgs/Twist`."""
    package, name = kind.split("/")
    return STORE.types[f"{package}/msg/{name}"](**fields)


@cache
def type_hash(kind: str) -> str:
    """Return the type hash, `RIHS01_` and 64 digits."""
    return STORE.hash_rihs01(kind)


def encode(message: Any, kind: str) -> bytes:
    """Return the CDR bytes with encapsulation, little-endian."""
    return bytes(STORE.serialize_cdr(message, kind))


def decode(data: bytes, kind: str) -> Any:
    """Parse CDR bytes of any length and content. Raises InvalidMessageError."""
    if len(data) > MAX_BYTES:
        raise InvalidMessageError(f"{kind}: {len(data)} bytes, at most {MAX_BYTES} are read")
    try:
        return STORE.deserialize_cdr(data, kind)
    except (SerdeError, IndexError, OverflowError, MemoryError) as error:
        raise InvalidMessageError(f"{kind}: {error}") from None
