"""Recorder of the changes of knowledge and the orders of a replayed robot, with their sources."""

import inspect
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import Any, Final, NamedTuple, cast

from acrc_testbed.explanation.causal_trace import (
    Arrival,
    BehaviourOrder,
    FieldChange,
    KnowledgeChange,
    ReplicaRead,
    ReplicaReception,
    seconds,
)
from actors.geometry import Point, Pose
from actors.instant import Duration, Instant
from actors.introspection import ValueChange
from actors.messages import FrameReceived, RadioEvents
from actors.robot.behaviour.node_host import ensembles_of
from actors.robot.behaviour.ports import Behaviour, Decision, GoalOrder, View
from actors.robot.core import RobotCore
from actors.robot.introspector import as_json, decision, differences, goal_state, value_text
from actors.runtime.core import Core, Inputs
from deeco.ensemble import COORDINATOR, MEMBER, ensemble_type
from deeco.explain.dataflow import analyse_flow
from deeco.explain.knowledge_use import method_flow, methods
from deeco.knowledge import Knowledge, field_type
from deeco.local import Commit
from deeco.network import Replica


class KnownPoints:
    """Points in a component's fields, with the changes that set or removed them."""

    def __init__(self) -> None:
        self._added: dict[Point, dict[str, int]] = defaultdict(dict)
        self._removed: dict[Point, dict[str, int]] = defaultdict(dict)
        """Number of the last change of each field, by point."""
        self._step = -1
        self._retained: dict[Point, dict[str, int]] = defaultdict(dict)
        """Number of the last change in the current step that kept the point, by field."""

    def add_change(self, number: int, step: int, field: str, before: object, after: object) -> None:
        """Add a change of a field."""
        if step != self._step:
            self._step = step
            self._retained.clear()
        had, has = set(_points(before)), set(_points(after))
        for point in has - had:
            self._added[point][field] = number
        for point in had - has:
            self._removed[point][field] = number
        for point in has:
            self._retained[point][field] = number

    def changes_of(self, point: Point | None, step: int, *, removed: bool, retained: bool) -> tuple[int, ...]:
        """Return the numbers of the last changes that set the point in each field, newest first.

        `removed`: changes that removed it instead; `retained`: also changes of this step that kept it.
        """
        if point is None:
            return ()
        found = dict((self._removed if removed else self._added).get(point, {}))
        if retained and step == self._step:
            found |= self._retained.get(point, {})
        return tuple(sorted(set(found.values()), reverse=True))


def _points(value: object) -> Iterator[Point]:
    """Yield all points in a nested value."""
    if isinstance(value, Point):
        yield value
    elif isinstance(value, tuple):
        if len(value) == 2 and all(isinstance(one, float) for one in value):
            yield Point(*value)
        for one in value:
            yield from _points(one)
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _points(one)
    elif is_dataclass(value):
        for one in fields(value):
            yield from _points(getattr(value, one.name))


SETS_OFF: Final = "drives to"
AGAIN: Final = "drives again to"
STOPS: Final = "stops"
GIVES_UP: Final = "gives up"


