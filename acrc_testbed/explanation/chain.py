"""Chain of causes of one decision: newest first, causes below their effects."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import msgspec

from acrc_testbed.explanation.causal_trace import (
    Arrival,
    BehaviourOrder,
    CausalTrace,
    KnowledgeChange,
    ReplicaRead,
    seconds,
)
from acrc_testbed.explanation.tracer import AGAIN, GIVES_UP
from acrc_testbed.recordings.run_recordings import all_recordings, read_setup
from acrc_testbed.run_model.frame_outcomes import FrameRow, frame_rows
from acrc_testbed.run_model.recording_readers import frame_outcomes, messages_on
from actors.instant import Instant, in_seconds
from actors.introspection import GoalState
from actors.messages import RECEIVED, FrameReceived
from actors.radio.frame import airtime_us
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.ports import GoalPhase, GoalStatus
from deeco.fragments import HEADER

_FRAGMENT_TIMEOUT_US: Final = 2_000_000
"""Maximum time between fragments of one packet (`deeco.link.LinkParameters`)."""


class FrameLoss(NamedTuple):
    """One frame that was lost at the receiver."""

    instant: Instant
    """End of the frame."""
    sender: str
    cause: str


@dataclass(frozen=True)
class RadioTraffic:
    """Radio traffic of one run as received by one robot process; read on first use."""

    out: Path
    actor: str

    @property
    def simulated(self) -> bool:
        """True if the radio was simulated and recorded."""
        return "radio" in self._files

    def robot(self, address: int) -> str:
        """Return the robot with a short address, or a description of the address."""
        return self._robots.get(address, f"address {address}")

    def frames(self, arrival: Arrival) -> tuple[FrameReceived, ...]:
        """Return the frames of a packet in order; the last one is the arrival."""
        last = next((one for one in self._heard if one.instant == arrival.instant), None)
        if last is None:
            return ()
        packets = _packets(last.data)
        since = Instant(arrival.instant - _FRAGMENT_TIMEOUT_US)
        return tuple(
            one
            for one in self._heard
            if since <= one.instant <= arrival.instant
            and one.sender == arrival.sender
            and (one is last or packets & _packets(one.data))
        )

    def losses(self, senders: tuple[str, ...], since: Instant, until: Instant) -> tuple[FrameLoss, ...]:
        """Return the frames of `senders` between `since` and `until` that were lost at this robot."""
        return tuple(
            FrameLoss(Instant(frame.ended), frame.robot, copy.outcome.replace("_", " "))
            for frame in self._sent
            if frame.robot in senders and since < frame.ended < until
            for copy in frame.copies
            if copy.robot == self.robot_here and copy.outcome not in ("heard", "filtered")
        )

    @property
    def robot_here(self) -> str:
        """The robot of the process."""
        return self._files[self.actor].parent.name

    @cached_property
    def _files(self) -> dict[str, Path]:
        return all_recordings(self.out)

    @cached_property
    def _robots(self) -> dict[int, str]:
        if not self.simulated:
            return {}
        setup = read_setup(self._files["radio"], RadioSetup, "a radio")
        return {address: robot for robot, address in setup.robots}

    @cached_property
    def _sent(self) -> list[FrameRow]:
        return frame_rows(*frame_outcomes(self.out)) if self.simulated else []

    @cached_property
    def _heard(self) -> list[FrameReceived]:
        received = (message for _, message in messages_on(self._files[self.actor], RECEIVED))
        return [event for message in received for event in message.events if isinstance(event, FrameReceived)]

    @cached_property
    def _handed(self) -> dict[tuple[str, int], Instant]:
        return {(frame.robot, frame.ended): Instant(frame.handed) for frame in self._sent}

    def handed(self, frame: FrameReceived) -> Instant | None:
        """Return when the sender handed a frame to its transceiver; None without a radio's recording."""
        return self._handed.get((self.robot(frame.sender), frame.instant))


def _packets(data: bytes) -> set[tuple[int, int]]:
    """Return number and node of each packet with a fragment in a frame."""
    found, at = set(), 0
    while len(data) - at > HEADER.size:
        try:
            _, size, _, number, node = HEADER.unpack_from(data, at)
        except struct.error:
            break
        found.add((number, node))
        at += HEADER.size + size
    return found


_PARAMETERS: Final = "parameters"
_FREQUENT_HZ: Final = 0.3
"""Rate above which changes are frequent, 1/s; a point that changes so often is a position, not a goal."""
_MIN_FREQUENT: Final = 5
"""Number of changes up to which they never count as frequent."""

Changes = Sequence[KnowledgeChange]


