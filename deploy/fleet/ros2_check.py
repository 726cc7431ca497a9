"""Checks of a ROS 2 base: router, graph and topics as observed within a few seconds, and remedies."""

import math
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from actors.instant import Instant, in_seconds
from actors.robot_model import RobotModel
from actors.wording import one_of
from deploy.fleet.doctor import DoctorFinding
from deploy.hosts.address import host_and_port
from firmware_bridge.ros2.message_types import (
    COMMAND_TYPES,
    TOPIC_TYPES,
    InvalidMessageError,
    decode,
    type_hash,
)
from firmware_bridge.ros2.names import (
    NO_HASH,
    Bridge,
    Endpoint,
    EndpointKind,
    QosProfile,
    endpoints_of,
    key_mapping,
    resolve,
    token_gid,
)
from firmware_bridge.ros2.session import ReceivedSample, Ros2Session
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.ros2.velocity_commands import CommandFault, RivalDetector, choose_type

_NODE: Final = "acrc_doctor"
_TIMEOUT_S: Final = 3.0
_ATTEMPTS: Final = 60
_GRAPH_TIMEOUT_S: Final = 10.0
"""Own choice: a router of a busy computer answers later than it connects."""
_START_ROUTER: Final = "start rmw_zenohd or zenoh-bridge-ros2dds on the robot, or correct base.router"
_CHECK_NETWORK: Final = "check the robot's network and processor load"
_LISTENING_S: Final = 3.0
"""Duration of the observation, s; own choice: 15 scans at 5 Hz."""
_QUEUE: Final = QosProfile(reliable=False, depth=1000)
_DRIVERS: Final = {"scan": "the lidar's driver", "odom": "the base's driver"}
"""Node of each topic without which a robot stands."""
_LEAST_RATE: Final = 0.75
"""Least share of the model's rate; own choice, below the spread of rates of real lidars."""
_MAX_CLOCK_OFFSET_S: Final = 0.5
"""Own choice: people compare recordings of several robots."""
_LEAST_CHARGE: Final = 0.2
"""Share of the battery's capacity; own choice."""


class TopicTraffic(NamedTuple):
    """Publications of one topic during the observation."""

    rate: float = 0.0
    """Hz; 0 for less than two messages."""
    newest: Any = None
    """Last message; None: none, or an invalid one."""
    fault: str = ""
    """Fault of an invalid message; empty: all are valid."""
    clock_offset: float = 0.0
    """Stamp less time of arrival of the message with the least delay, s."""


class GraphState(NamedTuple):
    """Connection, graph and traffic behind a router."""

    fault: str
    """Cause of a missing connection or graph, and the remedy; empty: connected."""
    tokens: Sequence[str] = ()
    """Liveliness tokens of all domains and mappings, without those of this check."""
    traffic: Mapping[str, TopicTraffic] = {}
    """By field of `RobotTopics`, with at least one message each."""
    commands: Sequence[ReceivedSample] = ()
    """Velocity commands, of any node."""


