"""Lets a component of the DEECo model and its ensembles be the behaviour of a robot.

    def behaviour(start: Start) -> Behaviour:
        return host(start, MyRobot(id=start.robot, ...), MyEnsemble(max_distance=1.5))

The node's link is the robot's radio; its processes find Positioning, Navigation, TaskList, PlaceMonitor,
FloorPlan, Instant and the robot's random Generator by type.
"""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol, Self, runtime_checkable

from numpy.random import Generator

from actors.geometry import CERTAIN, Point, Pose
from actors.instant import START, Duration, Instant
from actors.messages import AccessFailure, Heard, Outgoing, Overflow, RadioEvent, Refused, Sent, Unconfirmed
from actors.robot.behaviour.decisions import DecisionLog, NodeReport, RobotLimits
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.ports import (
    Behaviour,
    Decision,
    FloorPlan,
    Goal,
    GoalOrder,
    GoalStatus,
    Navigation,
    PlaceMonitor,
    Plan,
    Positioning,
    Start,
    TaskList,
    View,
)
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport
from deeco import DeecoError, Knowledge
from deeco.knowledge import made
from deeco.link import Reception, Transmission
from deeco.network import NetworkParameters, RelayParameters
from deeco.node import Node

Order = dict[str, Any]
"""What was asked for in a step: fields of its Decision."""


class RobotPositioning:
    """Positioning as of the newest view."""

    def __init__(self, pose: Pose, order: Order) -> None:
        self.pose = pose
        self.covariance = CERTAIN
        self.is_lost = 0.0
        self.moving = False
        self._order = order

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.pose, self.moving = view.pose, view.moving
        self.covariance, self.is_lost = view.covariance, view.lost

    def disregard(self, peers: Sequence[Point]) -> None:
        """Mask range readings that end at other robots."""
        self._order["peers"] = tuple(peers)

    def relocalise(self) -> None:
        """Search for the robot on the whole map."""
        self._order["relocalise"] = True


class RobotNavigation:
    """Keeps the last order of a step, and shows it as carried out."""

    def __init__(self, order: Order) -> None:
        self.goal: Goal | None = None
        self.plan: Plan | None = None
        self.backing_out = False
        self._order = order

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.goal, self.plan, self.backing_out = view.goal, view.plan, view.backing_out

    def back_out(self, distance: float) -> None:
        """Drive backward along the own trail."""
        self._order["back_out"] = distance
        self.backing_out = True

    def go_to(self, point: Point) -> None:
        """Make `point` the goal."""
        self._order["goal"] = point
        self.plan = None
        self.goal = Goal(point, GoalStatus.ACTIVE)

    def stop(self) -> None:
        """Have no goal, and stand."""
        self._order["goal"] = GoalOrder.CANCEL
        self._order.pop("back_out", None)
        self.goal = self.plan = None
        self.backing_out = False

    def pause(self) -> None:
        """Stand, and keep the goal."""
        self._order["paused"] = True

    def resume(self) -> None:
        """Go on to the goal."""
        self._order["paused"] = False


class RobotTaskList:
    """What the robot has been given, up to the newest view."""

    def __init__(self, places: tuple[Point, ...], epoch: int) -> None:
        self.places = places
        self.at_start = len(places)
        self.epoch = epoch


class RobotPlaceMonitor:
    """Collects the reports about places during a step."""

    def __init__(self, order: Order) -> None:
        self.told: tuple[PlaceKey, ...] | None = None
        """The route as last reported; None: it is to be reported anew."""
        self._order = order

    def visited(self, place: PlaceKey, now: Instant) -> None:
        """Report that a place has been cleaned."""
        self._add("reports", PlaceReport(place.owner, place.place, now))

    def given_up(self, place: PlaceKey, reason: str, now: Instant) -> None:
        """Report that no robot is to try for a place any more, and why."""
        self._add("given_up", PlaceGivenUp(place.owner, place.place, now, reason))

    def remaining(self, route: Sequence[PlaceKey]) -> None:
        """Report the places still to be visited, in their order, unless they are those reported last."""
        keys = tuple(route)
        self._order["route"] = None if keys == self.told else keys

    def _add(self, field: str, report: PlaceReport | PlaceGivenUp) -> None:
        self._order[field] = (*self._order.get(field, ()), report)


_TAGS: Final = 2**32
"""Of one epoch."""
_BACKLOG: Final = 256
"""Frames that may wait for a later step; twice what the largest packet and as many relays need."""
_AT_ONCE: Final = RobotLimits().frames
"""Frames that a robot may send in a step."""
_OUTCOMES: Final[Mapping[type[Any], str]] = {
    Sent: "frames_sent",
    AccessFailure: "frames_access_failure",
    Overflow: "frames_overflow",
    Refused: "frames_refused",
    Unconfirmed: "frames_unconfirmed",
}


@runtime_checkable
class Resumable(Protocol):
    """A component that can go on where another one of the same robot has ended."""

    def inherits(self, former: Knowledge) -> Self | None:
        """The component with what it takes over of the other's knowledge; None if it can take nothing."""


def host(start: Start, component: Knowledge, *ensembles: object) -> Behaviour:
    """The behaviour of a robot that runs `component` with these ensembles on a node of its own.

    Raises BehaviourError if the node lacks something that they ask for.
    """
    return _Hosted(start, component, ensembles)


def take_over(heir: Behaviour, former: Behaviour, name: str) -> None:
    """Let a behaviour that has not begun go on where another one of this robot ends; `name` is for errors.

    Raises BehaviourError for those that are not made by `host`, and for components that cannot.
    """
    new, old = _hosted(heir), _hosted(former)
    if new is None or old is None or not new.succeed(old):
        raise BehaviourError(
            f"behaviour {name!r} cannot go on where another one ends: both should be components of the same "
            "kind, such as those of cleaning.robot.CleaningRobot"
        )


