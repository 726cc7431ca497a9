"""Introspection messages: a robot's internal state, only in its own recording, every PERIOD and at the end.

Only changes are recorded; arrays are little-endian bytes. The estimated pose is in Drive; ranges and instants
of steps are in SensorData.
"""

from typing import Final

from actors.instant import milliseconds
from actors.topic import Message, MessagePart

PERIOD: Final = milliseconds(500)
"""Interval between two messages; own choice: fast enough for human viewers."""


class EstimateQuality(MessagePart, frozen=True):
    """Uncertainty of the pose estimate."""

    covariance: tuple[float, ...]
    """3 x 3 matrix, row by row: x, y, m, and heading, rad, map frame."""
    lost: float
    """Probability that the robot is far from the estimate."""
    located: bool
    """False during global localisation; Drive then has no pose."""


class CostWindow(MessagePart, frozen=True):
    """Local cost map of the navigation, compressed; `CostMap.restore` computes all costs."""

    corner: tuple[int, int]
    """Column and row of the south-west corner, in cells from the origin of the odometry frame."""
    side: int
    """Number of rows and of columns."""
    marked: bytes
    """Indices of the marked cells, row by row from the south: uint16; uint32 for more than 65 536 cells."""


class PerceptionSample(MessagePart, frozen=True):
    """Sampled perception and plan; in every message except the last."""

    scanned: tuple[float, float, float] | None
    """Body pose at the last scan: x, y, m, heading, rad, odometry frame; None: no scan yet."""
    particles: bytes | None
    """float32 x and y of up to 300 particles, m, map frame; None: unchanged, or no particles."""
    plan: bytes | None
    """float32 x and y of every fourth plan point and the last, m, map frame; empty: no plan; None: as
    before."""
    window: CostWindow | None
    """None: navigation has not commanded a velocity since the last sample."""


class Activity(MessagePart, frozen=True):
    """The robot's activity from this step on."""

    activity: str
    """One of `actors.robot.introspector.ACTIVITIES`."""
    destination: str
    """Item of the task that it drives to, such as "r1/3"; empty: none."""
    point: tuple[float, float] | None
    """Its goal, m, map frame."""


class GoalState(MessagePart, frozen=True):
    """State of the navigation goal at the end of this step."""

    point: tuple[float, float] | None
    """None: it has no goal."""
    status: str | None = None
    reason: str | None = None
    phase: str | None = None


class ValueChange(MessagePart, frozen=True):
    """A changed part of a component's knowledge, as JSON."""

    path: str
    """Path such as `destination`, `parameters.speed`, or `bids[r2]` for a mapping."""
    before: str | None
    """None: the key is new; empty: the value after this path's previous change."""
    after: str | None


class ReplicaUse(MessagePart, frozen=True):
    """The peer's replica that an ensemble used."""

    epoch: int
    """Epoch of the peer's node at publication."""
    publication: int
    """Number of the publication in that epoch, from 1."""
    heard: int
    """Arrival time, µs."""
    hops: int
    """Number of relays on its route."""
    rssi_dbm: float | None
    """None: not received by radio."""


class DecisionRecord(MessagePart, frozen=True):
    """A decision in a knowledge change, as reported by the component."""

    words: str
    old: tuple[float, float] | None
    """Previous destination, m, map frame; None: none."""
    new: tuple[float, float] | None


class KnowledgeCommit(MessagePart, frozen=True):
    """One change to a component's knowledge."""

    instant: int
    component: str
    by: str
    """The process or ensemble exchange, such as `CleaningRobot.sense` or `DestinationAdoption.at_member`."""
    adaptation: bool
    """True for an ensemble or a process of the adaptation layer."""
    peer: str
    """Component whose knowledge an ensemble used; empty for a process."""
    age: int
    """Age of that knowledge, µs; 0 for a process, or a peer on the same node."""
    changed: tuple[ValueChange, ...]
    replica: ReplicaUse | None = None
    """None for a process, or a peer on the same node."""
    decision: DecisionRecord | None = None


class StepRecord(MessagePart, frozen=True):
    """Changes in one step."""

    step: int
    quality: EstimateQuality | None = None
    pose: tuple[float, float, float] | None = None
    """Pose estimate during global localisation: x, y, m, heading, rad, map frame."""
    activity: Activity | None = None
    goal: GoalState | None = None
    contacts: tuple[tuple[str, int | None], ...] = ()
    """Peers with a new replica at the node, and its arrival, µs; None: the replica was dropped."""
    commits: tuple[KnowledgeCommit, ...] = ()


class Introspection(Message, frozen=True):
    """Internal state of a robot since its last message, up to and including the message's step."""

    steps: tuple[StepRecord, ...] = ()
    """Steps without changes are omitted."""
    sample: PerceptionSample | None = None
    knowledge: tuple[tuple[str, str], ...] = ()
    """Names and values, as text, of knowledge fields that changed; sampled."""
