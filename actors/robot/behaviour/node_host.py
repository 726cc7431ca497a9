"""Adapter that runs a DEECo component and its ensembles as the behaviour of a robot.

    def behaviour(start: Start) -> Behaviour:
        return host(start, MyRobot(id=start.robot, ...), MyEnsemble(max_distance=1.5))

The node communicates over the robot's radio. Its processes may use these ports, selected by type:
Positioning, Navigation, BatteryMeter, TaskList, TaskMonitor, FloorPlan, Instant and the robot's random
Generator.
"""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol, Self, runtime_checkable

from numpy.random import Generator

from actors.geometry import CERTAIN, Point, Pose
from actors.installation.usage import command_name
from actors.instant import START, Duration, Instant
from actors.items import ItemGivenUp, ItemKey
from actors.messages import (
    AccessFailure,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    OutgoingFrame,
    RadioEvent,
)
from actors.robot.behaviour.decisions import DecisionLog, NodeReport, RobotLimits
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.ports import (
    BatteryMeter,
    Behaviour,
    Decision,
    FloorPlan,
    Goal,
    GoalOrder,
    GoalStatus,
    Navigation,
    Plan,
    Positioning,
    Start,
    TaskList,
    TaskMonitor,
    View,
)
from actors.topic import MessagePart
from deeco import DeecoError, Knowledge
from deeco.knowledge import replace
from deeco.link import Transmission
from deeco.network import NetworkParameters, RelayParameters
from deeco.node import Node
from deeco.packet import PacketAuthenticator

DecisionFields = dict[str, Any]
"""Requests of a step: fields of its Decision."""


class RobotPositioning:
    """Implementation of Positioning: values of the newest view."""

    def __init__(self, pose: Pose, fields: DecisionFields) -> None:
        self.pose = pose
        self.covariance = CERTAIN
        self.lost_probability = 0.0
        self.moving = False
        self._fields = fields

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.pose, self.moving = view.pose, view.moving
        self.covariance, self.lost_probability = view.covariance, view.lost

    def disregard(self, peers: Sequence[Point]) -> None:
        """Mask range readings that end at other robots."""
        self._fields["peers"] = tuple(peers)

    def relocalise(self) -> None:
        """Search the whole map for the robot's pose."""
        self._fields["relocalise"] = True


class RobotNavigation:
    """Implementation of Navigation: values of the newest view, updated by requests of the step."""

    def __init__(self, fields: DecisionFields) -> None:
        self.goal: Goal | None = None
        self.plan: Plan | None = None
        self.backing_out = False
        self._fields = fields

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.goal, self.plan, self.backing_out = view.goal, view.plan, view.backing_out

    def back_out(self, distance: float) -> None:
        """Drive backward along the robot's trail."""
        self._fields["back_out"] = distance
        self.backing_out = True

    def go_to(self, point: Point) -> None:
        """Set the goal."""
        self._fields["goal"] = point
        self.plan = None
        self.goal = Goal(point, GoalStatus.ACTIVE)

    def stop(self) -> None:
        """Stop and clear the goal."""
        self._fields["goal"] = GoalOrder.CANCEL
        self._fields.pop("back_out", None)
        self.goal = self.plan = None
        self.backing_out = False

    def pause(self) -> None:
        """Stop and keep the goal."""
        self._fields["paused"] = True

    def resume(self) -> None:
        """Continue to the goal."""
        self._fields["paused"] = False


class RobotBatteryMeter:
    """Implementation of BatteryMeter: value of the newest view."""

    charge: float | None = None


class RobotTaskList:
    """Implementation of TaskList: items up to the newest view."""

    def __init__(self, items: tuple[Any, ...], epoch: int) -> None:
        self.items = items
        self.at_start = len(items)
        self.epoch = epoch


class RobotTaskMonitor:
    """Implementation of TaskMonitor: reports of the current step."""

    def __init__(self, fields: DecisionFields) -> None:
        self.reported: tuple[ItemKey, ...] | None = None
        """The route reported last; None: report it again."""
        self._fields = fields

    def report(self, report: MessagePart) -> None:
        """Send a report of the task's own type."""
        self._add("reports", report)

    def given_up(self, item: ItemKey, reason: str, now: Instant) -> None:
        """Report that no robot should try an item again, with a reason."""
        self._add("given_up", ItemGivenUp(item.owner, item.number, now, reason))

    def remaining(self, route: Sequence[ItemKey]) -> None:
        """Report the items that it still plans to do, in order, if they have changed."""
        keys = tuple(route)
        self._fields["route"] = None if keys == self.reported else keys

    def _add(self, field: str, report: MessagePart) -> None:
        self._fields[field] = (*self._fields.get(field, ()), report)


