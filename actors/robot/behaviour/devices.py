"""The robot's side of what its processes ask for; see `actors.robot.behaviour.equipment`."""

from collections.abc import Sequence

from actors.geometry import CERTAIN, Point, Pose
from actors.instant import Instant
from actors.robot.behaviour.plan import Goal, GoalOrder, GoalStatus, Plan
from actors.robot.behaviour.ports import View
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport


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
