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


class RobotPositioning:
    """Positioning as of the newest view."""

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self.covariance = CERTAIN
        self.is_lost = 0.0
        self.moving = False
        self._peers: tuple[Point, ...] | None = None
        self._relocalise = False

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.pose, self.moving = view.pose, view.moving
        self.covariance, self.is_lost = view.covariance, view.lost

    def disregard(self, peers: Sequence[Point]) -> None:
        """Do not believe range readings that end at other robots."""
        self._peers = tuple(peers)

    def relocalise(self) -> None:
        """Look for the robot all over the map."""
        self._relocalise = True

    def give(self) -> tuple[tuple[Point, ...] | None, bool]:
        """What was said in the step of where others are, None if nothing was; and whether to look anew."""
        peers, self._peers = self._peers, None
        relocalise, self._relocalise = self._relocalise, False
        return peers, relocalise


class RobotNavigation:
    """Keeps the last order of a step, and shows it as carried out."""

    def __init__(self) -> None:
        self.goal: Goal | None = None
        self._order: Point | GoalOrder = GoalOrder.KEEP
        self._paused: bool | None = None
        self.plan: Plan | None = None
        self.backing_out = False
        self._back_out: float | None = None

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.goal, self.plan, self.backing_out = view.goal, view.plan, view.backing_out

    def back_out(self, distance: float) -> None:
        """Drive backward along the own trail."""
        self._back_out = distance
        self.backing_out = True

    def go_to(self, point: Point) -> None:
        """Make `point` the goal."""
        self._order = point
        self.plan = None
        self.goal = Goal(point, GoalStatus.ACTIVE)

    def stop(self) -> None:
        """Have no goal, and stand."""
        self._order = GoalOrder.CANCEL
        self.goal = self.plan = self._back_out = None
        self.backing_out = False

    def pause(self) -> None:
        """Stand, and keep the goal."""
        self._paused = True

    def resume(self) -> None:
        """Go on to the goal."""
        self._paused = False

    def give(self) -> tuple[Point | GoalOrder, bool | None, float | None]:
        """The step's order, whether to stand, how far to back out; None if nothing was said of that."""
        order, self._order = self._order, GoalOrder.KEEP
        paused, self._paused = self._paused, None
        back_out, self._back_out = self._back_out, None
        return order, paused, back_out


class RobotTaskList:
    """What the robot has been given, up to the newest view."""

    def __init__(self, places: tuple[Point, ...], epoch: int) -> None:
        self.places = places
        self.at_start = len(places)
        self.epoch = epoch

    def take(self, view: View) -> None:
        """Take in the view of a new step."""
        self.places += view.places


