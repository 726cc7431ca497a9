"""Velocity commands to a ROS 2 robot: type of the message, and other nodes that command it."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from actors.instant import Duration, Instant, milliseconds, seconds
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.message_types import TWIST, new, type_hash
from firmware_bridge.ros2.names import NO_HASH, Endpoint, EndpointKind, QosProfile, endpoints_of
from firmware_bridge.ros2.robot_clock import NO_TIME
from firmware_bridge.ros2.session import ReceivedSample, Ros2Session, TopicPublisher
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.safety import HoldCause

_CHECK_INTERVAL: Final = milliseconds(50)
"""Interval of looking at the graph."""
_RIVAL_REST: Final = seconds(1)
"""Stop after the last command of another node; own choice, ten of its commands."""


class CommandType(NamedTuple):
    """Type of velocity commands."""

    kind: str
    type_hash: str


class CommandFault(NamedTuple):
    """Cause for which no type can be chosen."""

    cause: HoldCause
    sentence: str


def choose_type(subscriptions: Sequence[Endpoint], setting: str | None) -> CommandType | CommandFault:
    """Return the type that a robot's subscriptions to velocity commands declare; `setting`: key `command`."""
    if not subscriptions:
        return CommandFault(HoldCause.NO_SUBSCRIBER, "start the robot's base node, or correct topics.command")
    declared = sorted({one.type for one in subscriptions})
    known = [setting] if setting else message_types.COMMAND_TYPES
    wanted = [
        kind for kind in map(message_types.COMMAND_TYPES.__getitem__, known) if setting or kind in declared
    ]
    if len(wanted) != 1 or wanted[0] not in declared:
        fix = 'set command to "Twist" or "TwistStamped" as the base node needs it'
        return CommandFault(HoldCause.COMMAND_TYPE, f"subscriptions declare {' and '.join(declared)}; {fix}")
    (kind,) = wanted
    hashes = {one.type_hash for one in subscriptions if one.type == kind}
    for accepted in (type_hash(kind), "", NO_HASH):
        if accepted in hashes:
            return CommandType(kind, accepted or type_hash(kind))
    return CommandFault(
        HoldCause.COMMAND_TYPE, f"the robot's definition of {kind} has another type hash: {min(hashes)[:80]}"
    )


def encode_velocity(kind: str, v: float, omega: float, stamp: Instant) -> bytes:
    """Return a command, m/s and rad/s; `stamp`: on the robot's clock."""
    linear, angular = (new("geometry_msgs/Vector3", x=x, y=0.0, z=z) for x, z in ((v, 0.0), (0.0, omega)))
    twist = new("geometry_msgs/Twist", linear=linear, angular=angular)
    if kind == TWIST:
        return message_types.encode(twist, kind)
    sec, us = divmod(stamp, 1_000_000)
    time = new("builtin_interfaces/Time", sec=sec & 0x7FFFFFFF, nanosec=us * 1000)
    header = new("std_msgs/Header", stamp=time, frame_id="base_link")
    return message_types.encode(new("geometry_msgs/TwistStamped", header=header, twist=twist), kind)


class CommandPublisher:
    """Publisher of velocity commands, of the type that the robot's subscription declares."""

    def __init__(self, session: Ros2Session, base: Ros2Base) -> None:
        self._session, self._base = session, base
        self._topic = base.topic("command")
        self._type: CommandType | None = None
        self._publisher: TopicPublisher | None = None
        self._checked_at = Instant(-_CHECK_INTERVAL)
        self.refusal: CommandFault | None = None
        """Reason why no type is chosen."""

    @property
    def is_ready(self) -> bool:
        """True if commands reach the router."""
        return self._publisher is not None and self.refusal is None and self._session.is_connected

    def update(self, now: Instant) -> None:
        """Choose the type; call it continuously."""
        if now - self._checked_at < _CHECK_INTERVAL:
            return
        self._checked_at = now
        found = endpoints_of(self._session.endpoints(), self._topic, EndpointKind.SUBSCRIPTION)
        chosen = choose_type(found, self._base.command)
        if isinstance(chosen, CommandFault):
            self.refusal = chosen
            return
        self.refusal = None
        if chosen != self._type:
            self._type = chosen
            self._publisher = self._session.publisher(
                self._topic, chosen.kind, QosProfile(), declared_hash=chosen.type_hash
            )

    def put(self, now: Instant, v: float, omega: float, offset: Duration = NO_TIME) -> None:
        """Publish a velocity, m/s and rad/s; `offset`: our clock minus the robot's."""
        if self._type is not None and self._publisher is not None:
            payload = encode_velocity(self._type.kind, v, omega, Instant(now - offset))
            self._publisher.put(payload, now * 1000)


class RivalDetector:
    """Detector of other nodes that publish velocity commands."""

    def __init__(self, base: Ros2Base, own_nodes: Sequence[str]) -> None:
        """Create it; `own_nodes`: fully qualified names of the base and its guardian."""
        self._own = frozenset(own_nodes)
        self._topic = base.topic("command")
        self._tolerated = frozenset(base.tolerated)
        self._has_names = base.bridge == "rmw_zenoh"
        """False: the tokens of publishers contain no node."""
        self._until = Instant(0)
        self._last = ""

    def find(
        self,
        now: Instant,
        endpoints: Sequence[Endpoint],
        names: dict[bytes, str],
        commands: Sequence[ReceivedSample],
    ) -> str:
        """Return the other node in words; empty: none.

        `names`: nodes by identifier of their publisher; `commands`: received from other sessions.
        """
        publishers = endpoints_of(endpoints, self._topic, EndpointKind.PUBLISHER)
        others = {one.node for one in publishers} - self._own
        for sample in commands:
            gid = b"" if sample.attachment is None else sample.attachment.gid
            if names.get(gid) not in self._own:
                self._until = Instant(now + _RIVAL_REST)
                self._last = names.get(gid) or " or ".join(sorted(others)) or "a node without token"
        if now < self._until:
            return f"{self._last} publishes {self._topic}; stop that node"
        declared = sorted(one for one in others if one.rpartition("/")[2] not in self._tolerated)
        if declared and self._has_names:
            return f"{declared[0]} has a publisher of {self._topic}; stop that node, or add it to `tolerated`"
        return ""
