"""The product's vehicle on an emulated TurtleBot in memory: no Zenoh, no clock, no processes."""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from actors.instant import Duration, Instant, in_seconds, milliseconds, seconds
from actors.robot_model import load_model
from actors.world.physics import SUBSTEP
from firmware_bridge.onboard.ros2_robot import Ros2Robot, Take
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.driver import RobotDriver
from firmware_bridge.ros2.names import SENSOR_QOS, Attachment, Endpoint, EndpointKind, QosProfile, token_gid
from firmware_bridge.ros2.robot_link import RobotLink
from firmware_bridge.ros2.scan_reader import LaserScanReader
from firmware_bridge.ros2.session import ReceivedSample, Ros2Session, Subscription
from firmware_bridge.ros2.settings import Ros2Base
from tests.onboard.sensor_rig import PassiveGuardian
from tests.ros2.emulation import robots_world
from tests.ros2.sdk import message
from tests.ros2.turtlebots import EmulatedTurtlebot, Publication, TurtlebotWorld

START: Final = Instant(1_700_000_000_000_000)
"""Our clock at the start."""
CLOCK: Final = 7.5
"""Offset of the robot's clock, s."""
LATENCY: Final = milliseconds(3)
RIVAL: Final = Endpoint(EndpointKind.PUBLISHER, "z", "/r1/teleop", "/r1/cmd_vel", message_types.TWIST_STAMPED)


class CommandRecorder:
    """Publisher of velocity commands to the emulated robot."""

    gid = token_gid("base")

    def __init__(self, rig: "RobotRig", kind: str) -> None:
        self._rig, self._kind = rig, kind

    def put(self, payload: bytes, stamp_ns: int) -> None:
        assert stamp_ns == self._rig.now * 1000
        if self._rig.session.is_connected:
            command = message_types.decode(payload, self._kind)
            twist = command.twist if self._kind == message_types.TWIST_STAMPED else command
            self._rig.commands.append((self._rig.now, twist.linear.x, twist.angular.z))
            self._rig.robot.take_command(twist.linear.x, twist.angular.z, self._rig.world.now)


class MemorySession(Ros2Session):
    """A session without Zenoh."""

    def __init__(self, rig: "RobotRig") -> None:
        self._rig = rig
        self.fault = ""
        self.connected = True
        self.graph = [
            Endpoint(
                EndpointKind.SUBSCRIPTION,
                "y",
                "/r1/robot",
                "/r1/cmd_vel",
                message_types.TWIST_STAMPED,
                message_types.type_hash(message_types.TWIST_STAMPED),
            )
        ]
        self.subscriptions: dict[tuple[str, str], Subscription] = {}

    @property
    def is_connected(self) -> bool:
        return self.connected

    def acknowledge(self) -> None: ...

    def close(self) -> None: ...

    def endpoints(self) -> tuple[Endpoint, ...]:
        return tuple(self.graph)

    def publisher_names(self, topic: str) -> dict[bytes, str]:
        return {
            token_gid(one.node): one.node
            for one in self.graph
            if one.topic == topic and one.kind is EndpointKind.PUBLISHER
        }

    def subscribe(
        self, topic: str, kind: str, qos: QosProfile = SENSOR_QOS, *, hidden: bool = False
    ) -> Subscription:
        return self.subscriptions.setdefault((topic, kind), Subscription(qos.depth))

    def publisher(self, topic: str, kind: str, *qos: object, **more: object) -> Any:
        return CommandRecorder(self._rig, kind)


class StandstillFigures(NamedTuple):
    """Time, s, and distance, m, from a fault to the command to stand and to standstill; inf: not reached."""

    told_s: float = math.inf
    told_m: float = math.inf
    stood_s: float = math.inf
    stood_m: float = math.inf


