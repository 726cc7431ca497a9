"""The naive solution: every robot visits its places in the order given, and takes no notice of the others.

d3scomp/deeco-adaptation-testbed, CleanerRobot, without detectBlocked, autoUnblock and the ensembles: what the
chapter calls its baseline.
"""

from dataclasses import dataclass, field

from actors.geometry import Point
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import Heard, Outgoing, PlaceKey, PlaceReport, RadioEvent
from actors.robot.ports import Behaviour, Decision, GoalOrder, GoalStatus, Start, View
from cleaning.knowledge import Knowledge, WorkState, pack, unpack
from cleaning.rhythm import Rhythm


@dataclass(frozen=True)
class BaselineParameters:
    """The numbers of the naive solution; those of the testbed unless said otherwise."""

    reach: float = 0.5
    """A place nearer than this is visited, m (REACHED_POS_THRESH_M)."""
    checking: Duration = field(default=milliseconds(500))
    """Period of looking for visited places and of choosing the destination (setDestination)."""
    publishing: Duration = field(default=milliseconds(1000))
    """Period of sending the own knowledge (JDEECo, DefaultKnowledgePublisher)."""
    retry: Duration = field(default=seconds(2))
    """After so long a destination that navigation gave up is asked for again: the period of driveRobot. The
    testbed never does; here a robot does not stand for ever because of what has gone meanwhile."""


def behaviour(start: Start) -> Behaviour:
    """The naive solution with the testbed's numbers."""
    return Baseline(start)


class Baseline:
    """Visits the places of one robot."""

    def __init__(self, start: Start, parameters: BaselineParameters = BaselineParameters()) -> None:
        self._id = start.robot
        self._p = parameters
        self._route = list(enumerate(start.places))
        self._destination: Point | None = None
        self._given_up: Instant | None = None
        self._order: Point | GoalOrder = GoalOrder.KEEP
        phase = int(start.generator.integers(parameters.publishing))
        self._checks = Rhythm(parameters.checking)
        self._publications = Rhythm(parameters.publishing, phase)
        self._published = 0
        self.heard = 0
        """Frames with another robot's knowledge."""
        self.junk = 0
        """Frames with anything else."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Listen, report what was visited, choose where to go, and publish."""
        before = self._route
        self._listen(view.radio)
        self._order = GoalOrder.KEEP
        reports: list[PlaceReport] = []
        for instant in self._checks.due(view.instant, until):
            reports += self._visited(view, instant)
            self._choose(view, instant)
        frames = [self._publication(view, now) for now in self._publications.due(view.instant, until)]
        route = tuple(PlaceKey(self._id, index) for index, _ in self._route)
        said = None if self._route is before else route
        return Decision(self._order, tuple(frames), tuple(reports), route=said)

    def _listen(self, events: tuple[RadioEvent, ...]) -> None:
        for event in events:
            if not isinstance(event, Heard):
                continue
            if unpack(event.data) is None:
                self.junk += 1
            else:
                self.heard += 1

    def _visited(self, view: View, instant: Instant) -> list[PlaceReport]:
        """Reports of all own places that are near, in whatever order they were to come."""
        here = view.pose.point
        near = [index for index, place in self._route if place.distance_to(here) < self._p.reach]
        if near:
            self._route = [entry for entry in self._route if entry[0] not in near]
        return [PlaceReport(self._id, index, instant) for index in near]

    def _choose(self, view: View, instant: Instant) -> None:
        """The next destination once there is none or it is near; the same again if it was given up."""
        destination = self._destination
        if destination is None or destination.distance_to(view.pose.point) < self._p.reach:
            self._destination = self._route[0][1] if self._route else None
            self._given_up = None
            if self._destination is not None:
                self._order = self._destination
            return
        if view.goal is None or view.goal.status is not GoalStatus.ABORTED:
            self._given_up = None
        elif self._given_up is None:
            self._given_up = instant
        elif instant - self._given_up >= self._p.retry:
            self._given_up = None
            self._order = destination

    def _publication(self, view: View, instant: Instant) -> Outgoing:
        self._published += 1
        knowledge = Knowledge(self._id, view.pose.point, self._destination, self._state(view))
        return Outgoing(self._published, instant, pack(knowledge))

    def _state(self, view: View) -> WorkState:
        if self._destination is None:
            return WorkState.IDLE
        blocked = view.goal is not None and view.goal.status is GoalStatus.ABORTED
        return WorkState.BLOCKED if blocked else WorkState.DRIVING
