"""Process of emulated TurtleBots: `python -m tests.ros2.emulated_turtlebot --setup FILE`.

It runs a Zenoh router and publishes the robots' topics by zenoh-ros2-sdk, an independent implementation of
rmw_zenoh. It prints "ready" and runs until its input ends. Each line of input is answered by one line: "ok",
the answer to a query, or an error. Lines: VERB ROBOT ARGUMENTS, see USAGE.
"""

import math
import os
import select
import signal
import sys
import tempfile
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import zenoh
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber

from actors.geometry import Pose
from actors.instant import START, Duration, Instant, in_seconds
from actors.runtime.errors import AcrcError
from actors.runtime.linux import die_with_parent
from actors.world.physics import SUBSTEP
from actors.world.world_setup import WorldSetup
from tests.ros2 import definitions
from tests.ros2.dds_bridge import BridgedPublisher, BridgedSubscriber
from tests.ros2.lidars import SCAN_FAULTS
from tests.ros2.routers import start_router
from tests.ros2.sdk import message, sdk_session, use_own_definitions
from tests.ros2.turtlebots import (
    HAZARDS,
    MESSAGE_FAULTS,
    EmulatedTurtlebot,
    Publication,
    TurtlebotFaults,
    TurtlebotWorld,
)

_MAX_LATE: Final = Duration(500_000)
"""Lateness that is caught up, µs; beyond, time is skipped."""
_RIVAL_PERIOD: Final = Duration(50_000)
_STATES: Final = {"scan": SCAN_FAULTS, "odom": MESSAGE_FAULTS, "imu": MESSAGE_FAULTS}
_NUMBERS: Final = {
    "delay": ("scan_delay", 1.0),
    "turn": ("scan_turn", math.pi / 180),
    "odom_scale": ("odom_scale", 1.0),
    "imu_scale": ("imu_scale", 1.0),
    "clock": ("clock", 1.0),
    "base_clock": ("base_clock", 1.0),
    "battery": ("battery", 1.0),
}
"""Verbs that set a number, and the factor to the unit of the fault."""
_SWITCHES: Final = {"dock": "is_docked", "estop": "has_estop", "ignore": "ignores_commands"}
USAGE: Final = {
    **{verb: "|".join(states) for verb, states in _STATES.items()},
    **dict.fromkeys(_NUMBERS, "NUMBER"),
    **dict.fromkeys((*_SWITCHES, "node", "router"), "on|off"),
    "hazard": f"{'|'.join(HAZARDS)} on|off",
    "repeat_hazards": "",
    "reflex": "SPEED TURN_RATE",
    "jump": "X Y DEGREES",
    "reset": "",
    "rival": "NODE SPEED",
    "pose": "",
    "where": "",
    "move": "X Y DEGREES",
    "repair": "",
}
"""Arguments of each command, after verb and robot."""


class EmulatedRobotOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Names and types of one robot's topics."""

    namespace: str | None = None
    """With a leading slash, or empty; None: the robot's name."""
    stamped: bool = True
    """True: `cmd_vel` has TwistStamped, as from Jazzy on; False: Twist."""
    bridge: Literal["rmw_zenoh", "ros2dds"] = "rmw_zenoh"
    """`ros2dds`: the robot's nodes use DDS, and zenoh-bridge-ros2dds connects them."""


class EmulationSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Set-up of the process."""

    world: WorldSetup
    """Robots with the models turtlebot4 and turtlebot3_burger."""
    port: int
    """Port of the router on 127.0.0.1."""
    domain: int = 0
    robots: dict[str, EmulatedRobotOptions] = {}


class SdkNode:
    """One robot's publishers and subscription in zenoh-ros2-sdk."""

    def __init__(
        self,
        robot: EmulatedTurtlebot,
        options: EmulatedRobotOptions,
        setup: EmulationSetup,
        commands: deque[tuple[str, float, float]],
    ) -> None:
        self.robot = robot
        namespace = f"/{robot.name}" if options.namespace is None else options.namespace
        self._is_bridged, self._port = options.bridge == "ros2dds", setup.port
        self._common: dict[str, Any] = {
            "namespace": namespace or "/",
            "domain_id": setup.domain,
            "router_port": setup.port,
        }
        self._command_topic = f"{namespace}/cmd_vel"
        self._kind = definitions.TWIST_STAMPED if options.stamped else definitions.TWIST
        self._publishers = {
            topic: self._publisher(f"{namespace}/{topic}", profile.kind, profile.node, profile.qos)
            for topic, profile in robot.kind.topics.items()
        }

        def take(command: Any) -> None:
            twist = command.twist if options.stamped else command
            commands.append((robot.name, twist.linear.x, twist.angular.z))

        self._subscriber = (
            BridgedSubscriber(self._command_topic, self._kind, take, setup.port)
            if self._is_bridged
            else ROS2Subscriber(
                self._command_topic, self._kind, take, node_name=robot.kind.command_node, **self._common
            )
        )
        self._rival: Any = None
        self._rival_speed = 0.0

    def _publisher(self, topic: str, kind: str, node: str, qos: str | None = None) -> Any:
        if self._is_bridged:
            return BridgedPublisher(topic, kind, self._port, reliable=not (qos or "").startswith("2"))
        return ROS2Publisher(topic, kind, node_name=node, qos=qos, **self._common)

    def publish(self, publication: Publication) -> None:
        """Publish a message by the SDK."""
        publisher = self._publishers[publication.topic]
        made = message(publisher.session_mgr.store, publisher.msg_type, publication.fields)
        publisher.publish(**vars(made))

    def set_rival(self, node: str, speed: float) -> None:
        """Publish `cmd_vel` by another node as well; speed 0: only its token exists; node "off": end it."""
        if self._rival is not None:
            self._rival.close()
            self._rival = None
        if node != "off":
            self._rival = self._publisher(self._command_topic, self._kind, node)
        self._rival_speed = speed

    def run_rival(self, stamp_ns: int) -> None:
        """Publish the other node's command."""
        if self._rival is None or not self._rival_speed:
            return
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        fields: dict[str, Any] = {"linear": {**zero, "x": self._rival_speed}, "angular": zero}
        if self._kind == definitions.TWIST_STAMPED:
            sec, nanosec = divmod(stamp_ns, 1_000_000_000)
            fields = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}, "twist": fields}
        self._rival.publish(**vars(message(self._rival.session_mgr.store, self._kind, fields)))


