"""Causal trace of one robot process: all changes of knowledge and their sources.

A replay produces it in a process that runs the strategy's code, so its bytes are validated.
"""

from typing import Annotated

import msgspec

from actors.instant import LATEST, Duration, Instant, in_seconds
from actors.introspection import DecisionRecord, GoalState, ValueChange
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError, printable

Moment = Annotated[Instant, msgspec.Meta(ge=0, le=LATEST)]
"""Instant by the process's clock, µs."""
Span = Annotated[Duration, msgspec.Meta(ge=0, le=LATEST)]
"""µs."""
Number = Annotated[int, msgspec.Meta(ge=0, le=LATEST)]
"""A step, or a count."""
Position = tuple[float, float]
"""x, y, m, map frame."""


class TraceError(AcrcError):
    """A failed replay, or an invalid trace."""


class FieldChange(msgspec.Struct, frozen=True):
    """Change of a field of a component, as text."""

    before: str
    after: str
    direction: Annotated[int, msgspec.Meta(ge=-1, le=1)] = 0
    """1: a number increased; -1: decreased; 0: not a number."""
    is_point: bool = False
    """The new value is a point or a pose."""


class Arrival(msgspec.Struct, frozen=True):
    """The frame that completed a replica's packet; earlier frames may contain other fragments."""

    step: Number
    """Step in which the robot received the frame from its transceiver."""
    instant: Moment
    """End of its last symbol."""
    sender: int
    """Short address of the sender: the peer, or a relaying robot."""
    rssi_dbm: float
    lqi: int


class ReplicaRead(msgspec.Struct, frozen=True):
    """Replica of a peer's component, as read by a process or exchange."""

    component: str
    epoch: Number
    """Restarts of the peer's node before this publication."""
    publication: Number
    """Number of the publication in that epoch, from 1."""
    heard: Moment
    age: Span
    """Age when it was read."""
    hops: Number
    """Number of relays."""
    rssi_dbm: float | None
    """None: not received by radio."""
    arrival: Arrival | None
    """None: the frame was not recorded."""
    known: dict[str, str]
    """Fields that were read, as text."""


class KnowledgeChange(msgspec.Struct, frozen=True):
    """One change of one component's knowledge."""

    step: Number
    instant: Moment
    component: str
    by: str
    """Process such as `CleaningRobot.sense`, or exchange such as `DestinationAdoption.at_member`."""
    adaptation: bool
    """True for an ensemble, and for a process of the adaptation layer."""
    peer: str
    """The component whose knowledge an ensemble used; empty for a process."""
    age: Span
    """Age of that knowledge; 0 for a process, and for a peer on the same node."""
    changed: tuple[ValueChange, ...]
    fields: dict[str, FieldChange]
    """The changes by field of the component."""
    own: tuple[str, ...]
    """Fields of the component on which it depends, determined from the source code."""
    read: ReplicaRead | None
    """The replica used; None for a process, and for a peer on the same node."""
    decision: DecisionRecord | None = None
    function: str = ""
    """Full name of the function, such as `cleaning.robot.CleaningRobot.drive`; empty if unknown."""


class ReplicaReception(msgspec.Struct, frozen=True):
    """Reception of a newer replica of a peer's component."""

    peer: str
    heard: Moment


class BehaviourOrder(msgspec.Struct, frozen=True):
    """Order of a behaviour to its robot."""

    step: Number
    instant: Moment
    """Start of the step, or the instant given by the behaviour."""
    words: str
    verb: str
    """Kind of order: the first part of `words`."""
    point: Position | None
    """Goal; for `STOPS`, the previous goal; None: none."""
    goal: GoalState | None
    """State of navigation's previous goal."""
    moved: tuple[Number, ...] = ()
    """Numbers of the changes of knowledge that set or removed the point, newest first."""


class CausalTrace(msgspec.Struct, frozen=True):
    """Changes of knowledge, received replicas and orders of one robot process."""

    changes: tuple[KnowledgeChange, ...]
    news: tuple[ReplicaReception, ...]
    orders: tuple[BehaviourOrder, ...]
    has_nodes: bool
    """False: the behaviour does not use the component model, or has started no node."""
    end: Moment = Instant(0)
    """Last replayed step."""
    fault: str | None = None
    """Why the trace is incomplete; None: it is complete."""


def decode(data: bytes, actor: str) -> CausalTrace:
    """Decode the trace of an actor. Raises TraceError for an invalid one."""
    try:
        return typed_json.decode(data, CausalTrace, form=msgspec.msgpack)
    except (ValueError, TypeError) as error:
        raise TraceError(f"{actor}: invalid trace: {printable(str(error))}") from None


def seconds(instant: Instant) -> str:
    """Format an instant in s."""
    return f"{in_seconds(instant):.3f}".rstrip("0").rstrip(".")
