"""The rows and arrays of a trace: what one process of a robot perceived, meant, knew and decided.

Whoever's code ran wrote them, so nothing is believed of them but what their types and sizes say.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Annotated, Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.instant import Duration, Instant, in_seconds
from actors.runtime.errors import printable
from actors.task.task import PlaceKey
from deeco import Knowledge

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Whole = NDArray[np.int64]

VERSION: Final = 2
"""Of what follows: a trace of another one is made anew."""
_LATEST: Final = 10**15
"""µs; nobody lives to see more."""
Moment = Annotated[Instant, msgspec.Meta(ge=0, le=_LATEST)]
"""By the process's own time, µs."""
Span = Annotated[Duration, msgspec.Meta(ge=0, le=_LATEST)]
"""µs."""
Number = Annotated[int, msgspec.Meta(ge=0, le=_LATEST)]
"""A step, or a count."""
Place = tuple[float, float]
"""x, y, m, map frame."""

ACTIVITIES: Final = (
    "driving", "planning", "no trajectory", "backing out", "blocked", "adopted", "elsewhere", "paused",
    "aborted", "idle",
)  # fmt: skip
"""What a robot may be about. "adopted": it drives to a place that was another's; "elsewhere": to a point that
is nobody's place; "no trajectory": navigation has a way, and nothing to follow it with; "blocked": it holds
itself to be; "aborted": navigation has given up; "idle": there is nothing that it wants."""


class Doing(msgspec.Struct, frozen=True):
    """What a robot is about, from an instant on."""

    instant: Moment
    activity: str
    """One of ACTIVITIES."""
    destination: str = ""
    """Where it heads for, as in "r1/3"; empty if for nowhere, or nobody's place."""
    point: Place | None = None
    """The same in m, map frame."""


class Known(msgspec.Struct, frozen=True):
    """The component's knowledge as rows of a table, from an instant on."""

    instant: Moment
    rows: tuple[tuple[str, str], ...]


class ReplicaContact(msgspec.Struct, frozen=True):
    """A replica that the node has from an instant on, or has no longer."""

    instant: Moment
    peer: str
    heard: Moment | None
    """When it had come, µs; None: it is forgotten."""


class Ragged(msgspec.Struct, frozen=True):
    """Rows of different lengths: points, (k, 2), m."""

    counts: Whole
    """(n,)"""
    values: Singles
    """(sum of counts, 2)"""

    def rows(self) -> list[Singles]:
        """One array a row."""
        return np.split(self.values, np.cumsum(self.counts)[:-1]) if len(self.counts) else []


class Held(msgspec.Struct, frozen=True):
    """Where the robot held itself to be when each of its steps began."""

    steps: Whole
    """(e,)"""
    poses: Floats
    """(e, 3): x, y, m, and heading, rad, map frame."""
    located: NDArray[np.bool_]
    """(e,)"""
    variances: Floats
    """(e, 3): of x and y, m², and of the heading, rad²."""
    lost: Floats
    """(e,): probability that it is somewhere else altogether."""


class GoalChange(msgspec.Struct, frozen=True):
    """How navigation's goal stands from a step on."""

    step: Number
    point: Place | None
    """None: it has none."""
    status: str | None = None
    reason: str | None = None
    phase: str | None = None


class Changed(msgspec.Struct, frozen=True):
    """A part of knowledge with two values, as JSON."""

    path: str
    """Such as `destination`, `parameters.speed`, or `bids[r2]` in a mapping."""
    before: str | None
    """None: the mapping had no such key."""
    after: str | None


class FieldChange(msgspec.Struct, frozen=True):
    """A field of the component in which something has changed, in words."""

    before: str
    after: str
    direction: Annotated[int, msgspec.Meta(ge=-1, le=1)] = 0
    """1: a number became more; -1: less; 0: it was none."""
    is_place: bool = False
    """It is a point or a pose now."""


