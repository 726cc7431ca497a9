"""Key expressions, liveliness tokens and attachments of ROS 2 over Zenoh.

Two mappings exist. `rmw_zenoh`: the robot's nodes use the middleware rmw_zenoh_cpp; keys contain domain, type
and type hash. `ros2dds`: the nodes use DDS, and zenoh-bridge-ros2dds connects them; keys are topic names.
Sources: ros2/rmw_zenoh, docs/design.md and liveliness_utils.cpp; ZettaScaleLabs/ros-z, attachment.rs;
eclipse-zenoh/zenoh-plugin-ros2dds, liveliness_mgt.rs.
"""

import hashlib
import re
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterable
from enum import Enum
from typing import Final, Literal, NamedTuple

Bridge = Literal["rmw_zenoh", "ros2dds"]
NO_HASH: Final = "TypeHashNotSupported"
"""Type hash in the keys of ROS 2 Humble, whose type support has none."""
_TYPE: Final = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_DDS_TYPE: Final = re.compile(r"([a-z][a-z0-9_]*)::msg::dds_::([A-Z][A-Za-z0-9]*)_")
_MAX_TOKEN: Final = 1024
"""Maximum length of a token, characters; own choice, four times that of long names."""
_DEFAULT_DEPTH: Final = 42
"""Depth of history that a token omits; rmw_zenoh, QoS::default_qos."""
_RELIABLE, _BEST_EFFORT, _TRANSIENT_LOCAL = "1", "2", "1"