class ChangeRun(NamedTuple):
    """Changes of one field by one process or exchange: one change, or for a counter several in a row."""

    field: str
    numbers: tuple[int, ...]
    """Numbers of the changes."""

    @property
    def last(self) -> int:
        """Number of the newest change."""
        return self.numbers[-1]


def preceding_changes(changes: Changes, number: int) -> list[ChangeRun]:
    """Return the preceding changes of each field on which a change depended, newest first."""
    own = changes[number].own
    found = [
        run
        for field in own
        if field != _PARAMETERS and (run := _last_run(changes, field, number)) is not None
    ]
    return sorted(found, key=lambda run: -run.last)


def is_routine(changes: Changes, number: int) -> bool:
    """Return True if the process or exchange of a change makes frequent changes."""
    by = changes[number].by
    return _is_frequent(changes, [other for other, one in enumerate(changes) if one.by == by])


def _last_run(changes: Changes, field: str, before: int) -> ChangeRun | None:
    """Return a field's last changes before a change; None if it did not change, or is the position."""
    numbers = list(_changes_of(changes, field, before))
    if not numbers:
        return None
    if changes[numbers[-1]].fields[field].is_point and _is_frequent(changes, numbers):
        return None
    return ChangeRun(field, tuple(_consecutive_changes(changes, field, numbers)))


def _consecutive_changes(changes: Changes, field: str, numbers: list[int]) -> list[int]:
    """Return the last change; for a counter, all consecutive changes in the same direction."""
    newest = numbers[-1]
    direction, found = changes[newest].fields[field].direction, [newest]
    for number in reversed(numbers[:-1]):
        same = changes[number].by == changes[newest].by
        if not direction or not same or changes[number].fields[field].direction != direction:
            break
        found.append(number)
    return found[::-1]


def _changes_of(changes: Changes, field: str, before: int) -> Iterator[int]:
    component = changes[before].component
    for number, change in enumerate(changes[:before]):
        if change.component == component and field in change.fields:
            yield number


def _is_frequent(changes: Changes, numbers: list[int]) -> bool:
    lasted = in_seconds(changes[-1].instant - changes[0].instant)
    return len(numbers) > max(_MIN_FREQUENT, _FREQUENT_HZ * lasted)


class TracedDecision(NamedTuple):
    """One decision in a trace."""

    step: int
    instant: Instant
    words: str
    by: str
    """Process or exchange that changed the knowledge; "behaviour" for an order."""
    change: int | None
    """Number of the change of knowledge; None for an order."""
    order: int | None
    """Number of the order; None for a change of knowledge."""


def decisions(trace: CausalTrace) -> list[TracedDecision]:
    """Return all decisions in order: changes of knowledge with a decision, and orders.

    An order that follows from a change of knowledge in the same step is left out.
    """
    decision = [
        TracedDecision(one.step, one.instant, one.decision.words, one.by, number, None)
        for number, one in enumerate(trace.changes)
        if one.decision is not None
    ]
    adapted = {one.step for one in trace.changes if one.adaptation}
    decision += [
        TracedDecision(one.step, one.instant, one.words, "behaviour", None, number)
        for number, one in enumerate(trace.orders)
        if one.verb != GIVES_UP or one.step not in adapted
    ]
    return sorted(decision, key=lambda one: (one.step, one.change is None))


_MAX_FIELDS: Final = 4
"""Maximum number of fields reported per change; the newest ones."""
_MAX_DEPTH: Final = 3
_MAX_LOSSES: Final = 5
"""Maximum number of losses listed."""
_MAX_VALUE_LENGTH: Final = 90
"""Maximum length of a value, characters."""


Second = Annotated[float, msgspec.Meta(ge=0, le=1e9)]
"""Simulated s."""


class CauseLink(msgspec.Struct, frozen=True):
    """One cause in a chain."""

    at_s: Second
    kind: str
    """`order`, `goal`, `process`, `exchange`, `state`, `replica`, `frame`, `lost` or `unknown`."""
    says: str
    """Sentence without the instant."""
    depth: Annotated[int, msgspec.Meta(ge=0, le=100)]
    """Depth below the decision; 0: the decision itself."""
    about: dict[str, Any] = {}
    """The data of the sentence: names, numbers, old and new values of fields."""