def node_of(behaviour: object) -> Node | None:
    """The node that a behaviour runs on at present, for those who look into a robot; None without one."""
    hosted = _hosted(behaviour)
    return None if hosted is None else hosted.node


def ensembles_of(behaviour: object) -> tuple[object, ...]:
    """The ensembles of that node, for the same people."""
    hosted = _hosted(behaviour)
    return () if hosted is None else hosted.ensembles


def _hosted(behaviour: object) -> "_Hosted | None":
    """The node's host in a behaviour, or in what that has laid around it and calls `hosted`."""
    while behaviour is not None and not isinstance(behaviour, _Hosted):
        behaviour = getattr(behaviour, "hosted", None)
    return behaviour


class _Hosted:
    """Translates between the robot's steps and the node's."""

    def __init__(self, start: Start, component: Knowledge, ensembles: Sequence[object]) -> None:
        self._start = start
        self._component = component
        self.ensembles = tuple(ensembles)
        self._phase = Duration(int(start.generator.integers(start.exchange.publish)))
        self._order = order = Order()
        self._positioning = RobotPositioning(start.pose, order)
        self._navigation = RobotNavigation(order)
        self._tasks = RobotTaskList(start.places, start.epoch)
        self._monitor = RobotPlaceMonitor(order)
        self._log = DecisionLog(component)
        self._counted: Counter[str] = Counter()
        self._backlog: deque[Transmission] = deque()
        self._tag = 0
        self._former: Node | None = None
        self.node = self._deploy(START)  # what is missing is said before the first step
        self._begun = False

    def succeed(self, former: "_Hosted") -> bool:
        """Go on where the robot's host so far ends; False if the component cannot. Before the first step."""
        component = self._component
        knowledge = former.node.knowledge(former._component.id)
        inherited = component.inherits(knowledge) if isinstance(component, Resumable) else None
        if inherited is None:
            return False
        self._component = inherited
        self._log = DecisionLog(inherited, former._log)
        self._counted, self._tag = former._counted, former._tag
        self._former = former.node
        return True

    def advance(self, view: View, until: Instant) -> Decision:
        """Let the node do what is due."""
        if not self._begun or view.instant > self.node.now:
            self._reach(view.instant)
        self._positioning.take(view)
        self._navigation.take(view)
        if view.places:
            self._tasks.places += view.places
            self._monitor.told = None  # the robot is taken to mean to visit them
        try:
            sent = self.node.advance(until, self._receptions(view.radio))
        except DeecoError as error:
            raise BehaviourError(str(error)) from error
        decision = Decision(frames=self._frames(sent, view.instant), **self._order)
        self._order.clear()
        if decision.route is not None:
            self._monitor.told = decision.route
        return decision

    def outcome(self) -> dict[str, object]:
        """Return what node and link counted, what the adaptation decided, and the component's own outcome."""
        counts = self.node.outcome()
        counts["counters"] |= dict(sorted(self._counted.items()))
        say = getattr(self.node.knowledge(self._component.id), "outcome", None)
        own = say() if callable(say) else {}
        return {**own, "deeco": NodeReport(**counts), "adaptation": self._log.report()}

    def _deploy(self, first: Instant) -> Node:
        start = self._start
        try:
            return Node(
                [self._component],
                self.ensembles,
                ports={
                    Positioning: self._positioning,
                    Navigation: self._navigation,
                    TaskList: self._tasks,
                    PlaceMonitor: self._monitor,
                    FloorPlan: start.floor,
                    Generator: start.generator,
                },
                parameters=_network(start),
                address=start.address,
                epoch=start.epoch,
                start=first,
                publish_phase=self._phase,
                witness=self._log.take,
                former=self._former,
            )
        except DeecoError as error:
            raise BehaviourError(str(error)) from error

    def _reach(self, instant: Instant) -> None:
        """The robot's first step is the node's start; after a gap, in which it was frozen, it goes on."""
        if not self._begun:
            self._begun = True
            if instant != self.node.now:
                self.node = self._deploy(instant)
        elif instant > self.node.now:
            self.node.skip(instant)

    def _receptions(self, events: Sequence[RadioEvent]) -> list[Reception]:
        heard: list[Reception] = []
        for event in events:
            if isinstance(event, Heard):
                heard += (made(Reception, (event.instant, event.sender, event.data, event.rssi_dbm)),)
            else:
                self._counted[_OUTCOMES[type(event)]] += 1
        return heard

    def _frames(self, sent: Sequence[Transmission], begin: Instant) -> tuple[Outgoing, ...]:
        """As many as a robot may send in a step; the others wait for the next one."""
        if not sent and not self._backlog:
            return ()
        self._backlog.extend(sent)
        while len(self._backlog) > _BACKLOG:
            self._backlog.pop()
            self._counted["frames_dropped"] += 1
        frames = []
        for _ in range(min(len(self._backlog), _AT_ONCE)):
            frame = self._backlog.popleft()
            self._tag = (self._tag + 1) % _TAGS
            tag, instant = self._start.epoch * _TAGS + self._tag, max(frame.instant, begin)
            frames.append(Outgoing(tag, instant, frame.data))
        return tuple(frames)


def _network(start: Start) -> NetworkParameters:
    exchange, relay = start.exchange, None
    if exchange.relay:
        relay = RelayParameters(
            hop_limit=exchange.hop_limit, longest=exchange.relay_delay, relay_below_dbm=exchange.relay_below
        )
    return NetworkParameters(publish_every=exchange.publish, forget_after=exchange.forget, relay=relay)