class OrderRecorder:
    """Recorder of a behaviour's orders; records none if the behaviour cannot be wrapped."""

    def __init__(self, points: KnownPoints) -> None:
        """`points`: points in the same robot's knowledge."""
        self.found: list[BehaviourOrder] = []
        self._points = points
        self._heading: Point | None = None
        self._behaviour: Behaviour | None = None

    @property
    def ensembles(self) -> tuple[object, ...]:
        """Ensembles of the last node; empty without a node."""
        return ensembles_of(self._behaviour)

    def attach(self, core: RobotCore) -> None:
        """Record the orders of all further steps."""
        behaviour = self._behaviour = core.behaviour
        advance = behaviour.advance

        def recording_advance(view: View, until: Any) -> Decision:
            decision = advance(view, until)
            self.found += self._orders_of(core.step, view, decision)
            return decision

        with suppress(AttributeError):  # an object with slots cannot be patched
            object.__setattr__(behaviour, "advance", recording_advance)

    def _orders_of(self, step: int, view: View, decision: Decision) -> Iterator[BehaviourOrder]:
        goal = goal_state(view.goal) if view.goal is not None else None

        def order(
            verb: str, more: str = "", point: Point | None = None, at: Instant | None = None
        ) -> BehaviourOrder:
            moved = self._points.changes_of(point, step, removed=verb == STOPS, retained=verb == AGAIN)
            position = None if point is None else (point.x, point.y)
            words = f"{verb} {more}" if more else verb
            return BehaviourOrder(
                step, Instant(view.instant) if at is None else at, words, verb, position, goal, moved
            )

        for item in decision.given_up:
            yield order(GIVES_UP, f"{item.key}: {item.reason}", at=Instant(item.instant))
        yield from self._goal_orders(view, decision, order)
        if decision.paused is not None:
            yield order("pauses" if decision.paused else "resumes")
        if decision.back_out is not None:
            yield order("backs out", f"{decision.back_out:g} m along its trail")
        if decision.relocalise:
            yield order("relocalises")

    def _goal_orders(self, view: View, decision: Decision, order: Any) -> Iterator[BehaviourOrder]:
        if isinstance(decision.goal, Point):
            verb = AGAIN if decision.goal == self._heading else SETS_OFF
            self._heading = decision.goal
            yield order(verb, f"({decision.goal.x:.2f}, {decision.goal.y:.2f})", decision.goal)
        elif decision.goal is GoalOrder.CANCEL and view.goal is not None:
            left, self._heading = self._heading, None
            yield order(STOPS, "", left)


class ReadFields(NamedTuple):
    """Fields that a process or exchange reads."""

    own: tuple[str, ...]
    """Fields of the component."""
    peer: tuple[str, ...]
    """Fields of the peer of an exchange."""
    function: str = ""
    """Full name of the function that reads them."""


def read_fields(
    kind: type[Knowledge], by: str, ensembles: tuple[object, ...], *, exchange: bool
) -> ReadFields:
    """Return the fields that the process or exchange `by` reads; empty if its source is unknown."""
    owner, _, name = by.rpartition(".")
    if not exchange:
        function = getattr(kind, name, None)
        if function is None:
            return ReadFields((), ())
        own = next(iter(inspect.signature(function).parameters))
        return ReadFields(
            analyse_flow(function, {own: kind}).read(own),
            (),
            f"{function.__module__}.{function.__qualname__}",
        )
    for one in ensembles:
        described = ensemble_type(type(one))
        if described is not None and described.name == owner:
            return _exchange_fields(type(one), name, kind)
    return ReadFields((), ())


def _exchange_fields(ensemble: type, name: str, kind: type[Knowledge]) -> ReadFields:
    """Return the fields that the membership and the exchange read, and a group's choice of members."""
    described = ensemble_type(ensemble)
    assert described is not None
    local = MEMBER if name.startswith((f"at_{MEMBER}", "confirm")) else COORDINATOR
    own: dict[str, None] = {}
    peer: dict[str, None] = {}
    for method in methods(described):
        if local not in method.local or (method.name != name and method.name.startswith(("at_", "boundary"))):
            continue
        found = method_flow(ensemble, method, local, kind)
        own |= dict.fromkeys(found.read(local))
        peer |= dict.fromkeys(one for side, _ in method.sides if side != local for one in found.read(side))
    function = getattr(ensemble, name, ensemble)  # a group's choice and confirmation are no methods of it
    return ReadFields(tuple(own), tuple(peer), f"{function.__module__}.{function.__qualname__}")


