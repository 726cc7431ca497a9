"""What a robot's log holds, whatever the form in which it is written: contents, topics and entries.

Frames are those of REP 105: `map`, and of each robot `rN/odom`, `rN/base_link` and `rN/laser`; `rN/truth` is
where its base truly was. Lengths are in m, angles in rad.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.observer.colours import Colour
from actors.robot_model import RangeSensor

Points = NDArray[np.float32]
"""(n, 2): x and y, m."""
MAP: Final = "map"
"""The frame of the floor plan."""
UNKNOWN_CELL: Final = -1
"""In a grid: nobody knows. Else 0 is free, and 100 blocks."""


class Transform(NamedTuple):
    """Where a frame is in its parent's."""

    parent: str
    child: str
    pose: Pose


class Transforms(NamedTuple):
    """Where some frames are."""

    every: tuple[Transform, ...]


class PlacedPose(NamedTuple):
    """A pose in a frame."""

    frame: str
    pose: Pose


class PlacedMotion(NamedTuple):
    """A pose in a frame, and the velocity of what is there, in its own frame, m/s and rad/s."""

    frame: str
    child: str
    pose: Pose
    vx: float
    vy: float
    omega: float


class LoggedCommand(NamedTuple):
    """A commanded velocity in the frame of the base, m/s and rad/s."""

    vx: float
    vy: float
    omega: float


@dataclass(frozen=True, eq=False)
class LoggedScan:
    """One scan."""

    frame: str
    sensor: RangeSensor
    ranges: NDArray[np.float32]
    """(rays,), m, counter-clockwise; inf: nothing within range."""


@dataclass(frozen=True, eq=False)
class LoggedPlan:
    """A way along points of the map; none: it was dropped."""

    points: Points


@dataclass(frozen=True, eq=False)
class PointSet:
    """Points of the map."""

    points: Points


@dataclass(frozen=True, eq=False)
class Grid:
    """Square cells, 0 to 100 or UNKNOWN_CELL."""

    corner: Pose
    """Of the cell in row 0 and column 0, map frame; columns go along its x, rows along its y."""
    cell: float
    """Side of a cell, m."""
    values: NDArray[np.int8]
    """(rows, columns)"""


class Disc(NamedTuple):
    """An upright cylinder that stands on the floor."""

    x: float
    y: float
    radius: float
    height: float


class LineList(NamedTuple):
    """Straight lines, each between two points that follow one another."""

    points: tuple[tuple[float, float], ...]
    width: float


class Label(NamedTuple):
    """Words above a point."""

    x: float
    y: float
    text: str
    size: float


class MarkedShape(NamedTuple):
    """Something to be drawn."""

    name: str
    """Its own within the scene."""
    form: Disc | LineList | Label
    colour: Colour
    opacity: float = 1.0
    frame: str = MAP
    """It goes along with that frame."""


class MarkedScene(NamedTuple):
    """All that is drawn by one topic from an instant on, in place of what was before."""

    shapes: tuple[MarkedShape, ...]


class RobotWords(NamedTuple):
    """What a robot says of itself."""

    robot: str
    text: str


Content = (
    Transforms
    | PlacedPose
    | PlacedMotion
    | LoggedCommand
    | LoggedScan
    | LoggedPlan
    | PointSet
    | Grid
    | MarkedScene
    | RobotWords
)

KINDS: Final[dict[str, type[Content]]] = {
    "tf": Transforms,
    "tf_static": Transforms,
    "map": Grid,
    "places": MarkedScene,
    "robots": MarkedScene,
    "things": MarkedScene,
    "links": MarkedScene,
    "rosout": RobotWords,
    "truth": PlacedPose,
    "pose": PlacedPose,
    "goal": PlacedPose,
    "odom": PlacedMotion,
    "cmd_vel": LoggedCommand,
    "scan": LoggedScan,
    "plan": LoggedPlan,
    "particles": PointSet,
    "local_costmap": Grid,
}
"""What each topic holds, by the last part of its name."""
LATCHED: Final = frozenset({"tf_static", "map", "places", "robots", "things"})
"""Who comes later is given the last message of these."""


class LogEntry(NamedTuple):
    """One message of the log."""

    logged: int
    """When it is logged, µs of the run."""
    topic: str
    """Such as `/map` or `/r1/scan`."""
    content: Content | bytes
    """Bytes: it has its form already."""
    stamp: int
    """Of which instant it tells, µs."""


class Schema(NamedTuple):
    """How readers of the file take messages of one kind apart."""

    name: str
    encoding: str
    data: bytes


class LogForm(Protocol):
    """A form in which messages are written."""

    @property
    def profile(self) -> str:
        """The file's, as the MCAP specification names it; empty: none."""

    @property
    def encoding(self) -> str:
        """Of messages."""

    @property
    def about(self) -> dict[str, dict[str, str]]:
        """Metadata of the file, by the record's name."""

    def schema(self, kind: type[Content]) -> Schema:
        """The schema of one kind of content."""

    def channel(self, *, latched: bool) -> dict[str, str]:
        """Metadata of a topic."""

    def encode(self, content: Content, stamp: int) -> bytes:
        """The message of that instant, µs."""


def last_part(topic: str) -> str:
    """The key of KINDS and LATCHED."""
    return topic.rpartition("/")[2]


def flat(points: Points) -> bytes:
    """Points as float32 triples, little-endian, with z = 0."""
    return np.pad(points.astype("<f4"), ((0, 0), (0, 1))).tobytes()


def entry(microseconds: float, topic: str, content: Content) -> LogEntry:
    """A message that is logged at the instant of which it tells."""
    instant = round(microseconds)
    return LogEntry(instant, topic, content, instant)
