"""Field lists of ROS 2 messages for the emulated robots, written independently of the product's.

Sources: ros2/common_interfaces, ros2/rcl_interfaces, iRobotEducation/irobot_create_msgs,
ROBOTIS-GIT/turtlebot3_msgs. Comments and constants are left out: they are not part of the type hash.
"""

from pathlib import Path

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
BATTERY = "sensor_msgs/msg/BatteryState"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
HAZARDS = "irobot_create_msgs/msg/HazardDetectionVector"
DOCK = "irobot_create_msgs/msg/DockStatus"
WHEEL_STATUS = "irobot_create_msgs/msg/WheelStatus"
SENSOR_STATE = "turtlebot3_msgs/msg/SensorState"
TF = "tf2_msgs/msg/TFMessage"

HEADER = "std_msgs/Header header"
FIELDS = {
    "builtin_interfaces/msg/Time": ["int32 sec", "uint32 nanosec"],
    "builtin_interfaces/msg/Duration": ["int32 sec", "uint32 nanosec"],
    "rosgraph_msgs/msg/Clock": ["builtin_interfaces/Time clock"],
    "std_msgs/msg/Header": ["builtin_interfaces/Time stamp", "string frame_id"],
    "geometry_msgs/msg/Vector3": ["float64 x", "float64 y", "float64 z"],
    "geometry_msgs/msg/Point": ["float64 x", "float64 y", "float64 z"],
    "geometry_msgs/msg/Quaternion": ["float64 x 0", "float64 y 0", "float64 z 0", "float64 w 1"],
    "geometry_msgs/msg/Pose": ["Point position", "Quaternion orientation"],
    "geometry_msgs/msg/PoseWithCovariance": ["Pose pose", "float64[36] covariance"],
    "geometry_msgs/msg/PoseStamped": [HEADER, "Pose pose"],
    "geometry_msgs/msg/PoseWithCovarianceStamped": [HEADER, "PoseWithCovariance pose"],
    "geometry_msgs/msg/PoseArray": [HEADER, "Pose[] poses"],
    TWIST: ["Vector3 linear", "Vector3 angular"],
    TWIST_STAMPED: [HEADER, "Twist twist"],
    "geometry_msgs/msg/TwistWithCovariance": ["Twist twist", "float64[36] covariance"],
    "geometry_msgs/msg/Transform": ["Vector3 translation", "Quaternion rotation"],
    "geometry_msgs/msg/TransformStamped": [HEADER, "string child_frame_id", "Transform transform"],
    TF: ["geometry_msgs/TransformStamped[] transforms"],
    ODOMETRY: [
        HEADER,
        "string child_frame_id",
        "geometry_msgs/PoseWithCovariance pose",
        "geometry_msgs/TwistWithCovariance twist",
    ],
    SCAN: [
        HEADER,
        *(f"float32 angle_{name}" for name in ("min", "max", "increment")),
        "float32 time_increment",
        "float32 scan_time",
        *(f"float32 range_{name}" for name in ("min", "max")),
        "float32[] ranges",
        "float32[] intensities",
    ],
    IMU: [
        HEADER,
        "geometry_msgs/Quaternion orientation",
        "float64[9] orientation_covariance",
        "geometry_msgs/Vector3 angular_velocity",
        "float64[9] angular_velocity_covariance",
        "geometry_msgs/Vector3 linear_acceleration",
        "float64[9] linear_acceleration_covariance",
    ],
    BATTERY: [
        HEADER,
        *(f"float32 {name}" for name in ("voltage", "temperature", "current", "charge", "capacity")),
        *(f"float32 {name}" for name in ("design_capacity", "percentage")),
        *(f"uint8 power_supply_{name}" for name in ("status", "health", "technology")),
        "bool present",
        *(f"float32[] cell_{name}" for name in ("voltage", "temperature")),
        *(f"string {name}" for name in ("location", "serial_number")),
    ],
    "nav_msgs/msg/Path": [HEADER, "geometry_msgs/PoseStamped[] poses"],
    "nav_msgs/msg/MapMetaData": [
        "builtin_interfaces/Time map_load_time",
        "float32 resolution",
        "uint32 width",
        "uint32 height",
        "geometry_msgs/Pose origin",
    ],
    "nav_msgs/msg/OccupancyGrid": [HEADER, "MapMetaData info", "int8[] data"],
    "sensor_msgs/msg/PointField": ["string name", "uint32 offset", "uint8 datatype", "uint32 count"],
    "sensor_msgs/msg/PointCloud2": [
        HEADER,
        "uint32 height",
        "uint32 width",
        "PointField[] fields",
        "bool is_bigendian",
        "uint32 point_step",
        "uint32 row_step",
        "uint8[] data",
        "bool is_dense",
    ],
    "sensor_msgs/msg/CompressedImage": [HEADER, "string format", "uint8[] data"],
    "std_msgs/msg/ColorRGBA": [f"float32 {name}" for name in "rgba"],
    "visualization_msgs/msg/UVCoordinate": ["float32 u", "float32 v"],
    "visualization_msgs/msg/MeshFile": ["string filename", "uint8[] data"],
    "visualization_msgs/msg/Marker": [
        HEADER,
        "string ns",
        *(f"int32 {name}" for name in ("id", "type", "action")),
        "geometry_msgs/Pose pose",
        "geometry_msgs/Vector3 scale",
        "std_msgs/ColorRGBA color",
        "builtin_interfaces/Duration lifetime",
        "bool frame_locked",
        "geometry_msgs/Point[] points",
        "std_msgs/ColorRGBA[] colors",
        "string texture_resource",
        "sensor_msgs/CompressedImage texture",
        "UVCoordinate[] uv_coordinates",
        "string text",
        "string mesh_resource",
        "MeshFile mesh_file",
        "bool mesh_use_embedded_materials",
    ],
    "visualization_msgs/msg/MarkerArray": ["Marker[] markers"],
    "irobot_create_msgs/msg/HazardDetection": [HEADER, "uint8 type"],
    HAZARDS: [HEADER, "irobot_create_msgs/HazardDetection[] detections"],
    DOCK: [HEADER, "bool dock_visible", "bool is_docked"],
    WHEEL_STATUS: [
        HEADER,
        *(f"int16 {name}_{side}" for name in ("current_ma", "pwm") for side in ("left", "right")),
        "bool wheels_enabled",
    ],
    SENSOR_STATE: [
        HEADER,
        "uint8 bumper",
        *(f"float32 {name}" for name in ("cliff", "sonar", "illumination")),
        "uint8 led",
        "uint8 button",
        "bool torque",
        *(f"int32 {side}_encoder" for side in ("left", "right")),
        "float32 battery",
    ],
}
"""Fields of each type, as lines of a .msg file."""


def parts(kind: str, line: str) -> tuple[str, str, str | None]:
    """Return name, type and array length of a field of `kind`; "" = any length, None = no array.

    The type is a primitive, or a message type such as `std_msgs/msg/Header`.
    """
    declared, name = line.split()[:2]
    base, bracket, length = declared.partition("[")
    if "/" in base or base[0].isupper():
        package, _, short = base.rpartition("/")
        base = f"{package or kind.split('/', maxsplit=1)[0]}/msg/{short}"
    return name, base, length.rstrip("]") if bracket else None


def definition(kind: str) -> str:
    """Return the text of the .msg file of a type."""
    return "\n".join(FIELDS[kind]) + "\n"


def write_definitions(folder: Path) -> None:
    """Write all definitions as `<package>/msg/<Name>.msg`."""
    for kind in FIELDS:
        file = folder / f"{kind}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(definition(kind))
