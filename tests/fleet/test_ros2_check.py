"""Checks of a ROS 2 base by `acrc fleet doctor`: each broken set-up is one sentence with its remedy."""

import math
import time
from collections.abc import Sequence
from threading import Event, Thread
from typing import Any, NamedTuple

import numpy as np
import pytest

from actors.instant import Instant, seconds
from actors.robot_model import load_model
from deploy.fleet import doctor, ros2_check
from deploy.fleet.doctor import DoctorFinding
from deploy.fleet.ros2_check import GraphState, TopicTraffic, traffic_of
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.message_types import COMMAND_TYPES, TOPIC_TYPES, type_hash
from firmware_bridge.ros2.names import (
    NO_HASH,
    Attachment,
    Endpoint,
    EndpointKind,
    NodeIdentity,
    QosProfile,
    RmwZenohMapping,
    token_gid,
)
from firmware_bridge.ros2.session import ReceivedSample, Ros2Session
from firmware_bridge.ros2.settings import Ros2Base
from tests.fleet.fleet_texts import fleet, robot
from tests.helpers import free_port
from tests.ros2.routers import start_router
from tests.ros2.test_session import wait_for

MODEL = load_model("turtlebot4", "rplidar")
R1 = Ros2Base(kind="ros2", router="tcp/10.0.0.1:7447", namespace="/r1")
PUB, SUB = EndpointKind.PUBLISHER, EndpointKind.SUBSCRIPTION
TWIST, STAMPED = COMMAND_TYPES.values()
SENSOR = QosProfile(reliable=False, depth=5).encode()


def header(stamp: float) -> Any:
    time_of = message_types.new("builtin_interfaces/Time", sec=int(stamp), nanosec=int(stamp % 1 * 1e9))
    return message_types.new("std_msgs/Header", stamp=time_of, frame_id="laser")