class EndpointKind(Enum):
    """Kind of an entity in the ROS graph."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


class QosProfile(NamedTuple):
    """Quality of service of an endpoint, keep last; deadlines and leases are unlimited."""

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10

    def encode(self) -> str:
        """Return the profile as in a token of rmw_zenoh."""
        reliability = "" if self.reliable else _BEST_EFFORT
        durability = _TRANSIENT_LOCAL if self.transient_local else ""
        return f"{reliability}:{durability}:,{self.depth}:,:,:,,"

    @staticmethod
    def decode(text: str) -> "QosProfile":
        """Parse reliability, durability and depth of a profile; other fields are ignored.

        Raises ValueError.
        """
        reliability, durability, history, *_ = text.split(":")
        _, _, depth = history.partition(",")
        return QosProfile(
            reliability in {"", _RELIABLE, "0"}, durability == _TRANSIENT_LOCAL, int(depth or _DEFAULT_DEPTH)
        )


SENSOR_QOS: Final = QosProfile(reliable=False, depth=5)
LATCHED_QOS: Final = QosProfile(transient_local=True, depth=1)


class Endpoint(NamedTuple):
    """A publisher, subscription, service or client of the ROS graph, or a node without topic."""

    kind: EndpointKind
    session: str
    """Identifier of the Zenoh session."""
    node: str
    """Fully qualified name such as `/r1/turtlebot4_node`; of a bridge its session."""
    topic: str = ""
    """Fully qualified name such as `/r1/scan`."""
    type: str = ""
    """Such as `sensor_msgs/msg/LaserScan`."""
    type_hash: str = ""
    """Empty: not told."""
    qos: str = ""


class Attachment(NamedTuple):
    """Metadata of a publication; rmw_zenoh drops samples without it."""

    sequence: int
    """1, 2, … per publisher."""
    stamp_ns: int
    """Time of the publication, ns since the Unix epoch."""
    gid: bytes
    """Identifier of the publisher, 16 bytes."""

    def encode(self) -> bytes:
        """Return the 33 bytes."""
        return _ATTACHMENT.pack(self.sequence, self.stamp_ns, len(self.gid), self.gid)

    @staticmethod
    def decode(data: bytes) -> "Attachment | None":
        """Parse the bytes; None if they are invalid."""
        if len(data) != _ATTACHMENT.size:
            return None
        sequence, stamp_ns, length, gid = _ATTACHMENT.unpack(data)
        return Attachment(sequence, stamp_ns, gid) if length == len(gid) else None


_ATTACHMENT: Final = struct.Struct("<qqB16s")


def token_gid(token: str) -> bytes:
    """Return an identifier of the endpoint with this token, 16 bytes.

    rmw_zenoh uses XXH3; subscribers only compare identifiers, so any hash serves.
    """
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def resolve(namespace: str, topic: str) -> str:
    """Return the fully qualified name of a topic; names with a leading slash are global."""
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"


class NodeIdentity(NamedTuple):
    """A node of this process."""

    session: str
    domain: int
    namespace: str
    """Empty, or with a leading slash."""
    name: str


class KeyMapping(ABC):
    """Mapping of ROS topics and graph to Zenoh keys."""

    graph: str
    """Key expression of all tokens of publishers and subscriptions."""
    has_attachments: bool

    @abstractmethod
    def data_key(self, topic: str, kind: str, type_hash: str) -> str:
        """Return the key of publications; `topic`: fully qualified, `kind`: message type."""

    @abstractmethod
    def parse_key(self, key: str) -> str:
        """Return the type hash in the key of a publication; empty: none."""

    @abstractmethod
    def parse_token(self, token: str) -> Endpoint | None:
        """Parse a liveliness token; None if it is invalid or of another kind."""


class RmwZenohMapping(KeyMapping):
    """Mapping of rmw_zenoh_cpp."""

    has_attachments = True

    def __init__(self, domain: int) -> None:
        self._domain = domain
        self.graph = f"@ros2_lv/{domain}/**"

    def data_key(self, topic: str, kind: str, type_hash: str) -> str:
        """Return `<domain>/<topic>/<type>/<hash>`."""
        return f"{self._domain}/{topic.strip('/')}/{dds_type(kind)}/{type_hash}"

    def parse_key(self, key: str) -> str:
        """Return the last part of the key."""
        return key.rpartition("/")[2]

    def parse_token(self, token: str) -> Endpoint | None:
        """Parse `@ros2_lv/<domain>/<session>/<node id>/<id>/<kind>/<enclave>/<namespace>/<node>[/…]`."""
        parts = token.split("/")
        if len(token) > _MAX_TOKEN or len(parts) not in {9, 13}:
            return None
        _, _, session, _, _, kind, _, namespace, name, *topic = parts
        try:
            endpoint = Endpoint(EndpointKind(kind), session, resolve(_unmangled(namespace), name))
            if not topic:
                return endpoint
            match = _DDS_TYPE.fullmatch(topic[1])
            found = topic[1] if match is None else f"{match[1]}/msg/{match[2]}"
            return endpoint._replace(topic=_unmangled(topic[0]), type=found, type_hash=topic[2], qos=topic[3])
        except ValueError:
            return None

    @staticmethod
    def node_token(node: NodeIdentity) -> str:
        """Return the token of a node, whose number is 0."""
        return f"@ros2_lv/{node.domain}/{node.session}/0/0/NN/{_node_part(node)}"

    @staticmethod
    def endpoint_token(node: NodeIdentity, number: int, endpoint: Endpoint) -> str:
        """Return the token of a publisher or subscription; `number`: unique within the session."""
        tail = f"{_mangled(endpoint.topic)}/{dds_type(endpoint.type)}/{endpoint.type_hash}/{endpoint.qos}"
        kind = endpoint.kind.value
        return f"@ros2_lv/{node.domain}/{node.session}/0/{number}/{kind}/{_node_part(node)}/{tail}"


class Ros2DdsMapping(KeyMapping):
    """Mapping of zenoh-bridge-ros2dds; only its own entities have tokens."""

    graph = "@/*/@ros2_lv/**"
    has_attachments = False
    _SLASH: Final = "§"

    def data_key(self, topic: str, kind: str, type_hash: str) -> str:
        """Return the topic without its first slash."""
        return topic.strip("/")

    def parse_key(self, key: str) -> str:
        """Return no hash."""
        return ""

    def parse_token(self, token: str) -> Endpoint | None:
        """Parse `@/<bridge>/@ros2_lv/<kind>/<topic>/<type>/<qos>`; since Iron the last has the type hash."""
        parts = token.split("/")
        if len(token) > _MAX_TOKEN or len(parts) != 7:
            return None
        _, session, _, kind, topic, name, qos = parts
        try:
            found = EndpointKind(kind)
        except ValueError:
            return None
        profile, _, data = qos.partition(":typehash=")
        return Endpoint(
            found,
            session,
            session,
            f"/{topic.replace(self._SLASH, '/')}",
            name.replace(self._SLASH, "/"),
            data.partition(";")[0],
            profile,
        )


ALL_GRAPHS: Final = ("@ros2_lv/**", Ros2DdsMapping.graph)
"""Key expressions of the tokens of every domain and mapping."""


def key_mapping(bridge: Bridge, domain: int) -> KeyMapping:
    """Return the mapping of a kind of bridge."""
    return RmwZenohMapping(domain) if bridge == "rmw_zenoh" else Ros2DdsMapping()


def endpoints_of(endpoints: Iterable[Endpoint], topic: str, kind: EndpointKind) -> list[Endpoint]:
    """Return the endpoints of one kind at a topic."""
    return [one for one in endpoints if (one.topic, one.kind) == (topic, kind)]


def dds_type(kind: str) -> str:
    """Return the DDS name of a message type. Raises ValueError."""
    match = _TYPE.fullmatch(kind)
    if match is None:
        raise ValueError(f"{kind!r} is not a message type such as sensor_msgs/msg/LaserScan")
    return f"{match[1]}::msg::dds_::{match[2]}_"


def _node_part(node: NodeIdentity) -> str:
    return f"%/{_mangled(node.namespace)}/{node.name}"


def _mangled(name: str) -> str:
    """Return a name as one part of a key; an empty one is `%`."""
    return name.replace("/", "%") or "%"


def _unmangled(part: str) -> str:
    return "" if part == "%" else part.replace("%", "/")