_NO_REQUESTS: Final = Decision()
_TAGS: Final = 2**32
"""Tags of one epoch."""
_MAX_BACKLOG: Final = 256
"""Frames that may wait for a later step; twice the need of the largest packet and as many relays."""
_FRAMES_PER_STEP: Final = RobotLimits().frames
"""Frames that a robot may send in a step."""
_OUTCOMES: Final[Mapping[type[Any], str]] = {
    FrameSent: "frames_sent",
    AccessFailure: "frames_access_failure",
    FrameOverflow: "frames_overflow",
    FrameRefused: "frames_refused",
    FrameUnconfirmed: "frames_unconfirmed",
}


@runtime_checkable
class Resumable(Protocol):
    """A component that can resume the state of a previous component of the robot."""

    def inherits(self, former: Knowledge) -> Self | None:
        """Return the component with knowledge of `former`; None if it cannot resume it."""


def host(start: Start, component: Knowledge, *ensembles: object) -> Behaviour:
    """Return a behaviour that runs `component` and these ensembles on a node.

    Raises BehaviourError if they need a port that the node does not have.
    """
    return _NodeBehaviour(start, component, ensembles)


def take_over(successor: Behaviour, former: Behaviour, name: str) -> None:
    """Let a new behaviour resume the state of the robot's previous one; `name` is used in errors.

    Raises BehaviourError if one of them was not made by `host` or the component cannot resume the other.
    """
    new, old = _node_behaviour(successor), _node_behaviour(former)
    if new is None or old is None or not new.resume(old):
        raise BehaviourError(
            f"behaviour {name!r} cannot resume the previous behaviour; both should be components of the same "
            "kind, such as subclasses of cleaning.robot.CleaningRobot"
        )


def node_of(behaviour: object) -> Node | None:
    """Return the node of a behaviour, for introspection; None if it has none."""
    hosted = _node_behaviour(behaviour)
    return None if hosted is None else hosted.node


def ensembles_of(behaviour: object) -> tuple[object, ...]:
    """Return the ensembles of a behaviour's node, for introspection."""
    hosted = _node_behaviour(behaviour)
    return () if hosted is None else hosted.ensembles


def _node_behaviour(behaviour: object) -> "_NodeBehaviour | None":
    """Return the host in a behaviour or in the behaviours that it wraps (attribute `hosted`)."""
    while behaviour is not None and not isinstance(behaviour, _NodeBehaviour):
        behaviour = getattr(behaviour, "hosted", None)
    return behaviour