class Tracer:
    """Recorder of the nodes of a replayed core, for `observing_nodes`."""

    def __init__(self) -> None:
        self.changes: list[KnowledgeChange] = []
        """Changes so far."""
        self.news: list[ReplicaReception] = []
        self.has_nodes = False
        self.end = Instant(0)
        """Last step."""
        self.orders = OrderRecorder(points := KnownPoints())
        self._points = points
        self._number = 0
        self._step = 0
        self._arrivals: dict[Instant, Arrival] = {}
        self._reads: dict[tuple[type, str], ReadFields] = {}

    def prepare(self, core: Core, step_us: int) -> None:
        """Record the inputs of the core from now on."""
        advance = core.advance

        def recording_advance(inputs: Inputs) -> Any:
            self._record_inputs(core.step, inputs)
            self.end = Instant(self._step * step_us)
            return advance(inputs)

        cast(Any, core).advance = recording_advance

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """Implement `deeco.node.NodeObserver`."""
        self.has_nodes = True

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """Record a change of knowledge."""
        found = list(differences(commit.before, commit.after))
        touched = dict.fromkeys(field_of(one.path) for one in found)
        for field in touched:
            before, after = getattr(commit.before, field), getattr(commit.after, field)
            self._points.add_change(self._number, self._step, field, before, after)
        self._number += 1
        depends = self._fields_read(commit)
        self.changes.append(
            KnowledgeChange(
                step=self._step,
                instant=commit.instant,
                component=commit.after.id,
                by=commit.by,
                adaptation=commit.adaptation,
                peer=commit.peer,
                age=Duration(0 if commit.heard is None else commit.instant - commit.heard),
                changed=tuple(
                    ValueChange(one.path, as_json(one.before), as_json(one.after)) for one in found
                ),
                fields={field: _field_change(commit, field) for field in touched},
                own=depends.own,
                read=None if replica is None else self._replica_read(replica, commit.instant, depends.peer),
                decision=decision(commit),
                function=depends.function,
            )
        )

    def replica_received(self, component: str, replica: Replica, now: Instant) -> None:
        """Record a newer replica."""
        self.news.append(ReplicaReception(replica.id, replica.contact(now).heard))

    def _fields_read(self, commit: Commit) -> ReadFields:
        key = type(commit.after), commit.by
        if key not in self._reads:
            exchange = bool(commit.peer) or commit.heard is not None
            self._reads[key] = read_fields(*key, self.orders.ensembles, exchange=exchange)
        return self._reads[key]

    def _record_inputs(self, step: int, inputs: Inputs) -> None:
        self._step = max([step, *(message.step for message in inputs.values())])  # core.step lags after a gap
        received = [message for message in inputs.values() if isinstance(message, RadioEvents)]
        for event in (event for message in received for event in message.events):
            if isinstance(event, FrameReceived):
                instant = Instant(event.instant)
                self._arrivals[instant] = Arrival(
                    self._step, instant, event.sender, event.rssi_dbm, event.lqi
                )

    def _replica_read(self, replica: Replica, now: Instant, fields_read: tuple[str, ...]) -> ReplicaRead:
        contact = replica.contact(now)
        epoch, publication = replica.version
        return ReplicaRead(
            component=replica.id,
            epoch=epoch,
            publication=publication,
            heard=contact.heard,
            age=Duration(now - contact.heard),
            hops=contact.hops,
            rssi_dbm=contact.rssi_dbm,
            arrival=self._arrivals.get(contact.heard),
            known=_known(replica.roles, fields_read),
        )


def field_of(path: str) -> str:
    """Return the field of the component at the start of a path."""
    return path.partition(".")[0].partition("[")[0]


def _field_change(commit: Commit, field: str) -> FieldChange:
    before, after = getattr(commit.before, field), getattr(commit.after, field)
    numbers = isinstance(before, int) and isinstance(after, int)
    return FieldChange(
        _value_text(commit.before, field),
        _value_text(commit.after, field),
        (after > before) - (after < before) if numbers else 0,
        isinstance(after, Point | Pose),
    )


def _known(roles: tuple[Knowledge, ...], fields_read: tuple[str, ...]) -> dict[str, str]:
    """Return the fields of a replica that an exchange read; all of them if that is unknown."""
    fitting = [role for role in roles if any(hasattr(role, one) for one in fields_read)] or list(roles)
    if not fitting:
        return {}
    names = fields_read or tuple(vars(fitting[0]))
    return {
        one: _value_text(fitting[0], one)
        for one in names
        if hasattr(fitting[0], one) and one not in ("id", "parameters")
    }


def _value_text(knowledge: Knowledge, field: str) -> str:
    """Format a field's value; instants in seconds."""
    value = getattr(knowledge, field)
    if isinstance(value, int) and "Instant" in str(field_type(type(knowledge), field)):
        return f"{seconds(Instant(value))} s"
    return value_text(value)
