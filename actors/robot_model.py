"""Robot models: one TOML file each says what a robot's body, drive and sensors are, to world and robot."""

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
    """The body's outline on the floor: either a disc or a convex polygon round the body's origin."""

    radius: Annotated[float, Meta(gt=0, le=5)] | None = None
    """Radius of a disc, m."""
    vertices: _Vertices | None = None
    """Corners of a polygon, m in the body's frame; counter-clockwise once read."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.radius is None) == (self.vertices is None):
            raise RuleError(
                f"hold either radius or vertices, but has {'none' if self.radius is None else 'both'}"
            )
        if self.vertices is not None:
            if fault := geometry.polygon_fault(self.vertices):
                raise RuleError(f"hold the vertices of a convex polygon round (0, 0), but {fault}")
            msgspec.structs.force_setattr(self, "vertices", geometry.counter_clockwise(self.vertices))

    @property
    def circumradius(self) -> float:
        """Radius of the smallest disc round the body's origin that holds the body, m."""
        if self.radius is not None:
            return self.radius
        return max(hypot(x, y) for x, y in self.vertices or ())

    @property
    def inradius(self) -> float:
        """Radius of the largest disc round the body's origin within the body, m."""
        if self.radius is not None:
            return self.radius
        assert self.vertices is not None
        return geometry.distance_to_border(self.vertices)


class DriveParameters(Settings, frozen=True):
    """How the body moves on its wheels."""

    kind: Literal["differential", "omnidirectional"]
    """A differential drive cannot move sideways and ignores `vy` of a command."""
    speed: Annotated[float, Meta(gt=0, le=10)]
    """The highest, m/s, forward and backward; omnidirectional: in every direction."""
    acceleration: Annotated[float, Meta(gt=0, le=100)]
    """The highest, speeding up and braking, m/s²; times the mass it is the force the drive can push with."""
    turn_rate: Annotated[float, Meta(gt=0, le=30)]
    """The highest, rad/s."""
    turn_acceleration: Annotated[float, Meta(gt=0, le=300)]
    """The highest, rad/s²."""
    grip: Annotated[float, Meta(gt=0, le=100)] = 5.0
    """Sideways acceleration at which the wheels of a differential drive begin to slide, m/s²."""
    watchdog: Annotated[float, Meta(gt=0, le=60)] = 0.5
    """The base brakes once its last command is older than this, s."""


class Bumper(Settings, frozen=True):
    """A contact bumper round the front in three sectors: right, centre, left."""

    centre_deg: _Angle
    """The centre sector reaches so far to either side of straight ahead, degrees."""
    reach_deg: _Angle
    """The side sectors end so far from straight ahead, degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reach_deg < self.centre_deg:
            raise RuleError(
                f"have a reach_deg of at least centre_deg, not {self.reach_deg:g} and {self.centre_deg:g}"
            )


class RangeSensor(Settings, frozen=True, kw_only=True):
    """A planar range sensor: a lidar, or a depth camera read as one."""

    x: _Offset = 0.0
    """Where it sits on the body, m forward of the origin."""
    y: _Offset = 0.0
    """The same, m to the left."""
    heading_deg: Annotated[float, Meta(gt=-180, le=180)] = 0.0
    """Where the middle of its view points, degrees counter-clockwise from straight ahead."""
    field_of_view_deg: Annotated[float, Meta(gt=0, le=360)]
    """Angle between the first and the last ray, or the full circle, degrees."""
    rays: Annotated[int, Meta(ge=2, le=10_000)]
    """Rays per sweep, at equal angles."""
    range_min: _Range = 0.0
    """Whatever is nearer gives no echo, but hides what is behind it, m."""
    range_max: Annotated[float, Meta(gt=0, le=60)]
    """Whatever is farther gives no echo, m."""
    rate: Annotated[float, Meta(gt=0, le=1000)]
    """Sweeps per second, Hz."""
    noise: _Noise = 0.0
    """Standard deviation of a range, m."""
    noise_growth: _Noise = 0.0
    """Adds so much times the square of the range to the standard deviation, 1/m."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.range_max <= self.range_min:
            raise RuleError(
                f"have a range_max above range_min, not {self.range_max:g} m and {self.range_min:g} m"
            )

    @property
    def mount(self) -> Pose:
        """The sensor's pose in the body's frame."""
        return Pose(self.x, self.y, math.radians(self.heading_deg))

    @property
    def period(self) -> Duration:
        """Time from one sweep to the next."""
        return seconds(1 / self.rate)

    @property
    def full_circle(self) -> bool:
        """True where the rays go all the way round."""
        return self.field_of_view_deg == 360

    @property
    def increment(self) -> float:
        """Angle from one ray to the next, rad."""
        view = math.radians(self.field_of_view_deg)
        return view / self.rays if self.full_circle else view / (self.rays - 1)

    @property
    def first_angle(self) -> float:
        """Direction of the first ray in the sensor's own frame, rad; the others follow counter-clockwise.

        The view is symmetrical. A full circle ends with the ray pointing backward, which stands once only.
        """
        half = math.radians(self.field_of_view_deg) / 2
        return self.increment - half if self.full_circle else -half