class RobotRig:
    """One robot and its vehicle, advanced by sub-steps of the physics."""

    def __init__(self, model: str = "turtlebot4", seed: int = 1, **settings: Any) -> None:
        self.world = TurtlebotWorld(robots_world([model], seed=seed), START * 1000)
        self.robot: EmulatedTurtlebot = self.world.robots["r1"]
        self.robot.faults.clock = CLOCK
        self.session = MemorySession(self)
        self.guardian = PassiveGuardian()
        self.log: list[str] = []
        self.commands: list[tuple[Instant, float, float]] = []
        self.target = (0.0, 0.0)
        """Velocity commanded by the robot program."""
        self.corrupt: Callable[[Publication, bytes], bytes] = lambda publication, payload: payload
        self.latency = LATENCY
        self._sent = 0
        self._waiting: list[tuple[Instant, str, str, ReceivedSample]] = []
        base = Ros2Base(kind="ros2", namespace="/r1", **settings)

        def connect(driver: RobotDriver, reader: LaserScanReader, take: Take) -> RobotLink:
            self.driver, self.reader = driver, reader
            return RobotLink(self.session, base, driver, reader, take, lambda: self.now, self.log.append)

        self.vehicle = Ros2Robot(connect, load_model(model), START, self.guardian, self.log.append)

    @property
    def now(self) -> Instant:
        return Instant(START + self.world.now)

    @property
    def causes(self) -> set[str]:
        return {stop.cause.name for stop in self.driver.allowed.stops}

    def run(self, time_s: float, until: Callable[[], bool] = lambda: False) -> None:
        """Advance for this time, or until the condition holds after a sub-step."""
        end = self.now + seconds(time_s)
        while self.now < end:
            for publication in self.world.advance(Instant(self.world.now + SUBSTEP)):
                self._send(publication)
            self._deliver()
            if self.now % 100_000 == 0:
                self.vehicle.scan()
                self.vehicle.command(self.now, self.now, *self.target)
            self.vehicle.serve(self.now)
            self.vehicle.check_odometry()
            if until():
                return

    def drive(self, v: float = 0.3, omega: float = 0.0) -> None:
        """Drive until the velocity is reached."""
        self.target = (v, omega)
        moving = min(abs(v), self.driver.limits.speed) * 0.95
        self.run(8.0, lambda: abs(self.world.speed("r1")) >= moving and not self.causes)
        assert not self.causes, self.causes
        self.run(1.0)

    def stops(self, inject: Callable[["RobotRig"], object], patience_s: float = 3.0) -> StandstillFigures:
        """Inject a fault and return how the robot stops."""
        began, way = self.now, self.robot.travelled
        inject(self)
        told: list[float] = []
        stood: list[float] = []

        def is_over() -> bool:
            here = [in_seconds(Duration(self.now - began)), self.robot.travelled - way]
            if not told and self.robot.commanded_to_stand:
                told.extend(here)
            if told and not stood and self.world.speed("r1") < 1e-3:
                stood.extend(here)
            return bool(stood)

        self.run(patience_s, is_over)
        inf = [math.inf, math.inf]
        return StandstillFigures(*(told or inf), *(stood or inf))

    def command_of_another(self, v: float) -> None:
        """Publish a velocity by another node."""
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        stamp = {"sec": 0, "nanosec": 0}
        twist = {"linear": {**zero, "x": v}, "angular": zero}
        fields = {"header": {"stamp": stamp, "frame_id": ""}, "twist": twist}
        self._send(Publication("r1", "cmd_vel", fields), message_types.TWIST_STAMPED, token_gid(RIVAL.node))

    def _send(self, publication: Publication, kind: str = "", gid: bytes = bytes(16)) -> None:
        if not self.session.is_connected:
            return
        kind = kind or self.robot.kind.topics[publication.topic].kind
        if kind.startswith("turtlebot3"):
            return
        made = message(message_types.STORE, kind, publication.fields)
        payload = self.corrupt(publication, message_types.encode(made, kind))
        self._sent += 1
        arrival = Instant(self.now + self.latency)
        sample = ReceivedSample(
            arrival, payload, message_types.type_hash(kind), Attachment(self._sent, 0, gid)
        )
        self._waiting.append((arrival, f"/r1/{publication.topic}", kind, sample))

    def _deliver(self) -> None:
        while self._waiting and self._waiting[0][0] <= self.now:
            _, topic, kind, sample = self._waiting.pop(0)
            subscription = self.session.subscriptions.get((topic, kind))
            if subscription is not None:
                subscription.add(sample)
