"""What a process of a component on a robot may ask for, by the type of a parameter.

Beside these, a node on a robot provides `Instant` (now) and the behaviour's own `numpy.random.Generator`.
"""

from collections.abc import Sequence
from typing import Protocol

from actors.floor.door import Door
from actors.geometry import Covariance, Point, Pose
from actors.instant import Instant
from actors.robot.behaviour.plan import Goal, Plan
from actors.task.task import PlaceKey


class Positioning(Protocol):
    """Where the robot holds itself to be, and whether it moves."""

    @property
    def pose(self) -> Pose:
        """m and rad, map frame, at the start of the step."""

    @property
    def covariance(self) -> Covariance:
        """How far the pose is to be trusted: of x, y and heading, row by row, m², m·rad, rad²."""

    @property
    def is_lost(self) -> float:
        """The probability that the robot is somewhere else altogether, 0 to 1, by what its scans say.

        Above 0.95 it is time to act on it: `acrc verify localisation` counts how seldom that is wrong. The
        odometry alone never finds out, and says 0.
        """

    @property
    def moving(self) -> bool:
        """True while the base reports more than a creeping speed."""

    def disregard(self, peers: Sequence[Point]) -> None:
        """From the next step on, do not believe range readings that end at other robots, which are there.

        m, map frame. They replace those given before; none at all: believe every reading.
        """

    def relocalise(self) -> None:
        """Forget the pose, and look for it all over the map: for a robot that knows that it is lost.

        Until it has seen enough, `is_lost` is high and the pose anything. Without effect on odometry alone.
        """


class Navigation(Protocol):
    """Drives the robot to one goal at a time; an order takes effect with the next step."""

    @property
    def goal(self) -> Goal | None:
        """The last goal, how it stands and why; None before the first one and after `stop`."""

    @property
    def plan(self) -> Plan | None:
        """The way that navigation follows, with distance and time to go; None while there is none."""

    @property
    def backing_out(self) -> bool:
        """True while it backs out because it was told to."""

    def back_out(self, distance: float) -> None:
        """Drive backward along the own trail by `distance`, m, above 0 and at most FARTHEST_BACK.

        It ends early where the trail does, and where something stands behind. A goal waits for that.
        """

    def go_to(self, point: Point) -> None:
        """Make `point`, m in the map frame, the goal, also if it is the goal already: a new attempt."""

    def stop(self) -> None:
        """Have no goal, and stand."""

    def pause(self) -> None:
        """Stand, and keep the goal, also one that is given later, until `resume`."""

    def resume(self) -> None:
        """Go on to the goal, with all patience anew."""


class TaskList(Protocol):
    """The places that the robot has to clean; more may come while the run goes on."""

    @property
    def places(self) -> Sequence[Point]:
        """All that it has been given so far, m, map frame: those of its Start, then what came, in order.

        The index of a place in it is that of its PlaceKey.
        """

    @property
    def at_start(self) -> int:
        """So many of them are those of its Start."""

    @property
    def epoch(self) -> int:
        """How often the robot has been restarted; a new process is told of all places again."""


class PlaceMonitor(Protocol):
    """Takes down, for the result alone, what the robot holds to have come of places."""

    def visited(self, place: PlaceKey, now: Instant) -> None:
        """Say that a place has been cleaned."""

    def given_up(self, place: PlaceKey, reason: str, now: Instant) -> None:
        """Say that nobody is to try for a place any more, and why, in at most 100 characters."""

    def remaining(self, route: Sequence[PlaceKey]) -> None:
        """Say which places the robot still means to visit, in their order; at first those of its Start."""


class FloorPlan(Protocol):
    """The map as the robot has it."""

    def random_place(self) -> Point:
        """A point in the areas in which places lie, each as likely as another, where the robot can stand.

        Without areas: on all floor that the robot can reach. Drawn from the behaviour's own stream.
        """

    def is_free(self, point: Point) -> bool:
        """True if the robot's centre can be at `point`, m, by the map and the margin that planning keeps."""

    def length(self, start: Point, goal: Point) -> float | None:
        """How far the shortest way between two points of the map is, m; None where no way leads.

        A point where the robot cannot be stands for the nearest within 0.5 m where it can. The first question
        about a goal takes about a millisecond, every other one microseconds: have what is asked about from
        many sides as the goal.
        """

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """That way: points 0.1 to 0.2 m apart, m; None without one. Navigation's own keep off walls."""

    @property
    def doors(self) -> tuple[Door, ...]:
        """The map's narrow places, in which robots that meet do not get by; each by its index."""

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Which doors that way goes through, begins in or ends in, in order; None without a way."""

    def door(self, point: Point) -> int | None:
        """The index of the door that `point` is in; None in none."""

    def region(self, point: Point) -> int | None:
        """The number of the region between doors that `point` is in; None in a door and off the floor."""
