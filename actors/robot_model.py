"""Robot models: body, drive and sensors of a robot, from a TOML file."""

import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from actors import geometry, settings, wording
from actors.geometry import Pose
from actors.instant import Duration, seconds
from actors.portable import hypot
from actors.runtime.errors import AcrcError
from actors.settings import Place, RuleError, Settings, StartPose, Text

OdometryKind = Literal["exact", "stage", "kobuki"]
Model = Annotated[
    Text, Meta(description='the name of a robot model such as "turtlebot2", or the path of a .toml file')
]
SensorName = Annotated[
    Text, Meta(description='the name of one of the robot model\'s sensors, such as "chapter"')
]
MOST_PLACES: Final = 1000
Places = Annotated[
    tuple[Place, ...],
    Meta(max_length=MOST_PLACES, description=f"a list of points [x, y] in m, at most {MOST_PLACES}"),
]
_Vertices = Annotated[
    tuple[Annotated[tuple[float, float], Meta(description="a point [x, y] in m")], ...],
    Meta(min_length=3, max_length=32, description="3 to 32 points [x, y] in m"),
]
_Offset = Annotated[float, Meta(ge=-5, le=5)]
_Angle = Annotated[float, Meta(gt=0, le=180)]
_Range = Annotated[float, Meta(ge=0, le=60)]
_Noise = Annotated[float, Meta(ge=0, le=10)]


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
        """Whether the rays cover a full circle."""
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
    places: Places
    """Its places, in initial order, m, map frame."""


def scan_angles(sensor: RangeSensor) -> NDArray[np.float64]:
    """Return the directions of the rays in the body frame: (rays,), rad in (−π, π], in scan order."""
    half = math.radians(sensor.field_of_view_deg) / 2
    angles = sensor.mount.heading + np.linspace(sensor.first_angle, half, sensor.rays)
    wrapped: NDArray[np.float64] = math.pi - np.mod(math.pi - angles, math.tau)
    return wrapped


def load_model(name_or_path: str, sensor: str | None = None) -> RobotModel:
    """Load a shipped robot model (`turtlebot2`) or a .toml file, and mount a sensor (default: the file's).

    Raises AcrcError.
    """
    name, text = _read(name_or_path)
    model = settings.parse(text, RobotModel, name)
    mounted = model.default_sensor if sensor is None else sensor
    if mounted not in model.sensors:
        asked = "default_sensor" if sensor is None else "the sensor"
        right = wording.one_of(sorted(model.sensors))
        raise AcrcError(f"{name}: {asked} is {wording.toml_text(mounted)}, but must be {right}")
    return msgspec.structs.replace(model, default_sensor=mounted)


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
