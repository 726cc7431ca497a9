"""Robot models: one TOML file each says what a robot's body, drive and sensors are, to world and robot."""

import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from actors import table_wording, toml_file, wording
from actors.floor import convex
from actors.geometry import Pose
from actors.instant import Duration, seconds
from actors.portable import hypot
from actors.runtime.errors import AcrcError
from actors.table import FileTable, Right, Text, as_tuples

OdometryKind = Literal["exact", "stage", "kobuki"]


Vertices = Annotated[
    tuple[Annotated[tuple[float, float], BeforeValidator(as_tuples)], ...], BeforeValidator(as_tuples)
]
_A_POLYGON = Right("3 to 32 points [x, y] in m", item="a point [x, y] in m")


class Footprint(FileTable):
    """The body's outline on the floor: either a disc or a convex polygon round the body's origin."""

    radius: float | None = Field(None, gt=0, le=5)
    """Of a disc, m."""
    vertices: Annotated[Vertices | None, _A_POLYGON] = Field(None, min_length=3, max_length=32)
    """Of a polygon, m in the body's frame; counter-clockwise once read."""

    @model_validator(mode="after")
    def _one_shape(self) -> "Footprint":
        if (self.radius is None) == (self.vertices is None):
            raise ValueError(
                f"hold either radius or vertices, but has {'none' if self.radius is None else 'both'}"
            )
        if self.vertices is not None:
            if fault := convex.fault(self.vertices):
                raise ValueError(f"hold the vertices of a convex polygon round (0, 0), but {fault}")
            object.__setattr__(self, "vertices", convex.counter_clockwise(self.vertices))
        return self

    @property
    def circumradius(self) -> float:
        """Of the smallest disc round the body's origin that holds the body, m."""
        if self.radius is not None:
            return self.radius
        return max(hypot(x, y) for x, y in self.vertices or ())

    @property
    def inradius(self) -> float:
        """Of the largest disc round the body's origin within the body, m."""
        if self.radius is not None:
            return self.radius
        assert self.vertices is not None
        return convex.distance_to_border(self.vertices)


class DriveParameters(FileTable):
    """How the body moves on its wheels."""

    kind: Literal["differential", "omnidirectional"]
    """A differential drive cannot move sideways and ignores `vy` of a command."""
    speed: float = Field(gt=0, le=10)
    """The highest, m/s, forward and backward; omnidirectional: in every direction."""
    acceleration: float = Field(gt=0, le=100)
    """The highest, speeding up and braking, m/s²; times the mass it is the force the drive can push with."""
    turn_rate: float = Field(gt=0, le=30)
    """The highest, rad/s."""
    turn_acceleration: float = Field(gt=0, le=300)
    """The highest, rad/s²."""
    grip: float = Field(5.0, gt=0, le=100)
    """Sideways acceleration at which the wheels of a differential drive begin to slide, m/s²."""
    watchdog: float = Field(0.5, gt=0, le=60)
    """The base brakes once its last command is older than this, s."""


class Bumper(FileTable):
    """A contact bumper round the front in three sectors: right, centre, left."""

    centre_deg: float = Field(gt=0, le=180)
    """The centre sector reaches so far to either side of straight ahead, degrees."""
    reach_deg: float = Field(gt=0, le=180)
    """The side sectors end so far from straight ahead, degrees."""

    @model_validator(mode="after")
    def _ordered(self) -> "Bumper":
        if self.reach_deg < self.centre_deg:
            raise ValueError(
                f"have a reach_deg of at least centre_deg, not {self.reach_deg:g} and {self.centre_deg:g}"
            )
        return self


class RangeSensor(FileTable):
    """A planar range sensor: a lidar, or a depth camera read as one."""

    x: float = Field(0.0, ge=-5, le=5)
    """Where it sits on the body, m forward of the origin."""
    y: float = Field(0.0, ge=-5, le=5)
    """The same, m to the left."""
    heading_deg: float = Field(0.0, gt=-180, le=180)
    """Where the middle of its view points, degrees counter-clockwise from straight ahead."""
    field_of_view_deg: float = Field(gt=0, le=360)
    """Angle between the first and the last ray, or the full circle, degrees."""
    rays: int = Field(ge=2, le=10_000)
    """Rays per sweep, at equal angles."""
    range_min: float = Field(0.0, ge=0, le=60)
    """Whatever is nearer gives no echo, but hides what is behind it, m."""
    range_max: float = Field(gt=0, le=60)
    """Whatever is farther gives no echo, m."""
    rate: float = Field(gt=0, le=1000)
    """Sweeps per second, Hz."""
    noise: float = Field(0.0, ge=0, le=10)
    """Standard deviation of a range, m."""
    noise_growth: float = Field(0.0, ge=0, le=10)
    """Adds so much times the square of the range to the standard deviation, 1/m."""

    @model_validator(mode="after")
    def _ordered(self) -> "RangeSensor":
        if self.range_max <= self.range_min:
            raise ValueError(
                f"have a range_max above range_min, not {self.range_max:g} m and {self.range_min:g} m"
            )
        return self

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


class _ModelFile(FileTable):
    name: Text
    mass: float = Field(gt=0, le=10_000)
    friction: float = Field(ge=0, le=10)
    odometry: OdometryKind
    default_sensor: str
    footprint: Footprint
    drive: DriveParameters
    bumper: Bumper | None = None
    sensors: dict[str, RangeSensor] = Field(min_length=1)

    @model_validator(mode="after")
    def _consistent(self) -> "_ModelFile":
        if self.odometry == "kobuki" and self.drive.kind != "differential":
            raise ValueError("have a differential drive where odometry is 'kobuki', which reads two wheels")
        return self


@dataclass(frozen=True)
class RobotModel:
    """A kind of robot with the range sensor that is mounted on it."""

    name: str
    footprint: Footprint
    mass: float
    """kg, centred at the body's origin."""
    friction: float
    """Coefficient of the body sliding along a wall; between two robots the product of both."""
    drive: DriveParameters
    bumper: Bumper | None
    odometry: OdometryKind
    """Which model of odometry errors the robot has unless a scenario says otherwise."""
    sensor_name: str
    sensor: RangeSensor


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
    file = table_wording.parse(text, _ModelFile, name)
    mounted = file.default_sensor if sensor is None else sensor
    if mounted not in file.sensors:
        asked = "default_sensor" if sensor is None else "the sensor"
        right = wording.one_of(sorted(file.sensors))
        raise AcrcError(f"{name}: {asked} is {wording.shown(mounted)}, but must be {right}")
    return RobotModel(
        name=file.name,
        footprint=file.footprint,
        mass=file.mass,
        friction=file.friction,
        drive=file.drive,
        bumper=file.bumper,
        odometry=file.odometry,
        sensor_name=mounted,
        sensor=file.sensors[mounted],
    )


def _read(name_or_path: str) -> tuple[str, str]:
    """What to call the model file in a sentence, and its text."""
    shipped = resources.files("actors.models")
    known = sorted(file.name[:-5] for file in shipped.iterdir() if file.name.endswith(".toml"))
    if name_or_path in known:
        return f"{name_or_path}.toml", shipped.joinpath(f"{name_or_path}.toml").read_text("utf-8")
    if not name_or_path.endswith(".toml"):
        right = f"{', '.join(map(wording.shown, known))} or the path of a .toml file"
        raise AcrcError(f"the robot model is {wording.shown(name_or_path)}, but must be {right}")
    return name_or_path, toml_file.read(Path(name_or_path), "robot model")