class Arrival(msgspec.Struct, frozen=True):
    """The frame that made a replica's packet whole; earlier frames may have brought other parts of it."""

    step: Number
    """In which the robot got it from its transceiver."""
    instant: Moment
    """When its last symbol ended."""
    sender: int
    """Short address of the transceiver that sent it: the peer's own, or of whoever relayed."""
    rssi_dbm: float
    lqi: int


class ReplicaRead(msgspec.Struct, frozen=True):
    """What a robot knew of a peer's component."""

    component: str
    epoch: Number
    """Of the peer's node, when it published this ..."""
    publication: Number
    """... and its number, counted from 1 in that epoch."""
    heard: Moment
    age: Span
    """How long ago that was when it was read."""
    hops: Number
    """How often it had been relayed."""
    rssi_dbm: float | None
    """None: it did not come by radio."""
    arrival: Arrival | None
    """None where the recording has no such frame."""
    known: dict[str, str]
    """What was read of it, by field, in words."""


class KnowledgeDecision(msgspec.Struct, frozen=True):
    """What a change of knowledge decided, by the component's own account."""

    words: str
    old: Place | None
    """Where it wanted to be before; None: nowhere."""
    new: Place | None


class KnowledgeChange(msgspec.Struct, frozen=True):
    """One change of one component's knowledge."""

    step: Number
    instant: Moment
    component: str
    by: str
    """The process or the ensemble's exchange, `CleaningRobot.sense` or `DestinationAdoption.at_member`."""
    adaptation: bool
    """True of an ensemble, and of a process of the adaptation layer."""
    peer: str
    """The component whose knowledge an ensemble used; empty for a process."""
    age: Span
    """How old that was; 0 for a process, and for a peer on the same node."""
    changed: tuple[Changed, ...]
    fields: dict[str, FieldChange]
    """The same by field of the component."""
    own: tuple[str, ...]
    """The component's fields that it depends on, as far as the source tells."""
    read: ReplicaRead | None
    """The replica that it used; None for a process, and for a peer on the same node."""
    decision: KnowledgeDecision | None = None


class ReplicaNews(msgspec.Struct, frozen=True):
    """A newer replica of a peer's component, and when it had come."""

    peer: str
    heard: Moment


class Order(msgspec.Struct, frozen=True):
    """Something that a behaviour wanted its robot to do from a step on."""

    step: Number
    instant: Moment
    """The step's start, or when the behaviour says that it was."""
    words: str
    verb: str
    """What kind of order it is: the first of the words."""
    point: Place | None
    """Where to; of `STOPS`, where it had been heading for."""
    goal: GoalChange | None
    """How navigation's last goal stood before."""
    moved: tuple[Number, ...] = ()
    """The changes of knowledge that brought its point, or took it away, newest first."""


class Trace(msgspec.Struct, frozen=True):
    """One process of a robot, or a part of it; looked at closely at `instants`."""

    robot: str
    first_step: Number
    instants: Whole
    """(n,): µs by the robot's own time."""
    estimates: Floats
    """(n, 3): x, y, m, and heading, rad, map frame."""
    covariances: Floats
    """(n, 3): of x, of x and y, of y, m²."""
    lost: Floats
    """(n,): probability that it is somewhere else altogether."""
    scans: Ragged
    """n rows: where the last sweep met something, map frame by the estimate."""
    particles_at: Whole
    """(m,): when they changed, µs ..."""
    particles: Ragged
    """... and m rows."""
    plans_at: Whole
    plans: Ragged
    """A row for each plan; an empty one where it was dropped."""
    twists: Floats
    """(n, 2): commanded speed, m/s, and turn rate, rad/s: the chosen arc."""
    cell: float
    """Of the local cost map, m."""
    costs_at: Whole
    """(c,): when navigation has steered by it, µs."""
    costs: NDArray[np.uint8]
    """(c, rows, columns): as costmap_2d has them, row 0 the southernmost."""
    corners: Floats
    """(c, 3): pose of the window's south-west corner, map frame."""
    doings: tuple[Doing, ...]
    knowledge: tuple[Known, ...]
    contacts: tuple[ReplicaContact, ...]
    held: Held
    goals: tuple[GoalChange, ...]
    changes: tuple[KnowledgeChange, ...]
    news: tuple[ReplicaNews, ...]
    orders: tuple[Order, ...]
    has_nodes: bool
    """False: the behaviour is without the component model, or no node has begun yet."""
    fault: str | None = None
    """Why it could not be followed to its end."""

    def decisions(self) -> Iterator[tuple[KnowledgeChange, KnowledgeDecision]]:
        """The changes of knowledge that decided something."""
        for change in self.changes:
            if change.decision is not None:
                yield change, change.decision


