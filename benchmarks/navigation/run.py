"""One run that measures navigation, judged by where the robots truly were.

A goal is reached if navigation says so and the robot truly is within REACH of it.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.instant import in_seconds
from benchmarks.navigation import goal_log
from benchmarks.navigation.course import NavigationCourse, WatchedRun, body, scenario, watch
from benchmarks.navigation.goal_log import LoggedGoal
from benchmarks.navigation.yardsticks import (
    RetracingError,
    ShortestWays,
    closest,
    retrace,
    robot_gaps,
    touches,
    wall_gaps,
)
from observation.results.navigation_result import NavigationOutcome

REACH: Final = 0.5
"""d3scomp/deeco-adaptation-testbed, REACHED_POS_THRESH_M, m."""
WRONG: Final = "wrong"
"""How a goal ended that navigation takes for reached, and that is farther away than REACH."""


@dataclass(frozen=True)
class Leg:
    """What came of one goal."""

    how: str
    """As in LoggedGoal, or WRONG; empty if the goal was open at the end."""
    seconds: float
    shortest: float | None
    """The shortest way from where the robot truly was, m; None if there is none."""


@dataclass(frozen=True)
class RunFigures:
    """One run."""

    legs: tuple[Leg, ...]
    robot_hours: float
    no_trajectory_s: float | None
    """Of all robots up to the end of the run, as the function says."""
    wall_contacts: int
    """Contacts that began, as seen from one sub-step of the physics to the next."""
    robot_contacts: int
    contacts: int
    """All together, as the world counted them."""
    wall_gap: float
    """The smallest, m."""
    robot_gap: float
    digest: str


def measure(course: NavigationCourse) -> RunFigures:
    """Run one course, and measure."""
    done = watch(scenario(course))
    grid, radius = load_map(course.map), body().footprint.circumradius
    ways = ShortestWays(grid, radius)
    tracks = done.tracks
    legs = [
        _leg(done, ways, index, goal)
        for index, robot in enumerate(tracks.robots)
        for goal in done.goals[robot][: course.goals]
    ]
    fine, contacts = retrace(done.world, tracks)
    if contacts != done.result.contacts:
        raise RetracingError(f"{contacts} contacts instead of the {done.result.contacts} of the run")
    walls, others = wall_gaps(grid, fine, radius), robot_gaps(fine, radius)
    return RunFigures(
        legs=tuple(legs),
        robot_hours=done.result.simulated_s * len(tracks.robots) / 3600,
        no_trajectory_s=no_trajectory_s(done.navigation.values()),
        wall_contacts=touches(walls),
        robot_contacts=touches(others),
        contacts=done.result.contacts,
        wall_gap=closest(walls),
        robot_gap=closest(others),
        digest=done.result.digest,
    )


def no_trajectory_s(said: Collection[NavigationOutcome]) -> float | None:
    """How long these robots together had no valid trajectory, s; None if not every such spell is listed."""
    if any(one.no_valid_trajectory_unlisted for one in said):
        return None
    return sum(in_seconds(end - begin) for one in said for begin, end, _ in one.no_valid_trajectory)


def _leg(done: WatchedRun, ways: ShortestWays, robot: int, goal: LoggedGoal) -> Leg:
    tracks, point = done.tracks, Point(goal.x, goal.y)
    if goal.end is None:
        return Leg("", done.result.simulated_s - in_seconds(goal.begin), None)
    begin, end = (
        Point(*tracks.true[tracks.index(instant), robot, :2].tolist()) for instant in (goal.begin, goal.end)
    )
    wrong = goal.how == goal_log.SUCCEEDED and end.distance_to(point) > REACH
    how = WRONG if wrong else goal.how
    return Leg(how, in_seconds(goal.end - goal.begin), ways.length(begin, point))