class TurtlebotEmulation:
    """Emulated robots on a router, in real time."""

    def __init__(self, setup: EmulationSetup) -> None:
        self._port = setup.port
        self._router: zenoh.Session | None = start_router(setup.port)
        sdk_session(setup.port)
        self._commands: deque[tuple[str, float, float]] = deque(maxlen=1000)
        self.world = TurtlebotWorld(setup.world, 0)
        options = {robot: setup.robots.get(robot, EmulatedRobotOptions()) for robot in self.world.robots}
        self._nodes = {
            name: SdkNode(robot, options[name], setup, self._commands)
            for name, robot in self.world.robots.items()
        }
        self._rival_due = START
        deque(TurtlebotWorld(setup.world, 0).advance(Instant(200_000)), maxlen=0)  # load all kernels
        self.world.epoch_ns = time.time_ns()
        self._began_ns = time.monotonic_ns()

    def serve(self) -> bool:
        """Wait for the next sub-step or a line of input; return False at the end of the input."""
        wait = max(0, self.world.now + SUBSTEP - self._clock()) * 1e-6
        ready, _, _ = select.select([sys.stdin], [], [], wait)
        self._advance()
        if ready:
            line = sys.stdin.readline()
            if not line:
                return False
            sys.stdout.write(f"{self._answer(line)}\n")
            sys.stdout.flush()
        return True

    def _clock(self) -> Instant:
        return Instant((time.monotonic_ns() - self._began_ns) // 1000)

    def _advance(self) -> None:
        late = self._clock() - self.world.now
        if late > _MAX_LATE:
            self._began_ns += (late - _MAX_LATE) * 1000
            self.world.epoch_ns += (late - _MAX_LATE) * 1000
        with suppress(IndexError):
            while True:
                robot, v, omega = self._commands.popleft()
                self.world.robots[robot].take_command(v, omega, self.world.now)
        for publication in self.world.advance(self._clock()):
            self._nodes[publication.robot].publish(publication)
        if self._rival_due <= self.world.now:
            self._rival_due = Instant(self.world.now + _RIVAL_PERIOD)
            for node in self._nodes.values():
                node.run_rival(self.world.epoch_ns + self.world.now * 1000)

    def _answer(self, line: str) -> str:
        verb, *words = line.split() or [""]
        usage = USAGE.get(verb)
        if usage is None:
            return f"unknown command {verb!r}; use one of {', '.join(USAGE)}"
        if len(words) != 1 + len(usage.split()) or words[0] not in self._nodes:
            return f"usage: {verb} {'|'.join(self._nodes)} {usage}".rstrip()
        for word, choice in zip(words[1:], usage.split(), strict=True):
            if "|" in choice and word not in choice.split("|"):
                return f"invalid argument {word!r}; use one of {choice}"
        try:
            return self._execute(self._nodes[words[0]], verb, words[1:]) or "ok"
        except (AcrcError, ValueError) as error:
            return str(error)

    def _execute(self, node: SdkNode, verb: str, words: list[str]) -> str | None:
        robot = node.robot
        faults = robot.faults
        if verb in _STATES:
            setattr(faults, verb, words[0])
        elif verb in _NUMBERS:
            name, factor = _NUMBERS[verb]
            setattr(faults, name, float(words[0]) * factor)
        elif verb in _SWITCHES:
            setattr(faults, _SWITCHES[verb], words[0] == "on")
        elif verb == "rival":
            node.set_rival(words[0], float(words[1]))
        elif verb == "router":
            self._switch_router(words[0] == "on")
        elif verb in {"jump", "move"}:
            x, y, degrees = map(float, words)
            pose = Pose(x, y, math.radians(degrees))
            if verb == "jump":
                robot.shift_odometry(pose)
            else:
                self.world.move_robot(robot.name, pose)
        else:
            return self._change(robot, verb, words)
        return None

    def _change(self, robot: EmulatedTurtlebot, verb: str, words: list[str]) -> str | None:
        match verb, words:
            case "hazard", [name, state]:
                (robot.faults.hazards.add if state == "on" else robot.faults.hazards.discard)(name)
            case "repeat_hazards", _:
                robot.repeat_hazards()
            case "reflex", [v, omega]:
                robot.faults.reflex = (float(v), float(omega))
            case "node", [state]:
                robot.run_node(state == "on", self.world.now)
            case "reset", _:
                robot.reset_odometry()
            case "repair", _:
                robot.faults = TurtlebotFaults()
                robot.run_node(True, self.world.now)
                self._switch_router(True)
            case "pose", _:
                return " ".join(f"{value:.4f}" for value in self.world.pose(robot.name))
            case "where", _:
                time_s, speed = in_seconds(Duration(self.world.now - START)), self.world.speed(robot.name)
                return f"{time_s:.3f} {robot.travelled:.4f} {speed:.4f} {int(robot.commanded_to_stand)}"
        return None

    def _switch_router(self, on: bool) -> None:
        if on and self._router is None:
            self._router = start_router(self._port)
        elif not on and self._router is not None:
            self._router.close()  # type: ignore[no-untyped-call]
            self._router = None


def main() -> None:
    """Emulate robots until the input ends."""
    die_with_parent(os.getppid(), signal.SIGKILL)
    setup = msgspec.json.decode(
        Path(sys.argv[sys.argv.index("--setup") + 1]).read_bytes(), type=EmulationSetup
    )
    with tempfile.TemporaryDirectory() as folder:
        use_own_definitions(Path(folder))
        emulation = TurtlebotEmulation(setup)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while emulation.serve():
            pass
    os._exit(0)  # threads of Zenoh may wait for a router that has ended


if __name__ == "__main__":
    main()
