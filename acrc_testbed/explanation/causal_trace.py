"""The causal trace of one process of a robot: every change of its knowledge, and what each came from.

A replay makes it, in a process that runs the strategy's code; so its bytes are checked against these types.
"""

from typing import Annotated

import msgspec

from actors.instant import LATEST, Duration, Instant, in_seconds
from actors.introspection import DecisionRecord, GoalState, ValueChange
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError, printable

Moment = Annotated[Instant, msgspec.Meta(ge=0, le=LATEST)]
"""By the process's own time, µs."""
Span = Annotated[Duration, msgspec.Meta(ge=0, le=LATEST)]
"""µs."""
Number = Annotated[int, msgspec.Meta(ge=0, le=LATEST)]
"""A step, or a count."""
Place = tuple[float, float]
"""x, y, m, map frame."""


class TraceError(AcrcError):
    """A trace that cannot be made, or makes no sense."""


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
    """Short address of the transceiver that sent it: the peer's own, or a relaying robot's."""
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
    changed: tuple[ValueChange, ...]
    fields: dict[str, FieldChange]
    """The same by field of the component."""
    own: tuple[str, ...]
    """The component's fields that it depends on, as far as the source tells."""
    read: ReplicaRead | None
    """The replica that it used; None for a process, and for a peer on the same node."""
    decision: DecisionRecord | None = None


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
    goal: GoalState | None
    """How navigation's last goal stood before."""
    moved: tuple[Number, ...] = ()
    """The changes of knowledge that brought its point, or took it away, newest first."""


class CausalTrace(msgspec.Struct, frozen=True):
    """What one process of a robot knew, heard and ordered."""

    changes: tuple[KnowledgeChange, ...]
    news: tuple[ReplicaNews, ...]
    orders: tuple[Order, ...]
    has_nodes: bool
    """False: the behaviour is without the component model, or no node has begun."""
    fault: str | None = None
    """Why it could not be followed to its end."""


def decode(data: bytes, actor: str) -> CausalTrace:
    """Return the trace in the answer for an actor. Raises TraceError for what is none."""
    try:
        return typed_json.decode(data, CausalTrace, form=msgspec.msgpack)
    except (ValueError, TypeError) as error:
        raise TraceError(f"{actor}: its trace makes no sense: {printable(str(error))}") from None


def seconds(instant: Instant) -> str:
    """Return an instant as people read it, s."""
    return f"{in_seconds(instant):.3f}".rstrip("0").rstrip(".")
