"""Robot models: body, drive and sensors of a robot, from a TOML file."""

import math
from functools import lru_cache
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta

from actors import geometry, settings, wording
from actors.array_types import Floats
from actors.geometry import Point, Pose
from actors.instant import Duration, seconds
from actors.portable import hypot
from actors.runtime.errors import AcrcError
from actors.settings import RuleError, Settings, StartPose, Text

OdometryKind = Literal["exact", "stage", "kobuki"]
AdversaryKind = Literal["mute", "forger", "replayer", "silencer", "flooder", "liar"]
"""Use of a robot's radio against the others; see `actors.robot.behaviour.adversary`."""
Model = Annotated[
    Text, Meta(description='the name of a robot model such as "turtlebot2", or the path of a .toml file')
]
SensorName = Annotated[
    Text, Meta(description='the name of one of the robot model\'s sensors, such as "chapter"')
]
MOST_ITEMS: Final = 1000
Items = Annotated[
    tuple[Any, ...],
    Meta(max_length=MOST_ITEMS, description=f"a list of at most {MOST_ITEMS} items of the task"),
]
_Vertices = Annotated[
    tuple[Annotated[tuple[float, float], Meta(description="a point [x, y] in m")], ...],
    Meta(min_length=3, max_length=32, description="3 to 32 points [x, y] in m"),
]
_Offset = Annotated[float, Meta(ge=-5, le=5)]
_Angle = Annotated[float, Meta(gt=0, le=180)]
_Range = Annotated[float, Meta(ge=0, le=60)]
_Noise = Annotated[float, Meta(ge=0, le=10)]
_Power = Annotated[float, Meta(ge=0, le=10_000)]
_Feedback = Annotated[
    Duration,
    Meta(
        ge=10_000,
        le=1_000_000,
        multiple_of=10_000,
        description="a multiple of the 0.01 s physics sub-step, from 0.01 to 1 s",
    ),
]
_Error = Annotated[float, Meta(ge=0, le=1000)]
_Curve = Annotated[
    tuple[Annotated[tuple[float, float], Meta(description="a pair [x, y]")], ...],
    Meta(min_length=2, max_length=32, description="2 to 32 pairs [x, y]"),
]


class Footprint(Settings, frozen=True):
    """Outline of the body: a disc or a convex polygon around its origin."""

    radius: Annotated[float, Meta(gt=0, le=5)] | None = None
    """Radius of a disc, m."""
    vertices: _Vertices | None = None
    """Corners of a polygon, m in the body frame; counter-clockwise once loaded."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.radius is None) == (self.vertices is None):
            raise RuleError(
                f"have either radius or vertices, but has {'none' if self.radius is None else 'both'}"
            )
        if self.vertices is not None:
            if fault := geometry.polygon_fault(self.vertices):
                raise RuleError(f"have the vertices of a convex polygon round (0, 0), but {fault}")
            msgspec.structs.force_setattr(self, "vertices", geometry.counter_clockwise(self.vertices))

    @property
    def circumradius(self) -> float:
        """Radius of the smallest disc around the origin that contains the body, m."""
        if self.radius is not None:
            return self.radius
        return max(hypot(x, y) for x, y in self.vertices or ())

    @property
    def inradius(self) -> float:
        """Radius of the largest disc around the origin within the body, m."""
        if self.radius is not None:
            return self.radius
        assert self.vertices is not None
        return geometry.distance_to_border(self.vertices)


class DriveParameters(Settings, frozen=True):
    """Kinematics and limits of the drive."""

    kind: Literal["differential", "omnidirectional"]
    """A differential drive cannot move sideways and ignores `vy` of a command."""
    speed: Annotated[float, Meta(gt=0, le=10)]
    """Maximum speed, m/s, forward and backward; omnidirectional: in every direction."""
    acceleration: Annotated[float, Meta(gt=0, le=100)]
    """Maximum acceleration and deceleration, m/s²; times mass it is the force of the drive."""
    turn_rate: Annotated[float, Meta(gt=0, le=30)]
    """Maximum turn rate, rad/s."""
    turn_acceleration: Annotated[float, Meta(gt=0, le=300)]
    """Maximum turn acceleration, rad/s²."""
    grip: Annotated[float, Meta(gt=0, le=100)] = 5.0
    """Sideways acceleration at which the wheels of a differential drive start to slide, m/s²."""
    watchdog: Annotated[float, Meta(gt=0, le=60)] = 0.5
    """Command timeout after which the base brakes, s."""
    delay: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Time from a command to the wheels' first response, s, rounded to a physics sub-step."""


