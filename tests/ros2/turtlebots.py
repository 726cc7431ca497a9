"""Emulated TurtleBot 4 and TurtleBot 3 Burger without clock and I/O: topics, reactions of the base, faults.

The bodies, their odometry and the walls are the simulated world's. What the topics contain, and what makes a
base refuse a command, is written from the sources of the robots (docs/turtlebot4.md), not from the product.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from actors.geometry import Pose, wrap
from actors.instant import START, Duration, Instant, milliseconds, seconds
from actors.messages import Drive, Odometry
from actors.randomness import generator
from actors.robot_model import interpolate, load_model
from actors.world.body import Bodies, real_floor
from actors.world.physics import SUBSTEP
from actors.world.sensing import RangeSensors
from actors.world.world_setup import WorldSetup
from tests.ros2 import definitions
from tests.ros2.lidars import Fields, Lds02, RplidarA1, dense_model, header

_TIMEOUT: Final = milliseconds(500)
"""Create 3: age of a command at which the wheels stop. TurtleBot 3: time after its node has ended."""
_BACKUP_LIMIT: Final = 1.0
"""Distance that a Create 3 backs up at most, m; turtlebot4, issue 11: about that."""
_BACKUP_RELEASE: Final = 0.9
"""Distance below which it may back up again, m; own choice."""
_REFLEX: Final = milliseconds(300)
"""Duration of the reflex after a bump; own choice, as is its speed."""
_REFLEX_SPEED: Final = -0.1
HAZARDS: Final = ("backup_limit", "bump", "cliff", "stall", "wheel_drop", "object_proximity")
"""HazardStatus of a Create 3, by number."""
_FRAMES: Final = {"bump": "bump_front_center", "cliff": "cliff_front_left", "wheel_drop": "wheel_drop_left"}


class TopicProfile(NamedTuple):
    """A topic that a robot publishes."""

    kind: str
    """Message type."""
    node: str
    period: Duration
    qos: str
    """As in a token of rmw_zenoh."""


class Publication(NamedTuple):
    """A message to be published."""

    robot: str
    topic: str
    fields: Fields


class TurtlebotKind(NamedTuple):
    """A kind of robot."""

    topics: dict[str, TopicProfile]
    command_node: str
    """Node that subscribes to `cmd_vel`."""
    scan_frame: str
    is_create3: bool
    """True: a Create 3, which stops when no command arrives. False: the base of a TurtleBot 3."""


_RELIABLE, _SENSOR = "::,10:,:,:,,", "2::,5:,:,:,,"
_REPUBLISHER = "create3_repub"
KINDS: Final = {
    "turtlebot4": TurtlebotKind(
        {
            "scan": TopicProfile(definitions.SCAN, "rplidar_composition", milliseconds(125), _RELIABLE),
            "odom": TopicProfile(definitions.ODOMETRY, _REPUBLISHER, milliseconds(50), _SENSOR),
            "imu": TopicProfile(definitions.IMU, _REPUBLISHER, milliseconds(25), _SENSOR),
            "battery_state": TopicProfile(definitions.BATTERY, _REPUBLISHER, seconds(1.0), _SENSOR),
            "hazard_detection": TopicProfile(definitions.HAZARDS, _REPUBLISHER, SUBSTEP, _SENSOR),
            "dock_status": TopicProfile(definitions.DOCK, _REPUBLISHER, seconds(1.0), _SENSOR),
            "wheel_status": TopicProfile(definitions.WHEEL_STATUS, _REPUBLISHER, milliseconds(25), _SENSOR),
        },
        _REPUBLISHER,
        "rplidar_link",
        is_create3=True,
    ),
    "turtlebot3_burger": TurtlebotKind(
        {
            "scan": TopicProfile(definitions.SCAN, "laser_scan_publisher", milliseconds(200), _SENSOR),
            "odom": TopicProfile(definitions.ODOMETRY, "diff_drive_controller", milliseconds(50), _RELIABLE),
            "imu": TopicProfile(definitions.IMU, "turtlebot3_node", milliseconds(50), _RELIABLE),
            "battery_state": TopicProfile(
                definitions.BATTERY, "turtlebot3_node", milliseconds(50), _RELIABLE
            ),
            "sensor_state": TopicProfile(
                definitions.SENSOR_STATE, "turtlebot3_node", milliseconds(50), _RELIABLE
            ),
        },
        "turtlebot3_node",
        "base_scan",
        is_create3=False,
    ),
}
"""Robots by the name of their model. `imu` of a Create 3: at most every 25 ms since firmware H.2.5."""


@dataclass
class TurtlebotFaults:
    """Faults of one robot, set and cleared by commands."""

    scan: str = "works"
    scan_delay: float = 0.0
    """Time between a scan and its publication, s."""
    scan_turn: float = 0.0
    """Rotation of the lidar in its mount, rad."""
    odom: str = "works"
    odom_scale: float = 1.0
    """Factor of the distance that the wheels measure."""
    imu: str = "works"
    imu_scale: float = 1.0
    clock: float = 0.0
    """Error of the robot's clock, s."""
    base_clock: float = 0.0
    """Additional error of the base's clock, which stamps all but scans, s."""
    hazards: set[str] = field(default_factory=set)
    is_docked: bool = False
    has_estop: bool = False
    """The wheels are disabled (E-stop of a Create 3, motor power of a TurtleBot 3)."""
    ignores_commands: bool = False
    """The base is busy with an action of its own and stands."""
    reflex: tuple[float, float] | None = None
    """Velocity at which the base moves by itself, m/s and rad/s."""
    is_node_running: bool = True
    """False: the base's node has ended; nothing but scans is published."""
    battery: float = 0.8
    """Charge, 0 to 1."""


