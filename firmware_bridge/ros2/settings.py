"""Settings of a ROS 2 robot's base, and of a connection to a Zenoh router; without heavy imports."""

import re
from typing import Annotated, Literal

from msgspec import Meta

from actors.settings import Settings
from firmware_bridge.ros2.names import Bridge, resolve

_Topic = Annotated[
    str,
    Meta(
        pattern=r"\A/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z",
        description='the name of a topic, such as "scan" or "/r1/scan"',
    ),
]


class RouterLink(Settings, frozen=True, kw_only=True):
    """A Zenoh router of ROS 2, and the names behind it."""

    router: Annotated[
        str,
        Meta(
            pattern=r"\Atcp/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9][A-Za-z0-9.-]*):0*"
            r"([1-9][0-9]{0,3}|[1-5][0-9]{4}|6[0-4][0-9]{3}|65[0-4][0-9]{2}|655[0-2][0-9]|6553[0-5])\Z",
            description='an endpoint such as "tcp/192.168.1.21:7447"',
        ),
    ] = "tcp/127.0.0.1:7447"
    """Endpoint of the router. Default: rmw_zenohd on the same computer."""
    domain: Annotated[int, Meta(ge=0, le=232)] = 0
    """ROS_DOMAIN_ID of the robot; not used by ros2dds."""
    namespace: Annotated[
        str,
        Meta(
            pattern=r"\A((/[A-Za-z_][A-Za-z0-9_]*)+)?\Z",
            description='empty, or a namespace with a leading slash, such as "/r1"',
        ),
    ] = ""
    """Namespace of the robot's topics."""
    bridge: Bridge = "rmw_zenoh"
    """`rmw_zenoh`: the robot's nodes use rmw_zenoh_cpp; `ros2dds`: DDS and zenoh-bridge-ros2dds."""

    @property
    def is_local(self) -> bool:
        """True if the router is on the same computer."""
        return re.match(r"tcp/(localhost|127\.|\[::1\])", self.router) is not None


class RobotTopics(Settings, frozen=True, kw_only=True):
    """[topics]: names of a robot's topics, relative to its namespace unless they begin with a slash.

    Defaults: those of TurtleBot 3 and 4. All but scan, odom and cmd_vel are optional on the robot.
    """

    scan: _Topic = "scan"
    odom: _Topic = "odom"
    imu: _Topic = "imu"
    battery: _Topic = "battery_state"
    hazards: _Topic = "hazard_detection"
    dock: _Topic = "dock_status"
    wheels: _Topic = "wheel_status"
    command: _Topic = "cmd_vel"


class Ros2Base(RouterLink, frozen=True, kw_only=True):
    """[robot.base] with kind = "ros2": a base that is reached by ROS 2 topics."""

    kind: Literal["ros2"]
    topics: RobotTopics = RobotTopics()
    command: Literal["Twist", "TwistStamped"] | None = None
    """Type of velocity commands; None: as declared by the robot's subscription to them."""
    tolerated: tuple[str, ...] = ("teleop_twist_joy_node",)
    """Nodes that may have a publisher of velocity commands while they are silent. Default: the joystick's
    node of a TurtleBot 4, which its bringup always starts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.bridge == "ros2dds":
            self.check_unused(("domain",), 'bridge = "ros2dds"')

    def topic(self, name: str) -> str:
        """Return the fully qualified name of a field of `topics`."""
        return resolve(self.namespace, getattr(self.topics, name))
