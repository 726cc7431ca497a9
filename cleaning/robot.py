"""The cleaning robot of the model problem without adaptation; ignores other robots.

Processes, periods and the order of places are those of the chapter's Fig. 7.2 and of CleanerRobot in
d3scomp/deeco-adaptation-testbed. At the same instant, processes run in the order of this module.
"""

from collections.abc import Container
from typing import NamedTuple, Self

from actors.geometry import Point
from actors.items import ItemKey
from actors.robot.behaviour import (
    AbortReason,
    GoalStatus,
    Navigation,
    Positioning,
    Start,
    TaskList,
    TaskMonitor,
)
from cleaning.cleaner import Cleaner
from cleaning.parameters import CleaningParameters
from cleaning.place import Assignment, Takeover, assignments, assignments_since, visit_report
from deeco import Instant, Knowledge, component, milliseconds, periodic, replace, seconds


class RequestedGoal(NamedTuple):
    """A goal sent to navigation."""

    point: Point
    attempt: int


@component
class CleaningRobot(Cleaner):
    """A robot that visits the places of its route in order."""

    parameters: CleaningParameters = CleaningParameters()
    route: tuple[Assignment, ...] = ()
    """Places to visit, without duplicates; includes `destination`."""
    waypoint: Point | None = None
    """Point to visit before the destination, m; not an assignment."""
    settled: tuple[Takeover, ...] = ()
    """Places visited or given up."""
    more: int = 0
    """Number of places added since the start."""
    attempt: int = 0
    """Number of the navigation attempt; an increment sends the goal again."""
    ordered: RequestedGoal | None = None
    """The goal sent to navigation last."""
    no_plans: int = 0
    """Consecutive aborts because of `no plan`."""
    aborted: int = 0
    """Consecutive aborts."""

    @classmethod
    def at_start(cls, start: Start, parameters: CleaningParameters) -> Self:
        """Return the robot at its start pose, with its own places in order."""
        route = assignments(start)
        return cls(id=start.robot, position=start.pose.point, route=route, parameters=parameters)

    @property
    def target(self) -> Point | None:
        """Current target, m: the waypoint, otherwise the destination."""
        if self.waypoint is not None:
            return self.waypoint
        return None if self.destination is None else self.destination.point

    def inherits(self, former: Knowledge) -> Self | None:
        """Return the robot with the state of a previous cleaning robot; None for other components.

        Resumes destination, route, settled and adopted places; places keep this component's order. Waypoint
        and offered exchange are dropped.
        """
        if not isinstance(former, CleaningRobot):
            return None
        former_places = {one.key: one for one in former.route}
        own = [former_places.pop(one.key) for one in self.route if one.key in former_places]
        return replace(
            self,
            position=former.position,
            destination=former.destination,
            adopted=former.adopted,
            route=(*own, *former_places.values()),
            settled=former.settled,
            ordered=former.ordered,
            attempt=former.attempt + (former.waypoint is not None),
        )

    def decided_since(self, before: Self) -> str:
        """Return a description of changed plans since `before`, for results; empty if there are none."""
        words: list[str] = []
        if self.route is not before.route:
            former_places, holds = ({one.key for one in robot.route} for robot in (before, self))
            words += [f"takes over {key}" for key in sorted(holds - former_places, key=str)]
            for key in sorted(former_places - holds, key=str):
                words.append(f"{'gives up' if self.has_settled(key) else 'hands over'} {key}")
        if not words and self.attempt != before.attempt:
            words.append("stops" if self.target is None else "changes destination")
        return ", ".join(words)

    @periodic(every=milliseconds(100), order=0)
    def sense(self, positioning: Positioning) -> Self:
        """Update the position from the pose estimate."""
        return replace(self, position=positioning.pose.point)

    @periodic(every=milliseconds(500), order=0)
    def take_on(self, tasks: TaskList) -> Self:
        """Append places that were added during the run to the route."""
        new = assignments_since(tasks, self.id, tasks.at_start + self.more)
        return replace(self, route=self.route + new, more=self.more + len(new)) if new else self

    @periodic(every=milliseconds(500), order=1)
    def set_destination(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Mark all places within reach as visited, in any order; choose the next destination."""
        robot = self
        near = [assignment for assignment in self.route if self.reaches(assignment.point)]
        if near:
            for assignment in near:
                monitor.report(visit_report(assignment.key, now))
            robot = robot.without({assignment.key for assignment in near}, settled=True)
        if robot.waypoint is not None and robot.reaches(robot.waypoint):
            robot = replace(robot, waypoint=None)
        if robot.target is None and robot.route:
            robot = replace(robot, destination=robot.route[0])
        return robot

    @periodic(every=seconds(2), order=4)
    def drive(self, navigation: Navigation, monitor: TaskMonitor, now: Instant) -> Self:
        """Send a new goal to navigation, and an aborted goal again.

        A robot that has visited its last place drives on to its centre; one that lost its destination stops.
        """
        ordered = None if self.target is None else RequestedGoal(self.target, self.attempt)
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
    def report_status(self, monitor: TaskMonitor) -> Self:
        """Report the places of the route."""
        monitor.remaining([assignment.key for assignment in self.route])
        return self

    def _after_abort(
        self, ordered: RequestedGoal, navigation: Navigation, monitor: TaskMonitor, now: Instant
    ) -> Self:
        """Return the robot after an aborted goal: retries, or gives the place up at the limit."""
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

    def holds(self, key: ItemKey) -> bool:
        """Return True if the place is in its route."""
        return any(assignment.key == key for assignment in self.route)

    def has_settled(self, key: ItemKey) -> bool:
        """Return True if it has visited the place or given it up."""
        return any(takeover.key == key for takeover in self.settled)

    def heading_for(self, assignment: Assignment | None) -> Self:
        """Return the robot with a new destination from its route, or none, and a new attempt."""
        return replace(self, destination=assignment, former=None, waypoint=None, attempt=self.attempt + 1)

    def sent_to(self, waypoint: Point) -> Self:
        """Return the robot on its way to a waypoint, m, before the first place of its route."""
        return replace(self.heading_for(None), waypoint=waypoint)

    def given_up(self, assignment: Assignment, reason: str, monitor: TaskMonitor, now: Instant) -> Self:
        """Return the robot without a place that no robot should try again; `reason`: 1 to 100 characters."""
        monitor.given_up(assignment.key, reason, now)
        robot = self.without({assignment.key}, settled=True)
        return robot if robot.destination == self.destination else robot.heading_for(None)

    def without(self, keys: Container[ItemKey], *, settled: bool) -> Self:
        """Return the robot without these places in route and destination."""
        removed = tuple(assignment.takeover for assignment in self.route if assignment.key in keys)
        destination, former = self.destination, self.former
        return replace(
            self,
            route=tuple(assignment for assignment in self.route if assignment.key not in keys),
            settled=self.settled + removed if settled else self.settled,
            destination=None if destination is not None and destination.key in keys else destination,
            former=None if former is not None and former.key in keys else former,
        )

    def reaches(self, point: Point) -> bool:
        """Return True if the robot is near enough to a point, m, to clean it."""
        return self.position.is_nearer(point, self.parameters.reach)