class Bumper(Settings, frozen=True):
    """A contact bumper around the front with three sectors: right, centre, left."""

    centre_deg: _Angle
    """Half the angle of the centre sector, degrees."""
    reach_deg: _Angle
    """Angle from straight ahead to the end of a side sector, degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reach_deg < self.centre_deg:
            raise RuleError(
                f"have a reach_deg of at least centre_deg, not {self.reach_deg:g} and {self.centre_deg:g}"
            )


class RangeSensor(Settings, frozen=True, kw_only=True):
    """A planar range sensor: a lidar, or a depth camera used as one."""

    x: _Offset = 0.0
    """Position on the body, m forward of the origin."""
    y: _Offset = 0.0
    """Position on the body, m to the left of the origin."""
    heading_deg: Annotated[float, Meta(gt=-180, le=180)] = 0.0
    """Direction of the middle of its view, degrees counter-clockwise from straight ahead."""
    field_of_view_deg: Annotated[float, Meta(gt=0, le=360)]
    """Angle from the first to the last ray, or the full circle, degrees."""
    rays: Annotated[int, Meta(ge=2, le=10_000)]
    """Rays per scan, at equal angles."""
    range_min: _Range = 0.0
    """Minimum range, m; nearer objects give no echo, but occlude others."""
    range_max: Annotated[float, Meta(gt=0, le=60)]
    """Maximum range, m."""
    rate: Annotated[float, Meta(gt=0, le=1000)]
    """Scan rate, Hz."""
    noise: _Noise = 0.0
    """Standard deviation of a range, m."""
    noise_growth: _Noise = 0.0
    """Growth of the standard deviation with the square of the range, 1/m."""
    power: _Power = 0.0
    """Power drawn from the battery, W."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.range_max <= self.range_min:
            raise RuleError(
                f"have a range_max above range_min, not {self.range_max:g} m and {self.range_min:g} m"
            )

    @property
    def mount(self) -> Pose:
        """Pose in the body frame."""
        return Pose(self.x, self.y, math.radians(self.heading_deg))

    @property
    def period(self) -> Duration:
        """Time between two scans."""
        return seconds(1 / self.rate)

    @property
    def full_circle(self) -> bool:
        """True if the rays cover a full circle."""
        return self.field_of_view_deg == 360

    @property
    def increment(self) -> float:
        """Angle between adjacent rays, rad."""
        view = math.radians(self.field_of_view_deg)
        return view / self.rays if self.full_circle else view / (self.rays - 1)

    @property
    def first_angle(self) -> float:
        """Direction of the first ray in the sensor frame, rad; the others follow counter-clockwise.

        The view is symmetrical. A full circle ends with the ray pointing backward, which occurs once.
        """
        half = math.radians(self.field_of_view_deg) / 2
        return self.increment - half if self.full_circle else -half


def interpolate(curve: _Curve | None, x: float) -> float:
    """Return the value at x of points in ascending order; constant beyond them, 0 without points."""
    if curve is None:
        return 0.0
    before = curve[0]
    for after in curve:
        if x < after[0]:
            if after is before:
                break
            return before[1] + (after[1] - before[1]) * ((x - before[0]) / (after[0] - before[0]))
        before = after
    return before[1]