def message(name: str, stamp: float, **fields: Any) -> Any:
    """Return a message of the topic `name` with zeros in all other fields."""
    vector = message_types.new("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
    default: dict[str, Any] = {"header": header(stamp)}
    if name == "scan":
        lengths = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min")
        default |= {**dict.fromkeys((*lengths, "range_max"), 1.0), "intensities": np.zeros(0, np.float32)}
        default["ranges"] = np.ones(640, np.float32)
    elif name == "odom":
        point = message_types.new("geometry_msgs/Point", x=0.0, y=0.0, z=0.0)
        turn = message_types.new("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = message_types.new("geometry_msgs/Pose", position=point, orientation=turn)
        twist = message_types.new("geometry_msgs/Twist", linear=vector, angular=vector)
        zeros = np.zeros(36)
        default["pose"] = message_types.new("geometry_msgs/PoseWithCovariance", pose=pose, covariance=zeros)
        default["twist"] = message_types.new(
            "geometry_msgs/TwistWithCovariance", twist=twist, covariance=zeros
        )
        default["child_frame_id"] = "base_link"
    package, _, kind = TOPIC_TYPES[name].split("/")
    return message_types.new(f"{package}/{kind}", **default | fields)


class Robot(NamedTuple):
    """A simulated robot: its tokens and the traffic of its topics."""

    tokens: Sequence[str]
    traffic: dict[str, TopicTraffic]

    def findings(self, base: Ros2Base = R1) -> list[DoctorFinding]:
        return list(ros2_check.findings(base, MODEL, GraphState("", self.tokens, self.traffic)))

    def without(self, *words: str) -> "Robot":
        """Return the robot without the tokens that contain one of the words."""
        kept = [token for token in self.tokens if not any(word in token for word in words)]
        return self._replace(tokens=kept)

    def replaced(self, old: str, new: str) -> "Robot":
        return self._replace(tokens=[token.replace(old, new) for token in self.tokens])

    def hears(self, **traffic: TopicTraffic) -> "Robot":
        return self._replace(traffic=self.traffic | traffic)


def token(kind: EndpointKind, topic: str, message_type: str, node: str = "driver", space: str = "/r1") -> str:
    end = Endpoint(kind, "", "", f"{space}/{topic}", message_type, type_hash(message_type), SENSOR)
    return RmwZenohMapping.endpoint_token(NodeIdentity("ab12", 0, space, node), 3, end)


def dds_token(kind: EndpointKind, topic: str, message_type: str, data: str = "") -> str:
    return f"@/ab12/@ros2_lv/{kind.value}/r1§{topic}/{message_type.replace('/', '§')}/:1:0:0,10{data}"


def with_hash(kind: EndpointKind, topic: str, message_type: str) -> str:
    """Return a token of a bridge since Iron."""
    return dds_token(kind, topic, message_type, f":typehash={type_hash(message_type)};")


def healthy(make: Any = token) -> Robot:
    tokens = [make(PUB, name, TOPIC_TYPES[name]) for name in ("scan", "odom")]
    heard = {name: TopicTraffic(rate, message(name, 100.0)) for name, rate in (("scan", 7.9), ("odom", 20.0))}
    return Robot([*tokens, make(SUB, "cmd_vel", STAMPED)], heard)


ROBOT = healthy()


def battery(percentage: float) -> TopicTraffic:
    fields = ("temperature", "current", "charge", "capacity", "design_capacity")
    state = message_types.new(
        "sensor_msgs/BatteryState",
        header=header(1.0),
        voltage=14.4,
        percentage=percentage,
        **dict.fromkeys(fields, math.nan),
        **dict.fromkeys(("power_supply_status", "power_supply_health", "power_supply_technology"), 0),
        present=True,
        cell_voltage=np.zeros(0, np.float32),
        cell_temperature=np.zeros(0, np.float32),
        location="",
        serial_number="",
    )
    return TopicTraffic(0.5, state)


def test_a_healthy_robot_is_described() -> None:
    scan = type_hash(TOPIC_TYPES["scan"])[:15]
    found = ROBOT.hears(battery=battery(0.8)).findings()
    assert all(one.ok for one in found)
    texts = {one.subject: one.text for one in found}
    assert list(texts) == [
        *(
            "router",
            "graph",
            "scan",
            "odom",
            "imu",
            "battery",
            "hazards",
            "dock",
            "wheels",
            "command",
            "charge",
        ),
    ]
    assert texts["scan"] == f"/r1/scan: sensor_msgs/msg/LaserScan, 7.9 Hz, /r1/driver ({scan}, QoS 2::,5)"
    assert texts["imu"] == "/r1/imu: not published; optional"
    assert texts["charge"] == "80% at 14.4 V"
    assert texts["command"].startswith("/r1/cmd_vel: geometry_msgs/msg/TwistStamped, /r1/driver (RIHS01_")


@pytest.mark.parametrize(
    "robot", [ROBOT.replaced(type_hash(TOPIC_TYPES["scan"]), NO_HASH), healthy(dds_token), healthy(with_hash)]
)
def test_robots_without_type_hashes_pass(robot: Robot) -> None:
    is_dds = robot.tokens[0].startswith("@/")
    base = Ros2Base(kind="ros2", namespace="/r1", bridge="ros2dds" if is_dds else "rmw_zenoh")
    assert all(one.ok for one in robot.findings(base))


def with_base(**changes: Any) -> Ros2Base:
    return Ros2Base(**{"kind": "ros2", "namespace": "/r1", **changes})


OTHER_HASH = ROBOT.replaced(type_hash(TOPIC_TYPES["scan"]), "RIHS01_" + "0" * 64)
IMAGE = token(PUB, "scan", TOPIC_TYPES["imu"])
SECOND = Robot([*ROBOT.tokens, token(PUB, "cmd_vel", STAMPED, "velocity_smoother")], ROBOT.traffic)
BOTH = Robot([*ROBOT.tokens, token(SUB, "cmd_vel", TWIST, "mux")], ROBOT.traffic)
TWICE = Robot([*ROBOT.tokens, token(PUB, "scan", TOPIC_TYPES["scan"], "merger")], ROBOT.traffic)
OTHERS = Robot(
    [
        token(PUB, name, TOPIC_TYPES[name], "lidar", space)
        for name in ("scan", "odom")
        for space in ("/r2", "/r3")
    ],
    {},
)
DOCKED = message_types.new(
    "irobot_create_msgs/DockStatus", header=header(1.0), dock_visible=True, is_docked=True
)


@pytest.mark.parametrize(
    ("robot", "base", "subject", "sentence"),
    [
        (
            ROBOT,
            with_base(domain=7),
            "graph",
            "no topic in domain 7; set base.domain = 0",
        ),
        (
            ROBOT,
            with_base(namespace=""),
            "graph",
            'no node publishes /odom or /scan, but those in another namespace; set base.namespace = "/r1"',
        ),
        (OTHERS, R1, "graph", 'another namespace; set base.namespace = "/r2" or "/r3"'),
        (
            ROBOT,
            with_base(bridge="ros2dds"),
            "graph",
            'only topics of rmw_zenoh; set base.bridge = "rmw_zenoh"',
        ),
        (healthy(dds_token), R1, "graph", 'only topics of ros2dds; set base.bridge = "ros2dds"'),
        (Robot([], {}), R1, "graph", "no topic of ROS 2; start the robot's nodes with RMW_IMPLEMENTATION="),
        (
            ROBOT.without("scan", "odom"),
            R1,
            "graph",
            "no node publishes /r1/odom or /r1/scan; start the robot's drivers, or correct base.topics",
        ),
        (
            OTHER_HASH,
            R1,
            "scan",
            "/r1/scan: /r1/driver has the type hash RIHS01_00000000… of sensor_msgs/msg/LaserScan, not "
            "RIHS01_64c19139…; install the distribution's own messages on the robot",
        ),
        (
            healthy(with_hash).replaced("RIHS01_6", "RIHS01_7"),
            with_base(bridge="ros2dds"),
            "scan",
            "/r1/scan: ab12 has the type hash RIHS01_74c19139… of sensor_msgs/msg/LaserScan, not",
        ),
        (
            ROBOT.without("scan")._replace(tokens=[IMAGE, *ROBOT.tokens[1:]]),
            R1,
            "scan",
            "/r1/scan: /r1/driver has the type sensor_msgs/msg/Imu, not sensor_msgs/msg/LaserScan; correct "
            "base.topics.scan",
        ),
        (
            ROBOT.without("scan"),
            R1,
            "scan",
            "/r1/scan: no node publishes it; start the lidar's driver, or correct base.topics.scan",
        ),
        (
            ROBOT.hears(scan=TopicTraffic()),
            R1,
            "scan",
            "/r1/scan: no message within 3 s; restart the lidar's driver (a docked TurtleBot 4 stops its "
            "lidar)",
        ),
        (
            ROBOT.hears(scan=TopicTraffic(2.04, message("scan", 1.0))),
            R1,
            "scan",
            "/r1/scan: 2.0 Hz, at least 6.0 Hz needed; correct its driver, or the network",
        ),
        (
            ROBOT.hears(odom=TopicTraffic(9.9, message("odom", 1.0))),
            R1,
            "odom",
            "/r1/odom: 9.9 Hz, at least 15.0 Hz needed; correct its driver, or the network",
        ),
        (
            TWICE,
            R1,
            "scan",
            "/r1/scan: published by /r1/driver (RIHS01_64c19139, QoS 2::,5), /r1/merger (RIHS01_64c19139, "
            "QoS 2::,5); give each robot its own namespace",
        ),
        (
            ROBOT.without("cmd_vel"),
            R1,
            "command",
            "/r1/cmd_vel: robot does not subscribe to velocity commands; start the robot's base node, or "
            "correct topics.command",
        ),
        (
            ROBOT,
            with_base(command="Twist"),
            "command",
            "/r1/cmd_vel: type of velocity commands is unclear or unknown; subscriptions declare "
            'geometry_msgs/msg/TwistStamped; set command to "Twist" or "TwistStamped" as the base node needs '
            "it",
        ),
        (
            BOTH,
            R1,
            "command",
            "/r1/cmd_vel: type of velocity commands is unclear or unknown; subscriptions declare "
            'geometry_msgs/msg/Twist and geometry_msgs/msg/TwistStamped; set command to "Twist" or '
            '"TwistStamped"',
        ),
        (
            SECOND,
            R1,
            "other commands",
            "/r1/velocity_smoother has a publisher of /r1/cmd_vel; stop that node, or add it to `tolerated`",
        ),
        (
            ROBOT.hears(scan=ROBOT.traffic["scan"]._replace(clock_offset=-3600.2)),
            R1,
            "robot clock",
            "stamps of scan differ by -3600.2 s from this computer's clock; synchronise both clocks (chrony)",
        ),
        (
            ROBOT.hears(dock=TopicTraffic(1.0, DOCKED)),
            R1,
            "dock state",
            "docked, so the robot stands; undock it: button 2, or the action undock",
        ),
        (ROBOT.hears(battery=battery(0.1)), R1, "charge", "10% at 14.4 V; charge it"),
        (ROBOT.hears(battery=battery(15.0)), R1, "charge", "15% at 14.4 V; charge it"),
        (ROBOT.hears(imu=TopicTraffic(fault="3 bytes")), R1, "imu", "/r1/imu: 3 bytes"),
    ],
)
def test_each_broken_set_up_is_one_sentence_with_its_remedy(
    robot: Robot, base: Ros2Base, subject: str, sentence: str
) -> None:
    failed = [one for one in robot.findings(base) if not one.ok]
    assert [one.subject for one in failed] == [subject]
    assert sentence in failed[0].text


def test_commands_of_both_types_are_clear_with_the_key() -> None:
    assert all(one.ok for one in ROBOT.findings(with_base(command="TwistStamped")))


@pytest.mark.parametrize("battery_share", [math.nan, math.inf, 0.0])
def test_an_unknown_charge_is_no_finding(battery_share: float) -> None:
    found = ROBOT.hears(battery=battery(battery_share)).findings()
    assert all(one.ok for one in found)


def test_a_tolerated_joystick_is_named_once_it_commands() -> None:
    joystick = token(PUB, "cmd_vel", STAMPED, "teleop_twist_joy_node")
    tokens = [*ROBOT.tokens, joystick]
    assert all(one.ok for one in ROBOT._replace(tokens=tokens).findings())
    command = ReceivedSample(Instant(5), b"", "", Attachment(1, 0, token_gid(joystick)))
    seen = GraphState("", tokens, ROBOT.traffic, [command])
    (failed,) = (one for one in ros2_check.findings(R1, MODEL, seen) if not one.ok)
    assert failed.text == "/r1/teleop_twist_joy_node publishes /r1/cmd_vel; stop that node"


def test_invalid_tokens_are_ignored() -> None:
    damaged = [text[:length] for text in ROBOT.tokens for length in range(0, len(text) - 20, 7)]
    assert (
        Robot([*damaged, "@ros2_lv/", "@/", "", *ROBOT.tokens], ROBOT.traffic).findings() == ROBOT.findings()
    )


def samples(*arrivals: float, stamp: float = 0.0) -> list[ReceivedSample]:
    return [
        ReceivedSample(
            Instant(seconds(at)),
            message_types.encode(message("scan", at + stamp), TOPIC_TYPES["scan"]),
            "",
            None,
        )
        for at in arrivals
    ]


def test_rate_clock_and_validity_come_from_the_samples() -> None:
    traffic = traffic_of(samples(100.0, 100.1, 100.3, 100.4, stamp=-2.0), TOPIC_TYPES["scan"])
    assert (round(traffic.rate, 3), round(traffic.clock_offset, 3)) == (7.5, -2.0)
    assert len(traffic.newest.ranges) == 640
    one = traffic_of(samples(100.0), TOPIC_TYPES["scan"])
    assert one.rate == 0.0 and one.newest is not None
    late = samples(100.0) + samples(105.0, stamp=-4.0)
    assert traffic_of(late, TOPIC_TYPES["scan"]).clock_offset == 0.0, "delays are no offset"
    invalid = [one._replace(payload=one.payload[:20]) for one in samples(100.0, 100.1)]
    assert traffic_of(invalid, TOPIC_TYPES["scan"]).fault.startswith("sensor_msgs/msg/LaserScan: ")


def test_the_router_is_reached_and_listened_to_without_a_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2_check, "_LISTENING_S", 0.6)
    router = f"tcp/127.0.0.1:{free_port()}"
    one = fleet(robot(1, f'base = {{ kind = "ros2", router = "{router}" }}\nmodel = "turtlebot4"')).robots[0]

    def base_findings() -> list[DoctorFinding]:
        found = {finding.subject: finding for finding in doctor.check_devices(one)}
        assert "base" not in found and not found.pop("radio").ok
        return list(found.values())

    with monkeypatch.context() as patch:
        patch.setattr(ros2_check, "_TIMEOUT_S", 0.2)
        (closed,) = base_findings()
    assert closed.text == (
        f"{router}: connection refused; start rmw_zenohd or zenoh-bridge-ros2dds on the robot, or correct "
        "base.router"
    )
    assert isinstance(one.base, Ros2Base)
    monkeypatch.setattr(ros2_check, "_TIMEOUT_S", 30.0)
    with (
        start_router(int(router.rpartition(":")[2])),
        Ros2Session(one.base, "driver", lambda: Instant(0)) as driver,
        Ros2Session(one.base, "other", lambda: Instant(0)) as other,
    ):
        assert [found.text[:16] for found in base_findings()] == [f"{router[:16]}", "no topic of ROS "]
        publisher = driver.publisher("/scan", TOPIC_TYPES["scan"])
        driver.subscribe("/cmd_vel", TWIST)
        wait_for(lambda: len(other.endpoints()) == 2)
        ended = Event()

        def publish() -> None:
            while not ended.wait(0.01):  # a pause of the computer must not make the rate too low
                payload = message_types.encode(message("scan", time.time()), TOPIC_TYPES["scan"])
                publisher.put(payload, 0)

        thread = Thread(target=publish, daemon=True)
        thread.start()
        found = {finding.subject: finding for finding in base_findings()}
        ended.set()
        thread.join()
    assert found.keys() >= {"scan", "odom", "command"}, found
    assert found["scan"].ok, found["scan"].text
    assert not found["odom"].ok and found["command"].text.startswith(
        "/cmd_vel: geometry_msgs/msg/Twist, /driver (RIHS01_"
    )
    assert "robot clock" not in found


def test_a_lost_router_is_no_empty_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    base = Ros2Base(kind="ros2", router=f"tcp/127.0.0.1:{port}", namespace="/r1")
    router: Any = start_router(port)
    monkeypatch.setattr(Ros2Session, "tokens", late_tokens)
    monkeypatch.setattr(ros2_check, "_LISTENING_S", 0.0)
    (late,) = ros2_check.findings(base, MODEL, ros2_check.observe(base))

    def lost_tokens(session: Ros2Session, timeout_s: float) -> list[str]:
        router.close()
        wait_for(lambda: not session.is_connected)
        return []

    monkeypatch.setattr(Ros2Session, "tokens", lost_tokens)
    (lost,) = ros2_check.findings(base, MODEL, ros2_check.observe(base))
    remedy = "check the robot's network and processor load"
    assert late.text == f"{base.router}: the graph was not sent within 10 s; {remedy}"
    assert lost.text == f"{base.router}: the link was lost; {remedy}"


def late_tokens(session: Ros2Session, timeout_s: float) -> list[str]:
    raise TimeoutError