class ChainBuilder:
    """Builder of the chains of decisions of one process."""

    def __init__(self, trace: CausalTrace, traffic: RadioTraffic) -> None:
        self._trace = trace
        self._traffic = traffic
        self._linked: set[int] = set()

    def links(self, decision: TracedDecision) -> list[CauseLink]:
        """Return the links of a decision, starting with itself."""
        self._linked = set()
        if decision.change is not None:
            return list(self._change(decision.change, 0, decision.words))
        assert decision.order is not None
        return list(self._order(self._trace.orders[decision.order]))

    def _order(self, order: BehaviourOrder) -> Iterator[CauseLink]:
        """Yield the links of an order."""
        about = {"words": order.words, "point": None if order.point is None else list(order.point)}
        yield _link(order.instant, "order", f"{self._traffic.robot_here} {order.words}", 0, about)
        if order.verb == AGAIN or order.goal is not None:
            goal = order.goal or GoalState(None)
            about = {"status": goal.status, "reason": goal.reason}
            yield _link(order.instant, "goal", _goal_text(goal), 1, about)
        causes = self._causing_changes(order)
        for number in causes[:_MAX_FIELDS]:
            if number in self._linked:
                continue
            yield from self._change(number, 1)
        if not causes:
            yield self._unknown(order)

    def _unknown(self, order: BehaviourOrder) -> CauseLink:
        if not self._trace.has_nodes:
            says = "unknown: the strategy does not use the component model"
        else:
            says = "no change of knowledge led to it; it follows from the initial knowledge"
        return _link(order.instant, "unknown", says, 1, {})

    def _causing_changes(self, order: BehaviourOrder) -> Sequence[int]:
        """Return the changes that set or removed the point of an order; else those of the same step."""
        if order.point is not None:
            return order.moved
        changes = self._trace.changes
        now = [number for number, one in enumerate(changes) if one.step == order.step][::-1]
        adapting = [number for number in now if changes[number].adaptation]
        return adapting or [number for number in now if not is_routine(changes, number)]

    def _change(self, number: int, depth: int, words: str = "") -> Iterator[CauseLink]:
        """Yield a change of knowledge and its causes."""
        self._linked.add(number)
        change = self._trace.changes[number]
        kind = "exchange" if change.peer else "process"
        values = {field: (one.before, one.after) for field, one in change.fields.items()}
        text = ", ".join(f"{_field_text(one)} {_change_text(*pair)}" for one, pair in values.items())
        what = f"{self._traffic.robot_here} {words}" if words else text
        by = change.function or change.by
        by = f"exchange {by} with {change.peer}" if change.peer else f"process {by}"
        about = {
            "by": change.by, "adaptation": change.adaptation, "peer": change.peer,
            "changed": {one: list(pair) for one, pair in values.items()},
        }  # fmt: skip
        yield _link(change.instant, kind, f"{what}, by {by}", depth, about)
        if words:
            yield _link(change.instant, "state", f"changes: {text}", depth + 1, {})
        yield from self._causes(number, depth + 1)

    def _causes(self, number: int, depth: int) -> Iterator[CauseLink]:
        """Yield the causes of a change: the replica that it used, then the component's own knowledge."""
        if (read := self._trace.changes[number].read) is not None:
            yield from self._replica(read, depth)
        runs = [run for run in preceding_changes(self._trace.changes, number) if run.last not in self._linked]
        by_change: dict[int, list[ChangeRun]] = {}
        for run in runs[:_MAX_FIELDS]:
            by_change.setdefault(run.last, []).append(run)
        for last, runs in by_change.items():
            if last not in self._linked:
                yield from self._state(last, runs, depth)

    def _state(self, number: int, runs: Sequence[ChangeRun], depth: int) -> Iterator[CauseLink]:
        for run in runs:
            self._linked.update(run.numbers)
        change = self._trace.changes[number]
        text = ", ".join(self._since(run) for run in runs)
        about = {
            "by": change.by, "peer": change.peer,
            "changed": {run.field: list(self._pair(run)) for run in runs},
        }  # fmt: skip
        with_peer = f" with {change.peer}" if change.peer else ""
        yield _link(change.instant, "state", f"{text}, by {change.by}{with_peer}", depth, about)
        if depth < _MAX_DEPTH:
            yield from self._causes(number, depth + 1)

    def _since(self, run: ChangeRun) -> str:
        text = f"{_field_text(run.field)} {_change_text(*self._pair(run))}"
        if len(run.numbers) == 1:
            return text
        return f"{text} since {seconds(self._trace.changes[run.numbers[0]].instant)} s"

    def _pair(self, run: ChangeRun) -> tuple[str, str]:
        first, last = (self._trace.changes[number].fields[run.field] for number in (run.numbers[0], run.last))
        return first.before, last.after

    def _replica(self, read: ReplicaRead, depth: int) -> Iterator[CauseLink]:
        """Yield the replica of a peer and the frames that delivered it."""
        text = ", ".join(f"{_field_text(one)} {_shortened(value)}" for one, value in read.known.items())
        age = in_seconds(read.age)
        about = {
            "peer": read.component, "epoch": read.epoch, "publication": read.publication, "age_s": age,
            "hops": read.hops, "rssi_dbm": read.rssi_dbm, "known": read.known,
        }  # fmt: skip
        yield _link(
            read.heard, "replica",
            f"replica of {read.component}, {age:.3g} s old (publication {read.publication}): {text}",
            depth, about,
        )  # fmt: skip
        if read.arrival is not None:
            for frame in reversed(self._traffic.frames(read.arrival)):
                yield _frame_link(self._traffic, frame, read.hops, depth + 1)
        yield from self._lost(read, depth + 1)

    def _lost(self, read: ReplicaRead, depth: int) -> Iterator[CauseLink]:
        """Yield the losses from this peer or its relay since the previous replica."""
        if not self._traffic.simulated:
            says = "earlier losses are unknown: only a simulated radio records them"
            yield _link(read.heard, "unknown", says, depth, {})
            return
        earlier = [
            one.heard for one in self._trace.news if one.peer == read.component and one.heard < read.heard
        ]
        since = max(earlier, default=Instant(0))
        senders = {read.component} | ({self._traffic.robot(read.arrival.sender)} if read.arrival else set())
        lost = self._traffic.losses(tuple(sorted(senders)), since, read.heard)
        yield _loss_link(lost, sorted(senders), since, read.heard, depth)


