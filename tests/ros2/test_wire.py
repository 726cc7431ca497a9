"""Bytes, type hashes, keys, tokens and attachments against independent implementations.

`sdk`: zenoh-ros2-sdk; its CDR is that of rosbags; type hashes, keys, tokens and attachments are its own.
`idl`: pycdr2, with a CDR of its own. The literal hashes and tokens were printed by ROS 2 itself.
"""

from typing import Any

import numpy as np
import pytest
from zenoh_ros2_sdk import discovery
from zenoh_ros2_sdk.attachment import Attachment as SdkAttachment
from zenoh_ros2_sdk.entity import EndpointEntity, EntityKind, NodeEntity
from zenoh_ros2_sdk.keyexpr import endpoint_liveliness_keyexpr, node_liveliness_keyexpr, topic_keyexpr
from zenoh_ros2_sdk.qos import QosDurability, QosReliability
from zenoh_ros2_sdk.qos import QosProfile as SdkProfile

from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.names import (
    LATCHED_QOS,
    SENSOR_QOS,
    Attachment,
    Endpoint,
    EndpointKind,
    NodeIdentity,
    QosProfile,
    RmwZenohMapping,
    dds_type,
    token_gid,
)
from tests.ros2 import definitions
from tests.ros2.definitions import FIELDS, parts
from tests.ros2.idl import idl_fields, idl_message, idl_type
from tests.ros2.sdk import message, sdk_store, sdk_type_hash

KINDS = [kind for kind in FIELDS if kind in message_types.STORE.types]
"""Types that the product knows; a robot's other topics are not read."""
PRINTED = {
    definitions.TWIST: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    definitions.SCAN: "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    definitions.ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "geometry_msgs/msg/Pose": "RIHS01_d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa",
    "geometry_msgs/msg/Transform": "RIHS01_beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc",
}
"""Published type hashes: output of `ros2 topic info -v`, and code that its output was copied into."""
LOG_TOKEN = (
    "@ros2_lv/0/999bf91283606d2068c7524e5badfa6c/0/1/MP/%/%robot1/talker/%rosout/rcl_interfaces::msg::dds_::Log_/"
    "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac/:1:,1000:,:10,0:,,"
)
"""Token printed by rmw_zenoh_cpp; issue 643 of ros2/rmw_zenoh."""


def test_what_a_base_reads_and_writes_is_compared() -> None:
    names = ("SCAN", "ODOMETRY", "IMU", "BATTERY", "TWIST", "TWIST_STAMPED", "HAZARDS", "DOCK", "TF")
    assert {getattr(definitions, name) for name in names} <= set(KINDS)


def _value(base: str, draws: np.random.Generator) -> Any:
    if base == "string":
        return "".join(draws.choice(list("ab/ü"), int(draws.integers(0, 6))))
    if base == "bool":
        return bool(draws.integers(2))
    if base.startswith("float"):
        return float(np.float32(draws.normal()))
    limits = np.iinfo(base)
    return int(draws.integers(limits.min, limits.max, endpoint=True))


def _sample(kind: str, draws: np.random.Generator) -> dict[str, Any]:
    """Return random fields: strings and lists of any length up to 5, so that every alignment occurs."""
    found: dict[str, Any] = {}
    for line in FIELDS[kind]:
        name, base, length = parts(kind, line)
        count = 1 if length is None else int(length) if length else int(draws.integers(0, 6))
        values = [_sample(base, draws) if "/" in base else _value(base, draws) for _ in range(count)]
        found[name] = values[0] if length is None else values
        if length is not None and "/" not in base:
            found[name] = np.array(values, base)
    return found