class _NodeBehaviour:
    """A behaviour that runs a node."""

    def __init__(self, start: Start, component: Knowledge, ensembles: Sequence[object]) -> None:
        self._start = start
        self._component = component
        self.ensembles = tuple(ensembles)
        self._phase = Duration(int(start.generator.integers(start.exchange.publish)))
        self._fields = fields = DecisionFields()
        self._positioning = RobotPositioning(start.pose, fields)
        self._navigation = RobotNavigation(fields)
        self._meter = RobotBatteryMeter()
        self._tasks = RobotTaskList(start.items, start.epoch)
        self._monitor = RobotTaskMonitor(fields)
        self._log = DecisionLog(component)
        self._frame_counts: Counter[str] = Counter()
        self._backlog: deque[Transmission] = deque()
        self._tag = 0
        self._former: Node | None = None
        self.node = self._deploy(START)  # report missing ports before the first step
        self._is_started = False

    def resume(self, former: "_NodeBehaviour") -> bool:
        """Resume the state of the previous host, before the first step; False if the component cannot."""
        component = self._component
        knowledge = former.node.knowledge(former._component.id)
        inherited = component.inherits(knowledge) if isinstance(component, Resumable) else None
        if inherited is None:
            return False
        self._component = inherited
        self._log = DecisionLog(inherited, former._log)
        self._frame_counts, self._tag = former._frame_counts, former._tag
        self._former = former.node
        return True

    def advance(self, view: View, until: Instant) -> Decision:
        """Advance the node to `until`."""
        if not self._is_started or view.instant > self.node.now:
            self._start_or_skip(view.instant)
        self._positioning.take(view)
        self._navigation.take(view)
        self._meter.charge = view.battery
        if view.items:
            self._tasks.items += view.items
            self._monitor.reported = None  # the judge counts new items as part of the route
        try:
            sent = self.node.advance(until, self._receptions(view.radio))
        except DeecoError as error:
            raise BehaviourError(str(error)) from error
        frames = self._frames(sent, view.instant)
        if not frames and not self._fields:
            return _NO_REQUESTS
        decision = replace(_NO_REQUESTS, frames=frames, **self._fields)
        self._fields.clear()
        if decision.route is not None:
            self._monitor.reported = decision.route
        return decision

    def outcome(self) -> dict[str, object]:
        """Return counts of node and link, decisions of the adaptation, and the component's outcome."""
        counts = self.node.outcome()
        counts["counters"] |= dict(sorted(self._frame_counts.items()))
        outcome = getattr(self.node.knowledge(self._component.id), "outcome", None)
        results = outcome() if callable(outcome) else {}
        return {**results, "deeco": NodeReport(**counts), "adaptation": self._log.report()}

    def _deploy(self, first: Instant) -> Node:
        start = self._start
        try:
            return Node(
                [self._component],
                self.ensembles,
                ports={
                    Positioning: self._positioning,
                    Navigation: self._navigation,
                    BatteryMeter: self._meter,
                    TaskList: self._tasks,
                    TaskMonitor: self._monitor,
                    FloorPlan: start.floor,
                    Generator: start.generator,
                },
                parameters=network_parameters(start),
                address=start.address,
                epoch=start.epoch,
                start=first,
                publish_phase=self._phase,
                on_commit=self._log.take,
                previous=self._former,
            )
        except DeecoError as error:
            raise BehaviourError(str(error)) from error

    def _start_or_skip(self, instant: Instant) -> None:
        """Start the node at the robot's first step, or skip a gap in which the robot was frozen."""
        if not self._is_started:
            self._is_started = True
            if instant != self.node.now:
                self.node = self._deploy(instant)
        elif instant > self.node.now:
            self.node.skip(instant)

    def _receptions(self, events: Sequence[RadioEvent]) -> Sequence[FrameReceived]:
        receptions = [event for event in events if type(event) is FrameReceived]
        if len(receptions) < len(events):
            outcomes = [type(event) for event in events if type(event) is not FrameReceived]
            self._frame_counts.update([_OUTCOMES[kind] for kind in outcomes])
        return receptions

    def _frames(self, sent: Sequence[Transmission], begin: Instant) -> tuple[OutgoingFrame, ...]:
        """Return as many frames as a robot may send in a step; others wait."""
        if not sent and not self._backlog:
            return ()
        self._backlog.extend(sent)
        while len(self._backlog) > _MAX_BACKLOG:
            self._backlog.pop()
            self._frame_counts["frames_dropped"] += 1
        frames = []
        for _ in range(min(len(self._backlog), _FRAMES_PER_STEP)):
            frame = self._backlog.popleft()
            self._tag = (self._tag + 1) % _TAGS
            tag, instant = self._start.epoch * _TAGS + self._tag, max(frame.instant, begin)
            frames.append(OutgoingFrame(tag, instant, frame.data))
        return tuple(frames)


def network_parameters(start: Start) -> NetworkParameters:
    """Return the parameters of a node for the robot's exchange of knowledge. Raises BehaviourError."""
    exchange, relay = start.exchange, None
    if exchange.relay:
        relay = RelayParameters(
            hop_limit=exchange.hop_limit, max_delay=exchange.relay_delay, relay_below_dbm=exchange.relay_below
        )
    return NetworkParameters(
        publish_every=exchange.publish,
        forget_after=exchange.forget,
        relay=relay,
        authenticator=None if exchange.key is None else _authenticator(exchange.key),
    )


def _authenticator(key: str) -> PacketAuthenticator:
    try:
        from deeco.aes_ccm import AesCcmAuthenticator  # noqa: PLC0415  # optional package
    except ModuleNotFoundError:
        raise BehaviourError(
            "deeco.key requires the Python package cryptography; install it with "
            f"`{command_name()} add cryptography`, or remove the key"
        ) from None
    return AesCcmAuthenticator(bytes.fromhex(key))
