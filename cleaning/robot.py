"""The cleaning robot of the model problem: the adapted layer, which knows of no other robot.

Processes, periods and the order of places are those of the chapter's Fig. 7.2 and of CleanerRobot in
d3scomp/deeco-adaptation-testbed. At one instant they run in the order in which they stand here.
"""

from collections.abc import Container
from typing import NamedTuple, Self

from actors.geometry import Point
from actors.robot.behaviour import (
    AbortReason,
    GoalStatus,
    Navigation,
    PlaceMonitor,
    Positioning,
    Start,
    TaskList,
)
from actors.task.task import PlaceKey
from cleaning.cleaner import Cleaner
from cleaning.parameters import CleaningParameters
from cleaning.place import Assignment, Takeover, assignments, since
from deeco import Instant, Knowledge, component, milliseconds, periodic, replace, seconds


class OrderedGoal(NamedTuple):
    """What navigation has been told to do."""

    point: Point
    attempt: int


@component
class CleaningRobot(Cleaner):
    """Visits the places of its route, in order."""

    parameters: CleaningParameters = CleaningParameters()
    route: tuple[Assignment, ...] = ()
    """What it means to visit; no place twice. `destination`, if there is one, is in it."""
    waypoint: Point | None = None
    """Where it heads for before anything else, m: any point, which is nobody's assignment."""
    settled: tuple[Takeover, ...] = ()
    """What it has visited or given up, and will not take on again."""
    more: int = 0
    """So many places it has been given since its start."""
    attempt: int = 0
    """Grows whenever navigation is to be told anew where to go, be it to the same point."""
    ordered: OrderedGoal | None = None
    """What navigation has been told last."""
    no_plans: int = 0
    """How often in a row navigation has found no way to the destination."""
    aborted: int = 0
    """How often in a row navigation has given the destination up."""

    @classmethod
    def at_start(cls, start: Start, parameters: CleaningParameters) -> Self:
        """The robot as it begins: at its start pose, with its own places in the order given."""
        route = assignments(start)
        return cls(id=start.robot, position=start.pose.point, route=route, parameters=parameters)

    @property
    def target(self) -> Point | None:
        """Where it wants to be, m."""
        if self.waypoint is not None:
            return self.waypoint
        return None if self.destination is None else self.destination.point

    def inherits(self, former: Knowledge) -> Self | None:
        """Go on where another cleaning robot's component ends; None for anything else.

        It keeps where the robot heads for, what it holds and has settled, and what it has told others to have
        taken over; the order of places is its own. A waypoint and an offered exchange were the other's.
        """
        if not isinstance(former, CleaningRobot):
            return None
        held = {one.key: one for one in former.route}
        own = [held.pop(one.key) for one in self.route if one.key in held]
        return replace(
            self,
            position=former.position,
            destination=former.destination,
            adopted=former.adopted,
            route=(*own, *held.values()),
            settled=former.settled,
            ordered=former.ordered,
            attempt=former.attempt + (former.waypoint is not None),
        )

    def decided_since(self, before: Self) -> str:
        """In words, for measuring: how it means to go on otherwise than before; empty if it does not."""
        words: list[str] = []
        if self.route is not before.route:
            held, holds = ({one.key for one in robot.route} for robot in (before, self))
            words += [f"takes over {_named(key)}" for key in sorted(holds - held, key=_named)]
            for key in sorted(held - holds, key=_named):
                words.append(f"{'gives up' if self.has_settled(key) else 'leaves to another'} {_named(key)}")
        if not words and self.attempt != before.attempt:
            words.append("stops" if self.target is None else "turns elsewhere")
        return ", ".join(words)

    @periodic(every=milliseconds(100), order=0)
    def sense(self, positioning: Positioning) -> Self:
        """Take over where the robot holds itself to be."""
        return replace(self, position=positioning.pose.point)

    @periodic(every=milliseconds(500), order=0)
    def take_on(self, tasks: TaskList) -> Self:
        """Put places that it has been given while the run went on into its route, the newest last."""
        new = since(tasks, self.id, tasks.at_start + self.more)
        return replace(self, route=self.route + new, more=self.more + len(new)) if new else self

    @periodic(every=milliseconds(500), order=1)
    def set_destination(self, monitor: PlaceMonitor, now: Instant) -> Self:
        """Tick off every place within reach, whether it is its turn or not; choose the next destination."""
        robot = self
        near = [assignment for assignment in self.route if self.reaches(assignment.point)]
        if near:
            for assignment in near:
                monitor.visited(assignment.key, now)
            robot = robot.without({assignment.key for assignment in near}, settled=True)
        if robot.waypoint is not None and robot.reaches(robot.waypoint):
            robot = replace(robot, waypoint=None)
        if robot.target is None and robot.route:
            robot = replace(robot, destination=robot.route[0])
        return robot

    @periodic(every=seconds(2), order=4)
    def drive(self, navigation: Navigation, monitor: PlaceMonitor, now: Instant) -> Self:
        """Tell navigation where to go if that is new, and again if it has given up.

        A robot that has visited its last place drives up to it. One whose destination was taken stops.
        """
        ordered = None if self.target is None else OrderedGoal(self.target, self.attempt)
        if ordered is None:
            if self.ordered is None or self.ordered.attempt == self.attempt:
                return self
            navigation.stop()
        elif ordered != self.ordered:
            navigation.go_to(ordered.point)
        else:
            return self._after_abort(ordered, navigation, monitor, now)
        return replace(self, ordered=ordered, no_plans=0, aborted=0)

    @periodic(every=seconds(1), order=5)
    def report_status(self, monitor: PlaceMonitor) -> Self:
        """Say which places are left."""
        monitor.remaining([assignment.key for assignment in self.route])
        return self

    def _after_abort(
        self, ordered: OrderedGoal, navigation: Navigation, monitor: PlaceMonitor, now: Instant
    ) -> Self:
        """What follows if navigation has given its goal up: another try, or none any more."""
        goal, p = navigation.goal, self.parameters
        if goal is None or goal.status is not GoalStatus.ABORTED:
            return self
        no_plans = self.no_plans + 1 if goal.reason is AbortReason.NO_PLAN else 0
        aborted, reason = self.aborted + 1, ""
        if 0 < p.no_plan_attempts <= no_plans:
            reason = f"navigation found no way to it, {no_plans} times in a row"
        elif 0 < p.aborted_attempts <= aborted:
            reason = f"navigation gave it up, {aborted} times in a row"
        if reason and self.destination is not None:
            return self.given_up(self.destination, reason, monitor, now)
        if p.retry:
            navigation.go_to(ordered.point)
        return replace(self, no_plans=no_plans, aborted=aborted)

    def holds(self, key: PlaceKey) -> bool:
        """True if the place is in its route."""
        return any(assignment.key == key for assignment in self.route)

    def has_settled(self, key: PlaceKey) -> bool:
        """True if it has visited the place or given it up."""
        return any(takeover.key == key for takeover in self.settled)

    def heading_for(self, assignment: Assignment | None) -> Self:
        """The robot on a new attempt, at a place of its route or, with None, at none for now."""
        return replace(self, destination=assignment, former=None, waypoint=None, attempt=self.attempt + 1)

    def sent_to(self, waypoint: Point) -> Self:
        """The robot on its way to any point, m, after which it goes on with the first place of its route."""
        return replace(self.heading_for(None), waypoint=waypoint)

    def given_up(self, assignment: Assignment, reason: str, monitor: PlaceMonitor, now: Instant) -> Self:
        """The robot without a place that nobody is to try for any more; 1 to 100 characters say why."""
        monitor.given_up(assignment.key, reason, now)
        robot = self.without({assignment.key}, settled=True)
        return robot if robot.destination == self.destination else robot.heading_for(None)

    def without(self, keys: Container[PlaceKey], *, settled: bool) -> Self:
        """The robot with these places out of its route, and with no destination if that was one of them."""
        gone = tuple(assignment.takeover for assignment in self.route if assignment.key in keys)
        left, former = self.destination, self.former
        return replace(
            self,
            route=tuple(assignment for assignment in self.route if assignment.key not in keys),
            settled=self.settled + gone if settled else self.settled,
            destination=None if left is not None and left.key in keys else left,
            former=None if former is not None and former.key in keys else former,
        )

    def reaches(self, point: Point) -> bool:
        """True if the robot is near enough to a point, m, to clean it."""
        return self.position.is_nearer(point, self.parameters.reach)


def _named(key: PlaceKey) -> str:
    return f"{key.owner}/{key.place}"
