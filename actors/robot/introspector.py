"""Introspection records of a robot's internal state, without side effects or random numbers.

The records are outputs of the robot's core that go to its recording only. Values that cannot be converted
are omitted; the robot continues.
"""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from actors.geometry import CERTAIN, ORIGIN, Point, Pose
from actors.instant import Instant
from actors.introspection import (
    PERIOD,
    Activity,
    CostWindow,
    DecisionRecord,
    EstimateQuality,
    GoalState,
    Introspection,
    KnowledgeCommit,
    PerceptionSample,
    ReplicaUse,
    StepRecord,
    ValueChange,
)
from actors.items import ItemKey
from actors.robot.behaviour.decisions import DecisionSource
from actors.robot.behaviour.node_host import node_of
from actors.robot.behaviour.ports import Behaviour, Goal, GoalPhase, GoalStatus, Plan
from actors.robot.localisation import Estimate, Localisation
from actors.robot.navigation.navigator import Navigator
from actors.robot.navigation.steering import BaseLocalPlanner
from actors.robot.sweep import Sweep
from actors.runtime.errors import printable
from deeco.knowledge import Knowledge
from deeco.local import Commit
from deeco.network import Replica
from deeco.node import Node, NodeObserver, node_observer

ACTIVITIES: Final = (
    "driving", "planning", "no trajectory", "backing out", "blocked", "adopted", "elsewhere", "paused",
    "aborted", "idle",
)  # fmt: skip
"""Activities of a robot, defined in docs/concepts.md."""
_PHASES: Final = {
    GoalPhase.PLANNING: "planning",
    GoalPhase.CONTROLLING: "driving",
    GoalPhase.OBSTRUCTED: "no trajectory",
    GoalPhase.RETREATING: "backing out",
    GoalPhase.PAUSED: "paused",
}
_MAX_PARTICLES: Final = 300
"""Maximum number of recorded particles; enough for pictures."""
_PLAN_STRIDE: Final = 4
"""Record every fourth point of a plan (points are one cell apart)."""
_MAX_TEXT: Final = 160
"""Maximum length of a value as text, characters."""
_MAX_JSON: Final = 20_000
"""Maximum length of a value as JSON, characters."""
_MAX_CHARACTERS: Final = 1_000_000
"""Maximum length of all values in a message, characters; far below the largest record."""
_MAX_REMEMBERED: Final = 10_000
"""Number of remembered values, so that the old value of a change is not recorded again."""
_MAX_COMMITS: Final = 10_000
"""Maximum number of commits in a message."""
_MAX_CHANGES: Final = 500
"""Maximum number of changed values of a commit."""
_MAX_DEPTH: Final = 3
"""Nesting depth from which values are omitted from text."""


class _Step(NamedTuple):
    """State of the robot after a step, and commits of its node."""

    number: int
    estimate: Estimate
    goal: Goal | None
    knowledge: Any
    contacts: dict[str, int | None]
    commits: list[tuple[Commit, Replica | None]]