class RobotPlaceMonitor:
    """Collects what is said of places during a step."""

    def __init__(self) -> None:
        self._reports: list[PlaceReport] = []
        self._given_up: list[PlaceGivenUp] = []
        self._route: tuple[PlaceKey, ...] | None = None
        self._told: tuple[PlaceKey, ...] | None = None

    def take(self) -> None:
        """The robot is given places: it is taken to mean to visit them, so say anew."""
        self._told = None

    def visited(self, place: PlaceKey, now: Instant) -> None:
        """Say that a place has been cleaned."""
        self._reports.append(PlaceReport(place.owner, place.place, now))

    def given_up(self, place: PlaceKey, reason: str, now: Instant) -> None:
        """Say that nobody is to try for a place any more, and why."""
        self._given_up.append(PlaceGivenUp(place.owner, place.place, now, reason))

    def remaining(self, route: Sequence[PlaceKey]) -> None:
        """Say which places the robot still means to visit, in their order."""
        self._route = tuple(route)

    def give(self) -> tuple[tuple[PlaceReport, ...], tuple[PlaceGivenUp, ...], tuple[PlaceKey, ...] | None]:
        """The step's reports, places given up, and the route if it is not what was told before."""
        reports, self._reports = tuple(self._reports), []
        given_up, self._given_up = tuple(self._given_up), []
        route, self._route = self._route, None
        if route == self._told:
            return reports, given_up, None
        self._told = route if route is not None else self._told
        return reports, given_up, route


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
class Heir(Protocol):
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
        self._ensembles = ensembles
        self._phase = Duration(int(start.generator.integers(start.exchange.publish)))
        self._positioning = RobotPositioning(start.pose)
        self._navigation = RobotNavigation()
        self._tasks = RobotTaskList(start.places, start.epoch)
        self._monitor = RobotPlaceMonitor()
        self._log = DecisionLog(component)
        self._counted: Counter[str] = Counter()
        self._backlog: deque[Transmission] = deque()
        self._tag = 0
        self._former: Node | None = None
        self._node = self._deploy(START)  # what is missing is said before the first step
        self._begun = False

    @property
    def node(self) -> Node:
        """The robot's node; for those who execute a robot again to look into it."""
        return self._node

    @property
    def ensembles(self) -> tuple[object, ...]:
        """The ensembles of that node, for the same people."""
        return tuple(self._ensembles)

    def succeed(self, former: "_Hosted") -> bool:
        """Go on where the robot's host so far ends; False if the component cannot. Before the first step."""
        component = self._component
        knowledge = former._node.knowledge(former._component.id)
        inherited = component.inherits(knowledge) if isinstance(component, Heir) else None
        if inherited is None:
            return False
        self._component = inherited
        self._log = DecisionLog(inherited, former._log)
        self._counted, self._tag = former._counted, former._tag
        self._former = former._node
        return True

    def advance(self, view: View, until: Instant) -> Decision:
        """Let the node do what is due."""
        if not self._begun or view.instant > self._node.now:
            self._reach(view.instant)
        self._positioning.take(view)
        self._navigation.take(view)
        if view.places:
            self._tasks.take(view)
            self._monitor.take()
        try:
            sent = self._node.advance(until, self._receptions(view.radio))
        except DeecoError as error:
            raise BehaviourError(str(error)) from error
        frames = self._frames(sent, view.instant)
        reports, given_up, route = self._monitor.give()
        goal, paused, back_out = self._navigation.give()
        peers, relocalise = self._positioning.give()
        return Decision(
            goal=goal,
            frames=frames,
            reports=reports,
            given_up=given_up,
            route=route,
            paused=paused,
            peers=peers,
            back_out=back_out,
            relocalise=relocalise,
        )

    def outcome(self) -> dict[str, object]:
        """Return what node and link counted, what the adaptation decided, and the component's own outcome."""
        counts = self._node.outcome()
        counts["counters"] |= dict(sorted(self._counted.items()))
        say = getattr(self._node.knowledge(self._component.id), "outcome", None)
        own = say() if callable(say) else {}
        return {**own, "deeco": NodeReport(**counts), "adaptation": self._log.report()}

    def _deploy(self, first: Instant) -> Node:
        start = self._start
        try:
            return Node(
                [self._component],
                self._ensembles,
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
            if instant != self._node.now:
                self._node = self._deploy(instant)
        elif instant > self._node.now:
            self._node.skip(instant)

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
        number = min(len(self._backlog), _AT_ONCE)
        return tuple(self._outgoing(self._backlog.popleft(), begin) for _ in range(number))

    def _outgoing(self, frame: Transmission, begin: Instant) -> Outgoing:
        self._tag = (self._tag + 1) % _TAGS
        return Outgoing(self._start.epoch * _TAGS + self._tag, max(frame.instant, begin), frame.data)


def _network(start: Start) -> NetworkParameters:
    exchange = start.exchange
    relay = None
    if exchange.relay:
        relay = RelayParameters(
            hop_limit=exchange.hop_limit,
            longest=exchange.relay_delay,
            relay_below_dbm=exchange.relay_below,
        )
    return NetworkParameters(publish_every=exchange.publish, forget_after=exchange.forget, relay=relay)