MESSAGE_FAULTS: Final = ("works", "stopped", "frozen", "repeated")


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Fields:
    return {"x": x, "y": y, "z": z}


def _rotation(heading: float) -> Fields:
    return {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}


class EmulatedTurtlebot:
    """One robot: its base and lidar."""

    def __init__(
        self, name: str, model_name: str, index: int, bodies: Bodies, cast: Callable[[], Any], seed: int
    ) -> None:
        self.name, self.kind = name, KINDS[model_name]
        self.model = load_model(model_name)
        self.faults = TurtlebotFaults()
        self.travelled = 0.0
        self._index, self._bodies = index, bodies
        self._random = generator(seed, "emulated turtlebot", name)
        self._command, self._commanded = (0.0, 0.0), Instant(-_TIMEOUT)
        self._node_ended: Instant | None = None
        lidar = RplidarA1 if self.kind.is_create3 else Lds02
        self._lidar = lidar(self.model.sensor, self.kind.scan_frame, cast, self._random)
        self._due = dict.fromkeys(self.kind.topics, START)
        self._last: dict[str, Fields] = {}
        self._delayed: deque[tuple[Instant, Fields]] = deque()
        self._shown_hazards: set[str] | None = None
        self._raw = Odometry(*[0.0] * 6)
        self._estimate = Pose(0.0, 0.0, 0.0)
        self._bumped, self._bumped_at = False, Instant(-_REFLEX)
        self._backed_up, self._is_at_limit = 0.0, False

    # --- commands ---

    def take_command(self, v: float, omega: float, now: Instant) -> None:
        """Accept a velocity command from `cmd_vel`, m/s and rad/s."""
        if not self.faults.is_node_running:
            return
        if not self.kind.is_create3:  # TurtleBot 3: whole hundredths, cut off
            v, omega = math.trunc(v * 100) / 100, math.trunc(omega * 100) / 100
        self._command, self._commanded = (v, omega), now

    def velocity(self, now: Instant) -> tuple[float, float]:
        """Return the velocity that the base executes, m/s and rad/s."""
        faults = self.faults
        if faults.has_estop or faults.hazards & {"stall", "wheel_drop"}:
            return 0.0, 0.0
        if faults.reflex is not None:
            return faults.reflex
        if self.kind.is_create3 and now - self._bumped_at < _REFLEX:
            return _REFLEX_SPEED, 0.0
        if faults.ignores_commands or self._is_stale(now):
            return 0.0, 0.0
        v, omega = self._command
        if self._hazards() & {"bump", "cliff"}:
            v = min(v, 0.0)
        if "backup_limit" in self._hazards():
            v = max(v, 0.0)
        return v, omega

    def _is_stale(self, now: Instant) -> bool:
        if self.kind.is_create3:
            return now - self._commanded > _TIMEOUT
        return self._node_ended is not None and now - self._node_ended > _TIMEOUT

    def run_node(self, running: bool, now: Instant) -> None:
        """End or start the base's node; a TurtleBot 3 stands after its start."""
        self.faults.is_node_running = running
        self._node_ended = None if running else now
        if running:
            self._command = (0.0, 0.0)

    def drive(self, now: Instant) -> None:
        """Pass the velocity to the body; call it before each sub-step."""
        v, omega = self.velocity(now)
        self._bodies.command(self._index, Drive(0, v, 0.0, omega, 0), now)

    @property
    def commanded_to_stand(self) -> bool:
        """True if the last command is zero velocity."""
        return self._command == (0.0, 0.0)

    # --- odometry ---

    def shift_odometry(self, pose: Pose) -> None:
        """Let the odometry jump by a pose in its own frame."""
        x, y, heading = self._estimate
        self._estimate = Pose(x + pose.x, y + pose.y, wrap(heading + pose.heading))

    def reset_odometry(self) -> None:
        """Restart the odometry at zero."""
        self._estimate = Pose(0.0, 0.0, 0.0)

    def measure(self, now: Instant) -> None:
        """Read odometry and bumper; call it after each sub-step."""
        senses = self._bodies.senses(self._index, 0, START, 0, False)
        self._bumped = senses.bumper != 0
        if self._bumped:
            self._bumped_at = now
        old, new = self._raw, senses.odometry
        dx, dy = new.x - old.x, new.y - old.y
        turn = self._estimate.heading - old.heading
        c, s, scale = math.cos(turn), math.sin(turn), self.faults.odom_scale
        self._estimate = Pose(
            self._estimate.x + (c * dx - s * dy) * scale,
            self._estimate.y + (s * dx + c * dy) * scale,
            wrap(self._estimate.heading + (new.heading - old.heading) * self._gyro_scale()),
        )
        self._raw = new
        forward = dx * math.cos(new.heading) + dy * math.sin(new.heading)
        lifted = "wheel_drop" in self.faults.hazards
        self._backed_up = _BACKUP_LIMIT if lifted else max(0.0, self._backed_up - forward)
        threshold = _BACKUP_RELEASE if self._is_at_limit else _BACKUP_LIMIT
        self._is_at_limit = self.kind.is_create3 and self._backed_up >= threshold

    def _gyro_scale(self) -> float:
        """Return the factor of the heading in `odom`, which a TurtleBot 3 takes from `imu`."""
        if self.kind.is_create3:
            return 1.0
        return 0.0 if self.faults.imu in {"frozen", "repeated"} else self.faults.imu_scale

    # --- publications ---

    def publications(self, now: Instant, epoch_ns: int) -> Iterator[Publication]:
        """Yield what is due; `epoch_ns`: wall time at START, ns."""
        stamp = epoch_ns + now * 1000 + round(self.faults.clock * 1e9)
        while self._delayed and self._delayed[0][0] <= now:
            yield Publication(self.name, "scan", self._delayed.popleft()[1])
        for topic, profile in self.kind.topics.items():
            if self._due[topic] > now:
                continue
            self._due[topic] = Instant(self._due[topic] + profile.period)
            if topic != "scan" and not self.faults.is_node_running:
                continue
            own = 0 if topic == "scan" else round(self.faults.base_clock * 1e9)
            fields = self._fields(topic, stamp + own)
            if fields is None:
                continue
            if topic == "scan" and self.faults.scan_delay:
                self._delayed.append((Instant(now + seconds(self.faults.scan_delay)), fields))
            else:
                yield Publication(self.name, topic, fields)

    def _fields(self, topic: str, stamp: int) -> Fields | None:
        """Return a topic's message; None if there is none."""
        state = getattr(self.faults, topic, "works")
        if topic == "hazard_detection":
            return self._hazard_message(stamp)
        is_waiting = topic == "odom" and not self.kind.is_create3 and self.faults.imu == "stopped"
        if state == "stopped" or is_waiting:
            return None
        last = self._last.get(topic)
        if state == "frozen" and last is not None:
            return last
        if state == "repeated" and last is not None:
            return {**last, "header": {**last["header"], "stamp": header(stamp, "")["stamp"]}}
        made: Fields = getattr(self, f"_{topic}")(stamp)
        self._last[topic] = made
        return made

    def _scan(self, stamp: int) -> Fields:
        return self._lidar.scan(stamp, self.faults.scan, self.faults.scan_turn)

    def _odom(self, stamp: int) -> Fields:
        unknown = np.zeros(36)
        scale = self.faults.odom_scale
        moving = {"linear": _vector(self._raw.vx * scale), "angular": _vector(z=self._raw.omega)}
        pose = {
            "position": _vector(self._estimate.x, self._estimate.y),
            "orientation": _rotation(self._estimate.heading),
        }
        return {
            "header": header(stamp, "odom"),
            "child_frame_id": "base_link" if self.kind.is_create3 else "base_footprint",
            "pose": {"pose": pose, "covariance": unknown},
            "twist": {"twist": moving, "covariance": unknown},
        }

    def _imu(self, stamp: int) -> Fields:
        *_, heading, _, _, omega = self._bodies.truth(self._index)
        noise = math.radians(self.model.kobuki_errors.gyro_noise_deg) * float(self._random.standard_normal())
        unknown = np.zeros(9)
        return {
            "header": header(stamp, "imu" if self.kind.is_create3 else "imu_link"),
            "orientation": _rotation(heading),
            "orientation_covariance": unknown,
            "angular_velocity": _vector(z=omega * self.faults.imu_scale + noise),
            "angular_velocity_covariance": unknown,
            "linear_acceleration": _vector(z=9.8),
            "linear_acceleration_covariance": unknown,
        }

    def _battery_state(self, stamp: int) -> Fields:
        """Return the battery; a TurtleBot 3 gives its charge in percent, against the definition."""
        charge, battery = self.faults.battery, self.model.battery
        assert battery is not None
        percent = charge if self.kind.is_create3 else charge * 100
        zeros = ("temperature", "current", "charge", "capacity", "design_capacity")
        return {
            "header": header(stamp, "base_link" if self.kind.is_create3 else ""),
            **dict.fromkeys(zeros, 0.0),
            "voltage": interpolate(battery.voltage, charge),
            "percentage": percent,
            "power_supply_status": 1 if self.faults.is_docked else 2,
            "power_supply_health": 1,
            "power_supply_technology": 2,
            "present": True,
            "cell_voltage": np.zeros(0, np.float32),
            "cell_temperature": np.zeros(0, np.float32),
            "location": "",
            "serial_number": "",
        }

    def _hazards(self) -> set[str]:
        natural = {"bump": self._bumped, "backup_limit": self._is_at_limit}
        return self.faults.hazards | {name for name, found in natural.items() if found}

    def _hazard_message(self, stamp: int) -> Fields | None:
        """Return the hazards if they have changed; firmware H.2.5 and later publish them only then."""
        found = self._hazards()
        if found == self._shown_hazards:
            return None
        self._shown_hazards = set(found)
        detections = [
            {"header": header(stamp, _FRAMES.get(name, "base_link")), "type": HAZARDS.index(name)}
            for name in sorted(found)
        ]
        return {"header": header(stamp, "base_link"), "detections": detections}

    def repeat_hazards(self) -> None:
        """Publish the hazards again although they have not changed."""
        self._shown_hazards = None

    def _dock_status(self, stamp: int) -> Fields:
        docked = self.faults.is_docked
        return {"header": header(stamp, "base_link"), "dock_visible": docked, "is_docked": docked}

    def _wheel_status(self, stamp: int) -> Fields:
        names = ("current_ma_left", "current_ma_right", "pwm_left", "pwm_right")
        enabled = not self.faults.has_estop
        return {"header": header(stamp, "base_link"), **dict.fromkeys(names, 0), "wheels_enabled": enabled}

    def _sensor_state(self, stamp: int) -> Fields:
        battery = self.model.battery
        assert battery is not None
        names = ("cliff", "sonar", "illumination")
        return {
            "header": header(stamp, ""),
            "bumper": int("bump" in self.faults.hazards),
            **dict.fromkeys(names, 0.0),
            **dict.fromkeys(("led", "button", "left_encoder", "right_encoder"), 0),
            "torque": not self.faults.has_estop,
            "battery": interpolate(battery.voltage, self.faults.battery),
        }