def ragged(rows: list[Singles]) -> Ragged:
    """Rows of points, (k, 2) each, put together."""
    counts = np.array([len(row) for row in rows], np.int64)
    values = np.concatenate(rows) if rows else np.zeros((0, 2))
    return Ragged(counts, values.astype(np.float32).reshape(-1, 2))


def misfit(trace: Trace) -> str:
    """Which arrays do not fit one another; empty if all do."""
    n, c, e = len(trace.instants), len(trace.costs_at), len(trace.held.steps)
    shapes: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
        "estimates": (trace.estimates, (n, 3)),
        "covariances": (trace.covariances, (n, 3)),
        "lost": (trace.lost, (n,)),
        "twists": (trace.twists, (n, 2)),
        "corners": (trace.corners, (c, 3)),
        "held.poses": (trace.held.poses, (e, 3)),
        "held.located": (trace.held.located, (e,)),
        "held.variances": (trace.held.variances, (e, 3)),
        "held.lost": (trace.held.lost, (e,)),
    }
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            return f"{name} has the shape {array.shape}, and must have {shape}"
    for name, rows, count in (
        ("scans", trace.scans, n),
        ("particles", trace.particles, len(trace.particles_at)),
        ("plans", trace.plans, len(trace.plans_at)),
    ):
        counts = rows.counts
        if counts.shape != (count,) or rows.values.shape != (int(counts.sum()), 2) or (counts < 0).any():
            return f"{name} has not {count} rows"
    if trace.costs.ndim != 3 or len(trace.costs) != c:
        return f"costs has the shape {trace.costs.shape}, and must have {c} windows"
    unknown = {one.activity for one in trace.doings} - set(ACTIVITIES)
    return f"{sorted(unknown)} are no activities" if unknown else ""


_LONGEST: Final = 160
"""Characters of a value."""
_DEEPEST: Final = 3
"""Values within values beyond this are left out."""


def rows(knowledge: Knowledge) -> tuple[tuple[str, str], ...]:
    """Name and value of each field that says anything; parameters never change, and are left out."""
    told = []
    for field in fields(knowledge):
        if field.name != "parameters":
            text = printable(in_words(getattr(knowledge, field.name)))
            short = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
            told.append((field.name.replace("_", " "), short))
    return tuple(told)


def in_words(value: Any, deep: int = 0) -> str:
    """A value as short as it can be told: a place as "r1/3", a point by its coordinates."""
    key = value if isinstance(value, PlaceKey) else getattr(value, "key", None)
    if isinstance(key, PlaceKey):
        return f"{key.owner}/{key.place}"
    if value is None or value == ():
        return "-"
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, Enum):
        return str(value.value)
    return _composed(value, deep)


def _composed(value: Any, deep: int) -> str:
    """A value that may be made of others."""
    if is_dataclass(value):
        parts = [getattr(value, one.name) for one in fields(value)]
    elif isinstance(value, tuple | list | frozenset):
        parts = list(value)
    else:
        return str(value)
    if deep == _DEEPEST:
        return "…"
    told = [in_words(one, deep + 1) for one in parts]
    if isinstance(value, frozenset):
        told.sort()
    return (", " if is_dataclass(value) or hasattr(value, "_fields") else " ").join(told)


def seconds(instant: Instant) -> str:
    """An instant as people read it, s."""
    return f"{in_seconds(instant):.3f}".rstrip("0").rstrip(".")