class BatteryParameters(Settings, frozen=True, kw_only=True):
    """Battery and consumers, at constant efficiency; the mounted sensor has its own power."""

    capacity_wh: Annotated[float, Meta(gt=0, le=10_000)]
    """Usable energy, Wh."""
    electronics: _Power = 0.0
    """Power of computer and base while the robot is switched on, W."""
    driving: _Curve | None = None
    """Power of the motors at a speed: points [m/s, W], linear in between; None: 0 W."""
    turning: _Curve | None = None
    """The same at a turn rate: points [rad/s, W]. The greater of both powers is drawn: the mean speed of two
    wheels is that of the body or, turning faster, that of a wheel around it."""
    transmitting: _Power = 0.0
    """Power of the transceiver while it sends, W."""
    receiving: _Power = 0.0
    """Power of the transceiver otherwise, W; listening takes as much as receiving (MRF24J40, CC2420)."""
    charging: _Power = 0.0
    """Greatest power at which the battery can be charged, W."""
    voltage: _Curve | None = None
    """Voltage under load at a charge: points [share of the capacity, V], both ascending; used on hardware."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("driving", "turning", "voltage"):
            points = getattr(self, name) or ()
            if any(not (a[0] < b[0] and (a[1] < b[1] or name != "voltage")) for a, b in pairwise(points)):
                raise RuleError(f"have ascending points in {name}")
            if any(not (0 <= x <= 1000 and 0 <= y <= 10_000) for x, y in points):
                raise RuleError(f"have points from [0, 0] to [1000, 10000] in {name}")
        if self.voltage is not None and (self.voltage[0][0], self.voltage[-1][0]) != (0, 1):
            raise RuleError("have a voltage from the charge 0 to 1")

    @property
    def capacity_uj(self) -> int:
        """Capacity in whole microjoules."""
        return round(self.capacity_wh * 3_600_000_000)

    def motor_power(self, speed: float, turn_rate: float) -> float:
        """Return the power of the motors, W, at a velocity, m/s and rad/s, not negative."""
        return max(interpolate(self.driving, speed), interpolate(self.turning, turn_rate))

    def charge_at(self, volts: float) -> float | None:
        """Return the charge at a measured voltage, 0 to 1; None without a voltage curve."""
        return None if self.voltage is None else interpolate(tuple((v, c) for c, v in self.voltage), volts)


class StageErrors(Settings, frozen=True):
    """Stage's position device with `localization "odom"`: a constant error factor per axis and run.

    Each factor is 1 + e with e uniform in [−E/2, E/2] (rtv/Stage, libstage/model_position.cc).
    """

    forward: _Error = 0.03
    """E of forward motion; d3scomp/ROSRemote, simulation/turtlebot.inc, odom_error."""
    leftward: _Error = 0.03
    """E of leftward motion; same file."""
    turn: _Error = 0.02
    """E of turning; same file."""


class KobukiErrors(Settings, frozen=True):
    """Error model of a Kobuki: position from wheel encoders, heading from a gyro (kobuki_node, odometry)."""

    track: Annotated[float, Meta(gt=0, le=5)] = 0.230
    """Distance between the wheels, m; kobuki_driver, "Kobuki Parameters"."""
    tick_um: Annotated[float, Meta(gt=0, le=100_000)] = 85.292
    """Travel per encoder tick, µm; kobuki_driver, "Kobuki Parameters"."""
    feedback: _Feedback = Duration(20_000)
    """Period of the base's feedback, a multiple of a physics sub-step; kobuki_driver, "Protocol
    Specification": 50 Hz."""
    gyro_resolution_deg: Annotated[float, Meta(gt=0, le=10)] = 0.01
    """Resolution of the heading in the feedback, degrees; kobuki_driver, "Protocol Specification", inertial
    data."""
    gyro_noise_deg: _Error = 0.03
    """White noise of the angular rate, °/s per √Hz, hence degrees per √s; ST L3G4200D data sheet."""
    gyro_bias_deg: _Error = 0.01
    """Standard deviation of the initial bias of the angular rate, °/s; own estimate: 0.33 K since calibration
    at 0.03 °/s per K (same data sheet)."""
    gyro_walk_deg: _Error = 0.0005
    """Random walk of the bias, °/s per √s; own estimate: equals the initial bias after 7 minutes."""
    wheel_scale: _Error = 0.002
    """Relative standard deviation of a wheel's radius; own estimate: 0.07 mm of 35 mm."""
    wheel_bias: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0
    """Relative error of the distance measured by both wheels: positive, if their radius is smaller than the
    base assumes; to be measured."""
    slip: _Error = 0.002
    """Standard deviation of a wheel's travel, m per √m travelled; own estimate for a smooth floor."""