class RobotModel(Settings, frozen=True, kw_only=True):
    """A kind of robot, as its file describes it, with one of its range sensors mounted."""

    name: Text
    mass: Annotated[float, Meta(gt=0, le=10_000)]
    """kg, centred at the body's origin."""
    friction: _Noise
    """Coefficient of the body sliding along a wall; between two robots the product of both."""
    odometry: OdometryKind
    """Model of odometry errors unless a scenario names another one."""
    default_sensor: str
    """Name of the mounted sensor."""
    footprint: Footprint
    drive: DriveParameters
    bumper: Bumper | None = None
    sensors: Annotated[dict[str, RangeSensor], Meta(min_length=1)]
    """By name."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.odometry == "kobuki" and self.drive.kind != "differential":
            raise RuleError("have a differential drive where odometry is 'kobuki', which reads two wheels")

    @property
    def sensor(self) -> RangeSensor:
        """The mounted sensor."""
        return self.sensors[self.default_sensor]

    def with_sensor(self, **changes: float) -> "RobotModel":
        """Return the model with these properties of its mounted sensor changed."""
        sensor = msgspec.structs.replace(self.sensor, **changes)
        return msgspec.structs.replace(self, sensors={**self.sensors, self.default_sensor: sensor})


class RobotDescription(Settings, frozen=True):
    """One robot, as fleet, world, base and the robot itself have it."""

    id: Annotated[str, Meta(pattern=r"\A[A-Za-z0-9_-]{1,32}\Z")]
    model: Model
    """Name of a shipped robot model, or the path of a model file."""
    sensor: SensorName | None
    """The mounted sensor of the model's; None: the model's own choice."""
    start: StartPose
    """x, y in m and heading in rad at switch-on, map frame."""
    places: Places
    """The places that it has to clean, in this order, m, map frame."""


def scan_angles(sensor: RangeSensor) -> NDArray[np.float64]:
    """Directions of the rays in the body's frame: (rays,), rad in (−π, π], in the order of a scan."""
    half = math.radians(sensor.field_of_view_deg) / 2
    angles = sensor.mount.heading + np.linspace(sensor.first_angle, half, sensor.rays)
    wrapped: NDArray[np.float64] = math.pi - np.mod(math.pi - angles, math.tau)
    return wrapped


def load_model(name_or_path: str, sensor: str | None = None) -> RobotModel:
    """The robot model of that name (`turtlebot2`) or in that .toml file, with that sensor mounted.

    Without `sensor` the file's default is taken. Anything wrong is a AcrcError.
    """
    name, text = _read(name_or_path)
    model = settings.parse(text, RobotModel, name)
    mounted = model.default_sensor if sensor is None else sensor
    if mounted not in model.sensors:
        asked = "default_sensor" if sensor is None else "the sensor"
        right = wording.one_of(sorted(model.sensors))
        raise AcrcError(f"{name}: {asked} is {wording.shown(mounted)}, but must be {right}")
    return msgspec.structs.replace(model, default_sensor=mounted)


def _read(name_or_path: str) -> tuple[str, str]:
    """Return the model file's name in sentences, and its text."""
    shipped = resources.files("actors.models")
    known = sorted(file.name[:-5] for file in shipped.iterdir() if file.name.endswith(".toml"))
    if name_or_path in known:
        return f"{name_or_path}.toml", shipped.joinpath(f"{name_or_path}.toml").read_text("utf-8")
    if not name_or_path.endswith(".toml"):
        right = f"{', '.join(map(wording.shown, known))} or the path of a .toml file"
        raise AcrcError(f"the robot model is {wording.shown(name_or_path)}, but must be {right}")
    return name_or_path, settings.read_text(Path(name_or_path), "robot model")
