"""What a robot computed, in messages that only its own recording has: one per PERIOD, and one at its end.

Only changes are there. Arrays are bytes, little-endian. What the recording says elsewhere is not repeated:
the estimated pose is that of Drive, ranges and instants of steps are those of Senses.
"""

from typing import Final

from actors.instant import milliseconds
from actors.topic import Message, MessagePart

PERIOD: Final = milliseconds(500)
"""Between two messages: as often as a person can follow."""


class EstimateQuality(MessagePart, frozen=True):
    """How far the robot trusts its estimate."""

    covariance: tuple[float, ...]
    """3 x 3, row by row: x, y, m, and heading, rad, map frame."""
    lost: float
    """Probability that it is somewhere else altogether."""
    located: bool
    """False: it looks for itself; then Drive has no pose."""


class CostWindow(MessagePart, frozen=True):
    """The local cost map that navigation steers by: `CostMap.restore` has all costs from it."""

    corner: tuple[int, int]
    """Column and row of its south-west corner, cells from the origin of the odometry frame."""
    side: int
    """Rows and columns."""
    marked: bytes
    """Indices of the marked cells, row by row, the southernmost row first; uint16, uint32 where there are
    more than 65 536 cells."""


class PerceptionSample(MessagePart, frozen=True):
    """What the robot perceived and planned, sampled with each message but the last."""

    scanned: tuple[float, float, float] | None
    """Pose of the body at the last scan, x, y, m, heading, rad, odometry frame; None: no scan yet."""
    particles: bytes | None
    """float32, x and y of at most 300 particles, m, map frame; None: as before, or there are none."""
    plan: bytes | None
    """float32, x and y of every fourth point of the plan and of its last, m, map frame; empty: it has none;
    None: as before."""
    window: CostWindow | None
    """None: navigation has not steered since the last sample."""


class Activity(MessagePart, frozen=True):
    """What the robot is doing from this step on."""

    activity: str
    """One of `actors.robot.introspection.ACTIVITIES`."""
    destination: str
    """Place that it heads for, as in "r1/3"; empty: none."""
    point: tuple[float, float] | None
    """Its goal, m, map frame."""


class GoalState(MessagePart, frozen=True):
    """State of navigation's goal at the end of this step."""

    point: tuple[float, float] | None
    """None: it has no goal."""
    status: str | None = None
    reason: str | None = None
    phase: str | None = None


class ValueChange(MessagePart, frozen=True):
    """A part of a component's knowledge with two values, as JSON."""

    path: str
    """Such as `destination`, `parameters.speed`, or `bids[r2]` in a mapping."""
    before: str | None
    """None: the mapping had no such key; empty: what it became with this path's last change."""
    after: str | None


class ReplicaUse(MessagePart, frozen=True):
    """The replica of a peer's component that an ensemble used."""

    epoch: int
    """Of the peer's node when it published this."""
    publication: int
    """Number of the publication, counted from 1 in that epoch."""
    heard: int
    """When it had come, µs."""
    hops: int
    """How often it had been relayed."""
    rssi_dbm: float | None
    """None: it did not come by radio."""


class DecisionRecord(MessagePart, frozen=True):
    """What a change of knowledge decided, by the component's own account."""

    words: str
    old: tuple[float, float] | None
    """Where it wanted to be before, m, map frame; None: nowhere."""
    new: tuple[float, float] | None


class KnowledgeCommit(MessagePart, frozen=True):
    """One change of one component's knowledge."""

    instant: int
    component: str
    by: str
    """The process or the ensemble's exchange, `CleaningRobot.sense` or `DestinationAdoption.at_member`."""
    adaptation: bool
    """True of an ensemble, and of a process of the adaptation layer."""
    peer: str
    """The component whose knowledge an ensemble used; empty for a process."""
    age: int
    """How old that was, µs; 0 for a process, and for a peer on the same node."""
    changed: tuple[ValueChange, ...]
    replica: ReplicaUse | None = None
    """None for a process, and for a peer on the same node."""
    decision: DecisionRecord | None = None


class StepRecord(MessagePart, frozen=True):
    """What changed in one step."""

    step: int
    quality: EstimateQuality | None = None
    pose: tuple[float, float, float] | None = None
    """The estimate while the robot is not located, x, y, m, heading, rad, map frame."""
    activity: Activity | None = None
    goal: GoalState | None = None
    contacts: tuple[tuple[str, int | None], ...] = ()
    """Peers of which the node has a new replica, and when that came, µs; None: it is forgotten."""
    commits: tuple[KnowledgeCommit, ...] = ()


class Introspection(Message, frozen=True):
    """What a robot computed since its last message, up to and including the message's step."""

    steps: tuple[StepRecord, ...] = ()
    """Of steps in which nothing changed there is none."""
    sample: PerceptionSample | None = None
    knowledge: tuple[tuple[str, str], ...] = ()
    """Names and values, in words, of the fields of its knowledge that changed; sampled."""