class Introspector:
    """Recorder of one robot's internal state, notified by its node of commits and replicas.

    A step stores references only. They are compared and encoded once per PERIOD, which is faster because of
    the processor's caches.
    """

    def __init__(self, robot: str, localisation: Localisation, navigation: Navigator) -> None:
        self._robot, self._localisation, self._navigation = robot, localisation, navigation
        planner = navigation.local_planner
        self._planner = planner if isinstance(planner, BaseLocalPlanner) else None
        self._outer_observer: NodeObserver | None = node_observer()
        self._instant, self._due = Instant(0), Instant(0)
        self._estimate = Estimate(ORIGIN, CERTAIN)
        self._quality: EstimateQuality | None = None
        self._sweep: Sweep | None = None
        self._steered: Instant | None = None
        self._plan: Plan | None = None
        self._particles = b""
        self._goal: Goal | None = navigation.goal
        self._activity_goal: object = self
        """Goal of the activity recorded last."""
        self._knowledge: Any = None
        self._activity: tuple[str, ItemKey | None, Point | None] | None = None
        self._peers: set[str] = set()
        """Peers with a replica."""
        self._new_replicas: dict[str, int | None] = {}
        self._free_characters = _MAX_CHARACTERS
        self._recorded: dict[tuple[str, str], object] = {}
        """Last recorded value by component and path."""
        self._commits: list[tuple[Commit, Replica | None]] = []
        self._steps: list[_Step] = []
        """Steps since the last message."""
        self._values: dict[str, object] = {}
        self._texts: dict[str, str] = {}

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """Forward the event; see `deeco.node.NodeObserver` for this and the next methods."""
        if self._outer_observer is not None:
            self._outer_observer.deployed(component, now)

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """Record a change of a component's knowledge."""
        self._commits.append((commit, replica))
        if self._outer_observer is not None:
            self._outer_observer.committed(commit, replica)

    def replica_received(self, component: str, replica: Replica, now: Instant) -> None:
        """Record a newer replica."""
        self._new_replicas[replica.id] = replica.heard
        if self._outer_observer is not None:
            self._outer_observer.replica_received(component, replica, now)

    def begin(self, instant: Instant, estimate: Estimate, sweep: Sweep | None) -> None:
        """Record the inputs of a step. `sweep`: the last scan since the last step."""
        self._instant, self._estimate = instant, estimate
        if sweep is not None:
            self._sweep = sweep

    def end(self, step: int, behaviour: Behaviour) -> Introspection | None:
        """Record the end of a step; return changes once per PERIOD, otherwise None."""
        node = node_of(behaviour)
        knowledge = None if node is None else _knowledge(node, self._robot)
        contacts = {} if node is None else self._contacts(node)
        goal, commits, self._commits = self._navigation.goal, self._commits, []
        self._steps.append(_Step(step, self._estimate, goal, knowledge, contacts, commits))
        if self._instant < self._due:
            return None
        self._due = Instant((self._instant // PERIOD + 1) * PERIOD)
        words = () if knowledge is None else self._changed_texts(knowledge)
        return Introspection(step, self._step_records(), self._sample(), words)

    def rest(self, step: int) -> Introspection | None:
        """Return changes since the last message at the robot's end; None if there was no step."""
        return Introspection(step, self._step_records()) if self._steps else None

    def _step_records(self) -> tuple[StepRecord, ...]:
        steps, self._steps, self._free_characters, commits_left = (
            self._steps,
            [],
            _MAX_CHARACTERS,
            _MAX_COMMITS,
        )
        found: list[StepRecord] = []
        for number, estimate, goal, knowledge, contacts, commits in steps:
            changed = (
                self._changed_quality(estimate),
                None if estimate.located else _coordinates(estimate.pose),
                self._changed_activity(knowledge, goal),
                self._changed_goal(goal),
                tuple(contacts.items()),
                tuple([self._commit(*commit) for commit in commits[:commits_left]]),
            )
            commits_left -= len(changed[-1])
            if any(changed):
                found.append(StepRecord(number, *changed))
        return tuple(found)

    def _changed_quality(self, estimate: Estimate) -> EstimateQuality | None:
        last = self._quality
        if (
            last is not None
            and last.covariance == estimate.covariance
            and last.lost == estimate.lost
            and last.located == estimate.located
        ):
            return None
        covariance = tuple(float(one) for one in estimate.covariance)
        self._quality = EstimateQuality(covariance, estimate.lost, estimate.located)
        return self._quality

    def _changed_goal(self, goal: Goal | None) -> GoalState | None:
        if goal is self._goal or goal == self._goal:
            return None
        self._goal = goal
        return goal_state(goal)

    def _contacts(self, node: Node) -> dict[str, int | None]:
        """Return changed replicas since the last step, with None for forgotten ones."""
        new_replicas, self._new_replicas, replicas = self._new_replicas, {}, node.replicas
        self._peers.update(new_replicas)
        if len(replicas) == len(self._peers):
            return new_replicas
        forgotten = self._peers - {one.id for one in replicas}
        self._peers -= forgotten
        return new_replicas | dict.fromkeys(sorted(forgotten))

    def _changed_activity(self, knowledge: Any, goal: Goal | None) -> Activity | None:
        if knowledge is self._knowledge and goal is self._activity_goal:
            return None
        self._knowledge, self._activity_goal = knowledge, goal
        key = getattr(getattr(knowledge, "destination", None), "key", None)
        destination = key if isinstance(key, ItemKey) else None
        elsewhere = getattr(knowledge, "waypoint", None) is not None
        activity = _activity(self._robot, goal, destination, elsewhere, _is_blocked(knowledge))
        point = None if goal is None or activity == "idle" else goal.point
        now = (activity, destination, point)
        if now == self._activity:
            return None
        self._activity = now
        name = "" if destination is None else value_text(destination)
        return Activity(activity, name, None if point is None else (point.x, point.y))

    def _commit(self, commit: Commit, replica: Replica | None) -> KnowledgeCommit:
        instant = commit.instant
        return KnowledgeCommit(
            instant=instant,
            component=commit.after.id,
            by=commit.by,
            adaptation=commit.adaptation,
            peer=commit.peer,
            age=0 if commit.heard is None else instant - commit.heard,
            changed=self._changes(commit),
            replica=None if replica is None else _replica_use(replica, instant),
            decision=decision(commit) if commit.adaptation else None,
        )

    def _changes(self, commit: Commit) -> tuple[ValueChange, ...]:
        found: list[ValueChange] = []
        component, shown = commit.after.id, self._recorded
        try:
            for path, before, after in differences(commit.before, commit.after):
                if len(found) == _MAX_CHANGES or self._free_characters < 0:
                    found.append(ValueChange("", None, '"further changes omitted"'))
                    break
                known = shown.get((component, path), self) is before
                if len(shown) == _MAX_REMEMBERED:
                    shown.clear()
                shown[component, path] = after
                change = ValueChange(path, "" if known else as_json(before), as_json(after))
                self._free_characters -= len(change.before or "") + len(change.after or "")
                found.append(change)
        except Exception as error:  # comparing and encoding values calls user code
            found.append(ValueChange("", None, f'"cannot be shown: {type(error).__name__}"'))
        return tuple(found)

    def _changed_texts(self, knowledge: Knowledge) -> tuple[tuple[str, str], ...]:
        """Return names and texts of changed fields, except parameters."""
        found = []
        kind: Any = type(knowledge)
        for name in _field_names(kind):
            value = getattr(knowledge, name, None)
            if name == "parameters" or (name in self._values and self._values[name] is value):
                continue
            self._values[name] = value
            text = short_text(value)
            if self._texts.get(name) != text:
                self._texts[name] = text
                found.append((name.replace("_", " "), text))
        return tuple(found)

    def _sample(self) -> PerceptionSample:
        scanned = None if self._sweep is None else _coordinates(self._sweep.pose)
        return PerceptionSample(scanned, self._changed_particles(), self._changed_plan(), self._window())

    def _changed_particles(self) -> bytes | None:
        particles = getattr(self._localisation, "particles", None)
        if particles is None:
            return None
        sample: bytes = particles[:: -(-len(particles) // _MAX_PARTICLES), :2].astype(np.float32).tobytes()
        if sample == self._particles:
            return None
        self._particles = sample
        return sample

    def _changed_plan(self) -> bytes | None:
        plan = self._navigation.plan
        if plan is self._plan:
            return None
        self._plan = plan
        if plan is None:
            return b""
        return np.concatenate((plan.path[::_PLAN_STRIDE], plan.path[-1:])).astype(np.float32).tobytes()

    def _window(self) -> CostWindow | None:
        planner = self._planner
        if planner is None or planner.steered == self._steered:
            return None
        self._steered, local = planner.steered, planner.local
        side = local.side
        corner = (int(local.corner.column), int(local.corner.row))
        return CostWindow(corner, side, local.marked().astype(cell_type(side)).tobytes())


def _coordinates(pose: Pose) -> tuple[float, float, float]:
    return (pose.x, pose.y, pose.heading)


def cell_type(side: int) -> str:
    """Return the dtype of cell indices in a window of `side` rows and columns."""
    return "<u2" if side * side <= 65_536 else "<u4"


def _knowledge(node: Node, robot: str) -> Any:
    """Return the knowledge of the robot's component; None if its id differs from the robot's."""
    try:
        return node.knowledge(robot)
    except KeyError:
        return None


def _is_blocked(knowledge: Any) -> bool:
    blocked = getattr(knowledge, "is_blocked", None)
    if not callable(blocked):
        return False
    try:
        return bool(blocked())
    except Exception:  # user code, called for introspection only
        return False


def _activity(
    robot: str, goal: Goal | None, destination: ItemKey | None, elsewhere: bool, blocked: bool
) -> str:
    """Return the activity; if several apply, the most relevant one for an observer."""
    if blocked:
        return "blocked"
    if goal is None or goal.status is GoalStatus.SUCCEEDED:
        return "idle" if destination is None and not elsewhere else "planning"
    if goal.status is GoalStatus.ABORTED:
        return "aborted"
    phase = "planning" if goal.phase is None else _PHASES[goal.phase]
    if phase != "driving":
        return phase
    if elsewhere:
        return "elsewhere"
    return "adopted" if destination is not None and destination.owner != robot else phase


def goal_state(goal: Goal | None) -> GoalState:
    """Return a goal's state as it is recorded."""
    if goal is None:
        return GoalState(None)
    status, reason, phase = (one and one.value for one in (goal.status, goal.reason, goal.phase))
    return GoalState((goal.point.x, goal.point.y), status, reason, phase)


def _replica_use(replica: Replica, now: Instant) -> ReplicaUse:
    contact = replica.contact(now)
    return ReplicaUse(*replica.version, contact.heard, contact.hops, contact.rssi_dbm)


def decision(commit: Commit) -> DecisionRecord | None:
    """Return the decision of a commit, as in `actors.robot.behaviour.decisions`; None if there is none."""
    before: Any = commit.before
    after: Any = commit.after
    if not (commit.adaptation and _is_decision_source(after)):
        return None
    words = after.decided_since(before)
    if not words:
        return None
    old, new = (None if one is None else (one.x, one.y) for one in (before.target, after.target))
    return DecisionRecord(words, old, new)


_DECISION_SOURCES: Final[dict[type, bool]] = {}
"""True for each class of DecisionSources, False for others: `isinstance` takes ten calls."""


def _is_decision_source(value: object) -> bool:
    kind = type(value)
    if kind not in _DECISION_SOURCES:
        _DECISION_SOURCES[kind] = isinstance(value, DecisionSource)
    return _DECISION_SOURCES[kind]


ABSENT: Final = object()
"""Value of a missing key."""


class PathDifference(NamedTuple):
    """A changed part of knowledge."""

    path: str
    before: object
    after: object


@cache
def _field_names(kind: Hashable) -> tuple[str, ...]:
    """Return the field names of a dataclass; empty for other types."""
    return tuple(one.name for one in fields(kind)) if is_dataclass(kind) else ()


_ATOMS: Final = frozenset({bool, int, float, str, bytes, tuple, Point, Pose})
"""Types compared as a whole."""


def differences(before: object, after: object, path: str = "") -> Iterator[PathDifference]:
    """Yield differences of two values by field and key, recursively for equal types; tuples as a whole."""
    if before is after:
        return
    kind: Any = type(after)
    is_alike = type(before) is kind
    if is_alike and (names := _field_names(kind)):
        for name in names:
            one, other = getattr(before, name), getattr(after, name)
            if one is other:
                continue
            there = f"{path}.{name}" if path else name
            if type(other) in _ATOMS:
                if one != other:
                    yield PathDifference(there, one, other)
            else:
                yield from differences(one, other, there)
    elif isinstance(before, Mapping) and isinstance(after, Mapping):
        for key in dict.fromkeys([*before, *after]):
            yield from differences(before.get(key, ABSENT), after.get(key, ABSENT), f"{path}[{key}]")
    elif before != after:
        yield PathDifference(path, before, after)


_JSON: Final = msgspec.json.Encoder(enc_hook=repr, order="deterministic")


def as_json(value: object) -> str | None:
    """Return a value of knowledge as JSON of limited length; None for ABSENT."""
    if value is ABSENT:
        return None
    text = _JSON.encode(value).decode()
    if len(text) <= _MAX_JSON:
        return text
    return msgspec.json.encode(f"{text[:_MAX_TEXT]}… ({len(text)} characters)").decode()


def short_text(value: object) -> str:
    """Return any value as text of limited length."""
    try:
        text = printable(value_text(value))
    except Exception as error:  # user code failed
        return f"cannot be shown: {type(error).__name__}"
    return text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]}…"


def value_text(value: Any, depth: int = 0) -> str:
    """Return a short text of a value: an item's key as "r1/3", a point as its coordinates."""
    key = value if isinstance(value, ItemKey) else getattr(value, "key", None)
    if isinstance(key, ItemKey):
        return str(key)
    if value is None or value == ():
        return "-"
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, Enum):
        return str(value.value)
    return _composite_text(value, depth)


def _composite_text(value: Any, depth: int) -> str:
    """Return a short text of a composed value."""
    kind: Any = type(value)
    names = _field_names(kind)
    if names:
        parts = [getattr(value, name) for name in names]
    elif isinstance(value, tuple | list | frozenset):
        parts = list(value)
    else:
        return str(value)
    if depth == _MAX_DEPTH:
        return "…"
    words = [value_text(one, depth + 1) for one in parts]
    if isinstance(value, frozenset):
        words.sort()
    return (", " if names or hasattr(value, "_fields") else " ").join(words)