def _plain(value: Any) -> Any:
    """Return nested lists and dictionaries without numpy arrays."""
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, (list, np.ndarray)):
        return [_plain(one) for one in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return value


def _fields(kind: str, decoded: Any) -> dict[str, Any]:
    return idl_fields(kind, decoded)


@pytest.mark.parametrize("kind", KINDS)
def test_three_implementations_write_and_read_the_same_bytes(kind: str) -> None:
    draws, store = np.random.default_rng(5), sdk_store()
    for _ in range(20):
        fields = _sample(kind, draws)
        ours = message_types.encode(message(message_types.STORE, kind, fields), kind)
        idl = idl_message(kind, fields).serialize()
        assert ours == idl
        assert ours == bytes(store.serialize_cdr(message(store, kind, fields), kind))
        expected = _plain(fields)
        assert _plain(_fields(kind, message_types.decode(idl, kind))) == expected
        assert _plain(idl_fields(kind, idl_type(kind).deserialize(ours))) == expected
        assert _plain(_fields(kind, store.deserialize_cdr(ours, kind))) == expected


def test_type_hashes_are_those_of_the_sdk_and_of_ros() -> None:
    ours = {kind: message_types.type_hash(kind) for kind in KINDS}
    assert ours == {kind: sdk_type_hash(kind) for kind in KINDS}
    assert {kind: ours[kind] for kind in PRINTED} == PRINTED


def test_attachments_are_read_by_the_sdk_and_the_sdks_by_us() -> None:
    gid = token_gid(LOG_TOKEN)
    ours = Attachment(7, 1_795_799_916_663_422_688, gid)
    read = SdkAttachment.from_bytes(ours.encode())
    assert Attachment(read.sequence_id, read.timestamp_ns, read.gid) == ours
    assert read.to_bytes() == ours.encode()
    assert Attachment.decode(SdkAttachment(1, 2, bytes(range(16))).to_bytes()) == (1, 2, bytes(range(16)))


@pytest.mark.parametrize("namespace", ["", "/r1", "/lab/r1"])
@pytest.mark.parametrize("qos", [QosProfile(), SENSOR_QOS, LATCHED_QOS])
def test_tokens_and_keys_are_read_by_the_sdk_and_the_sdks_by_us(namespace: str, qos: QosProfile) -> None:
    domain, kind, topic = 5, definitions.SCAN, f"{namespace}/scan"
    found, names = message_types.type_hash(kind), RmwZenohMapping(domain)
    node = NodeIdentity("abc123", domain, namespace, "base")
    endpoint = Endpoint(EndpointKind.SUBSCRIPTION, "", "", topic, kind, found, qos.encode())
    read = discovery._parse_liveliness_keyexpr(names.endpoint_token(node, 4, endpoint))
    assert read is not None
    assert (read["domain_id"], read["session_id"], read["entity_id"], read["kind"]) == (5, "abc123", 4, "MS")
    assert (read["namespace"], read["node_name"], read["qualified_name"]) == (namespace or "/", "base", topic)
    assert (read["dds_type"], read["type_hash"]) == (dds_type(kind), found)
    assert discovery.dds_to_ros_type(read["dds_type"]) == kind
    profile = SdkProfile.decode(read["qos"])
    reliability = QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT
    durability = QosDurability.TRANSIENT_LOCAL if qos.transient_local else QosDurability.VOLATILE
    assert (profile.reliability, profile.durability, profile.history_depth) == (
        reliability,
        durability,
        qos.depth,
    )
    assert profile.encode() == qos.encode()
    assert topic_keyexpr(domain, topic, dds_type(kind), found) == names.data_key(topic, kind, found)

    entity = NodeEntity(domain, "abc123", 0, "base", namespace or "/")
    token = endpoint_liveliness_keyexpr(
        EndpointEntity(entity, 4, EntityKind.SUBSCRIPTION, topic, dds_type(kind), found, profile.encode())
    )
    assert token == names.endpoint_token(node, 4, endpoint)
    assert names.parse_token(token) == endpoint._replace(session="abc123", node=f"{namespace}/base")
    assert node_liveliness_keyexpr(entity) == names.node_token(node)
    parsed = names.parse_token(node_liveliness_keyexpr(entity))
    assert parsed == Endpoint(EndpointKind.NODE, "abc123", f"{namespace}/base")


def test_a_token_of_rmw_zenoh_is_read_as_the_sdk_reads_it() -> None:
    ours, read = RmwZenohMapping(0).parse_token(LOG_TOKEN), discovery._parse_liveliness_keyexpr(LOG_TOKEN)
    assert ours is not None and read is not None
    assert (ours.kind.value, ours.topic, ours.node) == ("MP", "/rosout", "/robot1/talker")
    assert (read["kind"], read["qualified_name"], f"{read['namespace']}/{read['node_name']}") == (
        "MP",
        "/rosout",
        "/robot1/talker",
    )
    assert (ours.type, ours.type_hash, ours.qos) == (
        discovery.dds_to_ros_type(read["dds_type"]),
        read["type_hash"],
        read["qos"],
    )
    profile, theirs = QosProfile.decode(ours.qos), SdkProfile.decode(read["qos"])
    assert (profile.transient_local, profile.depth) == (True, theirs.history_depth) == (True, 1000)
