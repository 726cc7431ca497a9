"""What a robot knew, change by change, and what each change came of; from executing the robot again.

Runs the strategy that the recording names, in this process: ask `observation.replay.trust.check_trust`
first where that may be somebody else's.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

from actors.instant import Duration, Instant
from actors.messages import Heard, Received
from actors.runtime.core import Core, Inputs
from actors.runtime.prints import nowhere
from deeco.knowledge import Knowledge
from deeco.local import Commit
from deeco.onlooking import looking_on
from deeco.replication.replicas import Replica
from observation.replay.debugging import Stretch, watch
from observation.replay.record_replay import Onlook, ReplayReport, replay_actor

ABSENT: Final = "absent"
"""Stands where a mapping has no such key."""


class Changed(NamedTuple):
    """A part of knowledge with two values."""

    path: str
    """Such as `destination`, `parameters.speed`, or `bids[r2]` in a mapping."""
    before: object
    after: object


class Arrival(NamedTuple):
    """The frame that made a replica's packet whole; earlier frames may have brought other parts of it."""

    step: int
    """In which the robot got it from its transceiver."""
    instant: Instant
    """When its last symbol ended."""
    sender: int
    """Short address of the transceiver that sent it: the peer's own, or of whoever relayed."""
    rssi_dbm: float
    lqi: int


class ReplicaRead(NamedTuple):
    """What a robot knew of a peer's component."""

    component: str
    epoch: int
    """Of the peer's node, when it published this ..."""
    publication: int
    """... and its number, counted from 1 in that epoch."""
    heard: Instant
    age: Duration
    """How long ago that was when it was read."""
    hops: int
    """How often it had been relayed."""
    rssi_dbm: float | None
    """None: it did not come by radio."""
    arrival: Arrival | None
    """None where the recording has no such frame."""
    roles: tuple[Knowledge, ...]
    """The knowledge itself, as it came."""


class KnowledgeChange(NamedTuple):
    """One change of one component's knowledge."""

    step: int
    instant: Instant
    component: str
    by: str
    """The process or the ensemble's exchange, `CleaningRobot.sense` or `DestinationAdoption.at_member`."""
    adaptation: bool
    """True of an ensemble, and of a process of the adaptation layer."""
    changed: tuple[Changed, ...]
    peer: str
    """The component whose knowledge an ensemble used; empty for a process."""
    read: ReplicaRead | None
    """The replica that it used; None for a process, and for a peer on the same node."""
    after: Knowledge


class ReplicaHeard(NamedTuple):
    """A newer replica of a peer's component, from this step on."""

    step: int
    component: str
    """Whose node has it."""
    replica: ReplicaRead


class Beginning(NamedTuple):
    """What a component began with."""

    step: int
    instant: Instant
    knowledge: Knowledge


@dataclass
class KnowledgeTrace:
    """What one process of a robot knew, in the order in which it came about.

    All is empty for a behaviour without nodes of the component model.
    """

    beginnings: list[Beginning] = field(default_factory=list)
    """More than one for a component whose node was made anew: at the robot's first step, if that is not 0."""
    changes: list[KnowledgeChange] = field(default_factory=list)
    heard: list[ReplicaHeard] = field(default_factory=list)
    report: ReplayReport | None = None
    """That all the robot sent was the same again; None while it is being executed."""


def trace_knowledge(
    out: Path,
    actor: str,
    until_s: float | None = None,
    prepare: Callable[[Core, int], None] = lambda core, step_us: None,
) -> KnowledgeTrace:
    """Execute a robot's process (`r2`, or `r2.1` once restarted) again, up to an instant, simulated s.

    `prepare` is given the core before its first step, as by `Onlook`, for who wants to look at more.
    Raises ReplayError if it does not do again what it did, RecordingError for a damaged recording.
    """
    tracer = Tracer()
    with looking_on(tracer):
        stretch = Stretch(0.0, until_s)

        def looked_at(core: Core, step_us: int) -> None:
            prepare(core, step_us)
            tracer.prepare(core, step_us)
            watch(core, step_us, stretch, None)

        tracer.trace.report = replay_actor(out, actor, Onlook(looked_at, prints=lambda step_us: nowhere()))
    return tracer.trace


class Tracer:
    """Takes down what the nodes of one core do: for `looking_on`, while the core is executed again."""

    def __init__(self) -> None:
        self.trace = KnowledgeTrace()
        self._step = 0
        self._arrivals: dict[Instant, Arrival] = {}

    def prepare(self, core: Core, step_us: int) -> None:
        """Look at what the core is given from now on."""
        advance = core.advance

        def watched(inputs: Inputs) -> Any:
            self._take(core.step, inputs)
            return advance(inputs)

        cast(Any, core).advance = watched

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """See `deeco.onlooking.Onlooker`, as for the next ones."""
        self.trace.beginnings.append(Beginning(self._step, now, component))

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """One change."""
        self.trace.changes.append(
            KnowledgeChange(
                step=self._step,
                instant=commit.instant,
                component=commit.after.id,
                by=commit.by,
                adaptation=commit.adaptation,
                changed=tuple(differences(commit.before, commit.after)),
                peer=commit.peer,
                read=None if replica is None else self._read(replica, commit.instant),
                after=commit.after,
            )
        )

    def heard(self, component: str, replica: Replica, now: Instant) -> None:
        """One newer replica."""
        self.trace.heard.append(ReplicaHeard(self._step, component, self._read(replica, now)))

    def _take(self, step: int, inputs: Inputs) -> None:
        self._step = max([step, *(message.step for message in inputs.values())])  # after a gap it is behind
        received = [message for message in inputs.values() if isinstance(message, Received)]
        for event in (event for message in received for event in message.events):
            if isinstance(event, Heard):
                instant = Instant(event.instant)
                self._arrivals[instant] = Arrival(
                    self._step, instant, event.sender, event.rssi_dbm, event.lqi
                )

    def _read(self, replica: Replica, now: Instant) -> ReplicaRead:
        contact = replica.contact(now)
        return ReplicaRead(
            replica.id,
            *replica.version,
            heard=contact.heard,
            age=Duration(now - contact.heard),
            hops=contact.hops,
            rssi_dbm=contact.rssi_dbm,
            arrival=self._arrivals.get(contact.heard),
            roles=replica.roles,
        )


def differences(before: object, after: object, path: str = "") -> Iterator[Changed]:
    """Where two values differ: by field and by key, as deep as both are of one kind; a tuple is one value."""
    if before is after:
        return
    if is_dataclass(after) and type(before) is type(after):
        for one in fields(after):
            name = f"{path}.{one.name}" if path else one.name
            yield from differences(getattr(before, one.name), getattr(after, one.name), name)
    elif isinstance(before, Mapping) and isinstance(after, Mapping):
        for key in dict.fromkeys([*before, *after]):
            yield from differences(before.get(key, ABSENT), after.get(key, ABSENT), f"{path}[{key}]")
    elif before != after:
        yield Changed(path, before, after)