class TurtlebotWorld:
    """Emulated robots in the simulated world; time starts at 0 and advances by sub-steps of 10 ms."""

    def __init__(self, setup: WorldSetup, epoch_ns: int) -> None:
        """Create the robots; `epoch_ns`: wall time at START, ns. Raises AcrcError."""
        self._bodies = Bodies(setup)
        self.epoch_ns = epoch_ns
        self.now = START
        models = [load_model(robot.model, robot.sensor) for robot in setup.robots]
        noise = [generator(setup.seed, "emulated turtlebot range", robot.id) for robot in setup.robots]
        self._sensors = RangeSensors(real_floor(setup, models).visible, list(map(dense_model, models)), noise)
        self.robots = {
            robot.id: EmulatedTurtlebot(
                robot.id, robot.model, index, self._bodies, partial(self._cast, index), setup.seed
            )
            for index, robot in enumerate(setup.robots)
        }

    def advance(self, until: Instant) -> Iterator[Publication]:
        """Advance to `until`; yield all publications in order."""
        while self.now + SUBSTEP <= until:
            for robot in self.robots.values():
                robot.drive(self.now)
            before = self._bodies.positions.copy()
            self._bodies.move(self.now, SUBSTEP)
            self.now = Instant(self.now + SUBSTEP)
            moved = np.hypot(*(self._bodies.positions - before).T)
            for robot, distance in zip(self.robots.values(), moved.tolist(), strict=True):
                robot.travelled += distance
                robot.measure(self.now)
                yield from robot.publications(self.now, self.epoch_ns)

    def pose(self, robot: str) -> tuple[float, float, float]:
        """Return the true pose: x, y in m and heading in rad, map frame."""
        return self._bodies.truth(self._index(robot))[:3]

    def speed(self, robot: str) -> float:
        """Return the true speed, m/s."""
        return math.hypot(*self._bodies.truth(self._index(robot))[3:5])

    def move_robot(self, robot: str, pose: Pose) -> None:
        """Carry a robot to another pose. Raises AcrcError if it does not fit."""
        self._bodies.place(self._index(robot), pose)

    def _index(self, robot: str) -> int:
        return list(self.robots).index(robot)

    def _cast(self, index: int) -> Any:
        """Return ranges of a robot's lidar at DENSE angles of its frame, mm."""
        poses = np.array([self._bodies.truth(one)[:3] for one in range(len(self.robots))])
        (ranges,) = self._sensors.scan([index], poses, self._bodies.obstacles)
        return ranges