class RobotModel(Settings, frozen=True, kw_only=True):
    """Body, drive and range sensors of a kind of robot, one sensor of which is mounted."""

    name: Text
    mass: Annotated[float, Meta(gt=0, le=10_000)]
    """Mass, kg, centred at the body's origin."""
    friction: _Noise
    """Friction coefficient along walls; between two robots the product of both."""
    odometry: OdometryKind
    """Default model of odometry errors."""
    default_sensor: str
    """Name of the mounted sensor."""
    footprint: Footprint
    drive: DriveParameters
    bumper: Bumper | None = None
    battery: BatteryParameters | None = None
    """None: it cannot be simulated."""
    stage_errors: StageErrors = StageErrors()
    """Errors of the odometry `stage`."""
    kobuki_errors: KobukiErrors = KobukiErrors()
    """Errors of the odometry `kobuki`."""
    sensors: Annotated[dict[str, RangeSensor], Meta(min_length=1)]
    """Available sensors, by name."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.odometry == "kobuki" and self.drive.kind != "differential":
            raise RuleError("have a differential drive where odometry is 'kobuki', which reads two wheels")

    @property
    def sensor(self) -> RangeSensor:
        """The mounted sensor."""
        return self.sensors[self.default_sensor]

    def with_sensor(self, **changes: float) -> "RobotModel":
        """Return the model with changed properties of its mounted sensor."""
        sensor = msgspec.structs.replace(self.sensor, **changes)
        return msgspec.structs.replace(self, sensors={**self.sensors, self.default_sensor: sensor})


class RobotDescription(Settings, frozen=True):
    """Description of one robot, common to fleet, world, base and robot."""

    id: Annotated[str, Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}\Z")]
    model: Model
    """Name of a shipped robot model, or the path of a model file."""
    sensor: SensorName | None
    """Mounted sensor of the model; None: its default."""
    start: StartPose
    """Pose at switch-on: x, y in m and heading in rad, map frame."""
    items: Items = ()
    """Its initial items, of the task's item type."""

    @property
    def start_point(self) -> Point:
        """Position at switch-on, m, map frame."""
        return Point(*self.start[:2])


def scan_angles(sensor: RangeSensor) -> Floats:
    """Return the directions of the rays in the body frame: (rays,), rad in (−π, π], in scan order."""
    half = math.radians(sensor.field_of_view_deg) / 2
    angles = sensor.mount.heading + np.linspace(sensor.first_angle, half, sensor.rays)
    wrapped: Floats = math.pi - np.mod(math.pi - angles, math.tau)
    return wrapped


def load_model(name_or_path: str, sensor: str | None = None) -> RobotModel:
    """Load a shipped robot model (`turtlebot2`) or a .toml file, and mount a sensor (default: the file's).

    Raises AcrcError.
    """
    name, text = _read(name_or_path)
    model = _parsed(text, name)
    mounted = model.default_sensor if sensor is None else sensor
    if mounted not in model.sensors:
        asked = "default_sensor" if sensor is None else "the sensor"
        right = wording.one_of(sorted(model.sensors))
        raise AcrcError(f"{name}: {asked} is {wording.toml_text(mounted)}, but must be {right}")
    return msgspec.structs.replace(model, default_sensor=mounted)


@lru_cache(8)  # robots of a run have few models, and parsing takes a fifth of a robot's creation
def _parsed(text: str, name: str) -> RobotModel:
    return settings.parse(text, RobotModel, name)


def _read(name_or_path: str) -> tuple[str, str]:
    """Return the model file's name for errors, and its text."""
    shipped = resources.files("actors.models")
    known = sorted(file.name[:-5] for file in shipped.iterdir() if file.name.endswith(".toml"))
    if name_or_path in known:
        return f"{name_or_path}.toml", shipped.joinpath(f"{name_or_path}.toml").read_text("utf-8")
    if not name_or_path.endswith(".toml"):
        right = f"{', '.join(map(wording.toml_text, known))} or the path of a .toml file"
        raise AcrcError(f"unknown robot model {wording.toml_text(name_or_path)}; must be {right}")
    return name_or_path, settings.read_text(Path(name_or_path), "robot model")