def _frame_link(traffic: RadioTraffic, frame: FrameReceived, hops: int, depth: int) -> CauseLink:
    sender, at, size = traffic.robot(frame.sender), traffic.handed(frame), len(frame.data)
    airtime_ms = airtime_us(size) / 1000
    relayed = "direct" if not hops else "relayed once" if hops == 1 else f"relayed {hops} times"
    handed = "" if at is None else f", handed to the transceiver at {seconds(at)} s"
    says = (
        f"received in a frame of {sender}, {relayed}: {size} bytes, "
        f"{airtime_ms:.2f} ms on the air, {frame.rssi_dbm:.0f} dBm{handed}"
    )
    about = {
        "sender": sender, "hops": hops, "rssi_dbm": frame.rssi_dbm, "lqi": frame.lqi,
        "bytes": size, "airtime_ms": airtime_ms, "handed_s": None if at is None else in_seconds(at),
    }  # fmt: skip
    return _link(Instant(frame.instant), "frame", says, depth, about)


def _loss_link(
    lost: Sequence[FrameLoss], senders: Sequence[str], since: Instant, until: Instant, depth: int
) -> CauseLink:
    names = " and ".join(senders)
    between = f"between {seconds(since)} and {seconds(until)} s"
    if not lost:
        says = f"no frame of {names} was lost {between}"
        return _link(until, "lost", says, depth, {"senders": list(senders), "lost": []})
    text = ", ".join(f"{seconds(one.instant)} s {one.cause}" for one in lost[-_MAX_LOSSES:])
    more = "" if len(lost) <= _MAX_LOSSES else f", the last {_MAX_LOSSES} of them"
    count = "1 frame" if len(lost) == 1 else f"{len(lost)} frames"
    says = f"{count} of {names} {'was' if len(lost) == 1 else 'were'} lost {between}{more}: {text}"
    rows = [{"at_s": in_seconds(one.instant), "sender": one.sender, "cause": one.cause} for one in lost]
    return _link(lost[-1].instant, "lost", says, depth, {"senders": list(senders), "lost": rows})


def _link(at: Instant, kind: str, says: str, depth: int, about: dict[str, Any]) -> CauseLink:
    return CauseLink(in_seconds(at), kind, says, depth, about)


def _goal_text(goal: GoalState) -> str:
    """Describe the state of a goal."""
    if goal.point is None:
        return "there was no previous goal"
    at = f"({goal.point[0]:.2f}, {goal.point[1]:.2f})"
    if goal.status == GoalStatus.ABORTED.value and goal.reason is not None:
        return f"navigation had aborted the goal {at}: {goal.reason}"
    if goal.status == GoalStatus.SUCCEEDED.value:
        return f"navigation had reached the goal {at}"
    phase = "" if goal.phase in (None, GoalPhase.CONTROLLING.value) else f", {goal.phase}"
    return f"navigation was driving to {at}{phase}"


def _field_text(field: str) -> str:
    return field.replace("_", " ")


def _change_text(before: str, after: str) -> str:
    return f"{_shortened(before)} → {_shortened(after)}"


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_VALUE_LENGTH else f"{text[:_MAX_VALUE_LENGTH]}…"