def observe(base: Ros2Base) -> GraphState:
    """Connect to the robot's router and listen for `_LISTENING_S`; sends no command."""
    with Ros2Session(base, _NODE, lambda: Instant(time.time_ns() // 1000)) as session:
        queues = {
            name: session.subscribe(base.topic(name), kind, _QUEUE) for name, kind in TOPIC_TYPES.items()
        }
        commands = [
            session.subscribe(base.topic("command"), kind, _QUEUE, hidden=True)
            for kind in COMMAND_TYPES.values()
        ]
        for _ in range(_ATTEMPTS):
            if session.is_connected:
                break
            time.sleep(_TIMEOUT_S / _ATTEMPTS)
        else:
            return GraphState(f"{_port_fault(base.router) or 'no Zenoh router answers'}; {_START_ROUTER}")
        time.sleep(_LISTENING_S)
        try:
            tokens = [token for token in session.tokens(_GRAPH_TIMEOUT_S) if f"/{_NODE}" not in token]
        except TimeoutError:
            return GraphState(f"the graph was not sent within {_GRAPH_TIMEOUT_S:g} s; {_CHECK_NETWORK}")
        if not session.is_connected:  # without a link, the graph is empty
            return GraphState(f"the link was lost; {_CHECK_NETWORK}")
    received = {name: queue.take() for name, queue in queues.items()}
    traffic = {name: traffic_of(some, TOPIC_TYPES[name]) for name, some in received.items() if some}
    return GraphState("", tokens, traffic, [sample for queue in commands for sample in queue.take()])


def _port_fault(router: str) -> str:
    """Return why no TCP connection to the router is possible; empty if one is."""
    try:
        socket.create_connection(host_and_port(router), _TIMEOUT_S).close()
    except OSError as error:
        return (error.strerror or str(error)).lower()
    return ""


def traffic_of(samples: Sequence[ReceivedSample], kind: str) -> TopicTraffic:
    """Return the traffic of a topic from its samples, at least one; arrivals in µs since the Unix epoch."""
    try:
        messages = [decode(sample.payload, kind) for sample in samples]
    except InvalidMessageError as error:
        return TopicTraffic(fault=str(error))
    stamps = [one.header.stamp for one in messages]
    offsets = [
        stamp.sec + stamp.nanosec / 1e9 - in_seconds(sample.arrived)
        for stamp, sample in zip(stamps, samples, strict=True)
    ]
    span = max(1e-6, in_seconds(samples[-1].arrived - samples[0].arrived))
    return TopicTraffic((len(samples) - 1) / span, messages[-1], "", max(offsets))


def findings(base: Ros2Base, model: RobotModel, seen: GraphState) -> Iterator[DoctorFinding]:
    """Return the findings about a robot with this base; nothing is said about what a fault hides."""
    yield _finding("router", seen.fault and f"{base.router}: {seen.fault}", f"{base.router} connects")
    if seen.fault:
        return
    endpoints = _endpoints(base.bridge, base.domain, seen.tokens)
    graph = _graph_fault(base, endpoints, seen.tokens)
    yield _finding("graph", graph, f"{len(endpoints)} publishers and subscriptions")
    if graph:
        return
    periods = {"scan": 1 / model.sensor.rate, "odom": in_seconds(model.kobuki_errors.feedback)}
    for name, kind in TOPIC_TYPES.items():
        topic, traffic = base.topic(name), seen.traffic.get(name, TopicTraffic())
        publishers = endpoints_of(endpoints, topic, EndpointKind.PUBLISHER)
        fault = _type_fault(publishers, kind, name) or traffic.fault
        if not fault and name in _DRIVERS:
            fault = _rate_fault(name, publishers, traffic, _LEAST_RATE / periods[name])
        text = (
            f"{kind}, {traffic.rate:.1f} Hz, {_text(publishers)}" if publishers else "not published; optional"
        )
        yield _finding(name, fault and f"{topic}: {fault}", f"{topic}: {text}")
    yield from _command_findings(base, endpoints, seen)
    yield from _state_findings(seen.traffic)


def _finding(subject: str, fault: str, text: str) -> DoctorFinding:
    return DoctorFinding(subject, not fault, fault or text)


def _endpoints(bridge: Bridge, domain: int, tokens: Sequence[str]) -> list[Endpoint]:
    """Return publishers and subscriptions of a domain."""
    mapping = key_mapping(bridge, domain)
    prefix = mapping.graph.partition("*")[0]
    found = [mapping.parse_token(token) for token in tokens if token.startswith(prefix)]
    return [one for one in found if one is not None and one.topic]


def _graph_fault(base: Ros2Base, endpoints: Sequence[Endpoint], tokens: Sequence[str]) -> str:
    """Return why the robot is not in the graph, and the remedy; empty if it is."""
    published = {one.topic for one in endpoints if one.kind is EndpointKind.PUBLISHER}
    topics = {base.topic(name) for name in _DRIVERS}
    if published & topics:
        return ""
    missing = f"no node publishes {' or '.join(sorted(topics))}"
    names = {getattr(base.topics, name) for name in _DRIVERS}
    spaces = {topic.removesuffix(f"/{name}") for topic in published for name in names}
    if places := [one for one in sorted(spaces) if published >= {resolve(one, name) for name in names}]:
        return f"{missing}, but those in another namespace; set base.namespace = {one_of(places)}"
    if endpoints:
        return f"{missing}; start the robot's drivers, or correct base.topics"
    domains = sorted(
        {token.split("/")[1] for token in tokens if token.startswith("@ros2_lv/") and "/MP/" in token}
    )
    if base.bridge == "rmw_zenoh" and domains:
        return f"no topic in domain {base.domain}; set base.domain = {' or '.join(domains)}"
    other: Bridge = "ros2dds" if base.bridge == "rmw_zenoh" else "rmw_zenoh"
    if domains or _endpoints(other, 0, tokens):
        return f'only topics of {other}; set base.bridge = "{other}"'
    return "no topic of ROS 2; start the robot's nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp, or the bridge"


def _type_fault(endpoints: Sequence[Endpoint], kind: str, name: str) -> str:
    """Return why endpoints of a topic do not have the type `kind`, and the remedy; empty: they do."""
    for one in endpoints:
        if one.type != kind:
            return f"{one.node} has the type {one.type}, not {kind}; correct base.topics.{name}"
        if one.type_hash not in {expected := type_hash(kind), NO_HASH, ""}:
            return (
                f"{one.node} has the type hash {one.type_hash[:15]}… of {kind}, not {expected[:15]}…; "
                "install the distribution's own messages on the robot"
            )
    return ""


def _rate_fault(name: str, publishers: Sequence[Endpoint], traffic: TopicTraffic, least: float) -> str:
    """Return why a required topic does not suffice, and the remedy; empty: it does. `least`: rate, Hz."""
    driver = _DRIVERS[name]
    if not publishers:
        return f"no node publishes it; start {driver}, or correct base.topics.{name}"
    if traffic.newest is None:
        return (
            f"no message within {_LISTENING_S:g} s; restart {driver} (a docked TurtleBot 4 stops its lidar)"
        )
    if len(publishers) > 1:
        return f"published by {_text(publishers)}; give each robot its own namespace"
    if traffic.rate < least:
        return f"{traffic.rate:.1f} Hz, at least {least:.1f} Hz needed; correct its driver, or the network"
    return ""


def _command_findings(
    base: Ros2Base, endpoints: Sequence[Endpoint], seen: GraphState
) -> Iterator[DoctorFinding]:
    """Return the findings about the subscription to velocity commands, and about other publishers of them."""
    topic = base.topic("command")
    subscribers = endpoints_of(endpoints, topic, EndpointKind.SUBSCRIPTION)
    chosen = choose_type(subscribers, base.command)
    if isinstance(chosen, CommandFault):
        yield _finding("command", f"{topic}: {chosen.cause.value}; {chosen.sentence}", "")
    else:
        yield _finding("command", "", f"{topic}: {chosen.kind}, {_text(subscribers)}")
    mapping = key_mapping(base.bridge, base.domain)
    nodes = {token_gid(token): one.node for token in seen.tokens if (one := mapping.parse_token(token))}
    if rival := RivalDetector(base, ()).find(Instant(0), endpoints, nodes, seen.commands):
        yield _finding("other commands", rival, "")


def _state_findings(traffic: Mapping[str, TopicTraffic]) -> Iterator[DoctorFinding]:
    """Return the findings about clock, battery and dock, as far as they are known."""
    for name, one in traffic.items():
        if abs(one.clock_offset) > _MAX_CLOCK_OFFSET_S:
            text = f"stamps of {name} differ by {one.clock_offset:+.1f} s from this computer's clock; "
            yield _finding("robot clock", f"{text}synchronise both clocks (chrony)", "")
    battery, dock = (traffic.get(name, TopicTraffic()).newest for name in ("battery", "dock"))
    if battery is not None and 0 < battery.percentage < math.inf:  # zero: not measured yet
        charge = battery.percentage / (100 if battery.percentage > 1 else 1)
        text = f"{charge:.0%} at {battery.voltage:.1f} V"
        yield _finding("charge", f"{text}; charge it" if charge < _LEAST_CHARGE else "", text)
    if dock is not None:
        fault = "docked, so the robot stands; undock it: button 2, or the action undock"
        yield _finding("dock state", fault if dock.is_docked else "", "not docked")


def _text(endpoints: Sequence[Endpoint]) -> str:
    """Describe the endpoints of a topic; the profile as in a token."""
    return ", ".join(
        f"{one.node} ({one.type_hash[:15] or 'no type hash'}, QoS {one.qos.rstrip(':,')})"
        for one in endpoints
    )
