"""The task *search* and three strategies: hidden targets, which count once the base knows of them.

    ./acrc run examples/search.toml --modules examples --strategy search:relay

The first robot is the base and stands. Others start within its radio range, drive, see targets,
and report them by radio.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Final, Self

import numpy as np
from msgspec import Meta, convert
from numpy.typing import NDArray

from actors.floor.placement import draw_points
from actors.geometry import Point
from actors.instant import Instant, in_seconds
from actors.items import ItemKey, TaskReports
from actors.randomness import generator
from actors.robot.behaviour import (
    Behaviour,
    FloorPlan,
    GoalStatus,
    Navigation,
    Positioning,
    Start,
    TaskList,
    TaskMonitor,
    from_settings,
    host,
)
from actors.settings import Positive, Settings
from actors.task import task
from actors.topic import MessagePart
from deeco import Knowledge, Resolution, component, ensemble, periodic, replace, role, seconds

CELL: Final = 1.0
"""Side of a cell of the robots' map of covered floor, m."""
APART: Final = 6.0
"""Distance from other robots' goals below which a cell costs twice the missing distance, m."""


class SearchTable(Settings, frozen=True):
    """[search]: the hidden targets."""

    targets: Annotated[int, Meta(ge=1, le=60)] = 8
    """Number of targets, at random points at least 0.3 m from walls and 1 m from each other."""
    sight: Positive = 3.0
    """Distance from which a robot sees a target that no wall hides, m."""
    noise: Positive = 0.1
    """Largest error of a measured coordinate, m; uniform."""


class Briefing(MessagePart, frozen=True, tag="briefing"):
    """Item of each robot at the start: corners of the floor and range of sight, m."""

    low: tuple[float, float]
    high: tuple[float, float]
    sight: float


class Sighting(MessagePart, frozen=True, tag="sighting"):
    """Item of a robot that sees a target: its measured position, m."""

    number: int
    x: Annotated[float, Resolution(100)]
    y: Annotated[float, Resolution(100)]


class SearchJudge(task.Judge):
    """Judge that shows robots the targets in their sight, and counts those that the base reports."""

    def __init__(self, setup: task.JudgeSetup) -> None:
        super().__init__()
        if setup.grid is None or setup.world is None:
            raise task.TaskError("the task search requires a simulated world; remove it from the fleet file")
        self._setup, self._table, self._grid, self._world = setup, setup.settings, setup.grid, setup.world
        random, grid, count = generator(setup.seed, "task", "targets"), setup.grid, setup.settings.targets
        self._targets = np.array(draw_points(grid, count, rng=random, clearance=0.3, apart=1.0, passage=0.2))
        self._unknown = {robot: np.ones(count, np.bool_) for robot in setup.robots}
        self._seen: dict[ItemKey, tuple[int, str]] = {}
        self._reported: dict[ItemKey, int] = {}
        every = round(0.5 / grid.resolution)  # points of floor, 0.5 m apart
        (x, y), (rows, columns) = grid.centres(), np.nonzero(grid.free[::every, ::every])
        self._floor = np.stack([x[::every][columns], y[::every][rows]], axis=1)
        self._covered = np.zeros(len(rows), np.bool_)
        for number in range(count):
            self._mark(ItemKey("target", number), "hidden")

    @property
    def settled(self) -> bool:
        """True once the base has reported all targets."""
        return len(self._reported) == len(self._targets)

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Give each robot the targets that it sees for the first time."""
        if instant == 0:
            self.mark(ItemKey("base", 0), positions[0].tolist(), "base")
            self.note(self._setup.robots[0], 0, "is the base")
        for robot, here in zip(self._setup.robots, positions, strict=True):
            unknown = self._unknown[robot]
            for number in np.flatnonzero(unknown)[self._sees(here, self._targets[unknown])].tolist():
                unknown[number] = False
                self._show_target(instant, robot, ItemKey("target", number))
            if instant % seconds(0.5) == 0:
                rest = np.flatnonzero(~self._covered)
                self._covered[rest[self._sees(here, self._floor[rest])]] = True

    def _sees(self, here: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points, (n, 2), are near, on a line over free cells."""
        grid, sight, away = self._grid, self._table.sight, points - here
        seen: NDArray[np.bool_] = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] <= sight * sight
        shares = np.linspace(0, 1, math.ceil(sight / grid.resolution) + 1)[:, None, None]
        cells = np.floor((here + shares * away[seen] - grid.origin) / grid.resolution).astype(np.intp)
        seen[seen] = (grid.cells[cells[..., 1], cells[..., 0]] == 0).all(axis=0)
        return seen

    def _show_target(self, instant: Instant, robot: str, key: ItemKey) -> None:
        shares = generator(self._setup.seed, "task", f"{robot} {key}").random(2)
        x, y = (self._targets[key.number] + self._table.noise * (2 * shares - 1)).tolist()
        self._world.give(robot, [Sighting(key.number, x, y)])
        self.note(robot, instant, "seen", key)
        if key not in self._seen:
            self._seen[key] = instant, robot
            self._mark(key, "seen")

    def _mark(self, key: ItemKey, state: str) -> None:
        self.mark(key, self._targets[key.number].tolist(), state, self._seen.get(key, (0, ""))[1])

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Count the targets that the base reports for the first time."""
        for key in answer.reports:
            if robot != self._setup.robots[0] or key not in self._seen:
                return f"reports {key}; only the base may report a target, once a robot has seen it"
            if key not in self._reported:
                self._reported[key] = begin
                self._mark(key, "found")
                self.note(robot, begin, "found", key)
        return None

    def progress(self, present: Collection[str]) -> task.TaskProgress:
        """Count targets that the base does not know, and knows."""
        return task.TaskProgress(len(self._targets) - len(self._reported), len(self._reported))

    def outcome(self, present: Collection[str], end: Instant) -> task.TaskOutcome:
        """Return counts, times and the table of targets."""
        seen, total = self._seen, len(self._targets)
        reported = {key: in_seconds(instant) for key, instant in self._reported.items()}
        delays = [instant - in_seconds(seen[key][0]) for key, instant in reported.items()]
        values = {
            "targets": total,
            "found": len(reported),
            "search_s": max(reported.values()) if self.settled else None,
            "seen": len(seen),
            "delay_s": math.fsum(delays) / len(delays) if delays else None,
            "covered": float(self._covered.mean()),
        }
        items = tuple(
            {"target": str(key), "seen_by": by, "found_s": reported.get(key)} for key, (_, by) in seen.items()
        )
        finders = [by for _, by in seen.values()]
        robots = {robot: {"seen": finders.count(robot)} for robot in self._setup.robots}
        summary = f"found {len(reported)} of {total} targets and saw {len(seen)} in {in_seconds(end):g} s"
        return task.TaskOutcome(summary, values, robots, items)


class Search(task.Task):
    """Robots search hidden targets; a target is found once the base, the first robot, reports it."""

    declaration = task.TaskDeclaration(
        name="search", table="search", item="target", items="targets", done="found", lists_items=False,
        has_initial_work=False,
        metrics=(
            task.Metric("found", "targets found", "targets", "found", rank=1, worst=0.0, total="targets"),
            task.Metric("search", "time to find all", "s", "search_s", "less", "all found", rank=2),
            task.Metric("seen", "targets seen by a robot", "targets", "seen", worst=0.0, total="targets"),
            task.Metric("delay", "time from seen to found", "s", "delay_s", "less"),
            task.Metric("covered", "share of the floor that a robot saw", "", "covered", worst=0.0),
        ),
        marks={
            "hidden": task.MarkStyle("soft ring", "target that no robot has seen", True),
            "seen": task.MarkStyle("ring", "target seen by a robot", True),
            "found": task.MarkStyle("disc", "target known to the base"),
            "base": task.MarkStyle("triangle", "base"),
        },
        events={
            "seen": task.MarkStyle("tick", "robot sees a target"),
            "found": task.MarkStyle("triangle", "base learns of a target"),
        },
        columns=(
            task.Column("target", "text", "A target that was seen"),
            task.Column("seen_by", "text", "Robot that saw it first"),
            task.Column("found_s", "number", "Time at which the base knew of it, s"),
        ),
        causes={"is the base": ("#9aa5b1", "")},
        cells={"targets seen first": ("seen",)},
    )  # fmt: skip
    settings = SearchTable
    item = Briefing | Sighting
    report = ItemKey

    def judge(self, setup: task.JudgeSetup) -> SearchJudge:
        """Return the judge."""
        return SearchJudge(setup)

    def draw(self, settings: SearchTable, placing: task.DrawInput) -> tuple[Briefing]:
        """Return the briefing."""
        return (Briefing(placing.grid.origin, placing.grid.corner, settings.sight),)


@dataclass(frozen=True)
class SearchParameters:
    """Settings of the strategies."""

    patience: float = 10.0
    """Time until a robot with an unconfirmed target returns to the base, s."""
    relays: int = 1
    """Number of robots that may be relays."""
    link: float = 8.0
    """Distance of the first relay from the base; the next ones stand at multiples of it, m."""


@role
class Searcher(Knowledge):
    """Published state; with 400 cells and three targets it fits a frame."""

    position: Annotated[Point, Resolution(100)]
    goal: Annotated[Point, Resolution(10)] | None = None
    is_base: bool = False
    targets: tuple[Sighting, ...] = ()
    """Targets that the base has not confirmed."""
    confirmed: int = 0
    """Targets that the base knows, a bit each."""
    sweep: int = 0
    """Number of times that the whole floor was covered."""
    covered: bytes = b""
    """Covered cells of the floor, a bit each."""


@component
class SearchRobot(Searcher):
    """A robot that covers the nearest cells, and returns to the base to report a target."""

    parameters: SearchParameters
    floor: Briefing
    home: Point
    rank: int = 0
    """Position in the chain of relays; 0: it never is a relay."""
    walls: bytes = b""
    """Cells outside of the free floor, a bit each."""
    items: int = 1
    """Number of items processed."""
    own: int = 0
    """Targets that it saw itself, a bit each."""
    waits: int = 0
    """Time since which one of them is not confirmed, s."""
    peers: tuple[Searcher, ...] = ()
    """Other robots as last heard."""

    @periodic(every=seconds(0.5), order=0)
    def look(self, positioning: Positioning, tasks: TaskList, plan: FloorPlan, monitor: TaskMonitor) -> Self:
        """Update position, sightings and covered cells; the base reports and confirms targets."""
        robot = replace(self, position=positioning.pose.point, items=len(tasks.items))
        for one in convert(tasks.items[self.items :], list[Sighting]):
            robot = replace(robot.knowing((one,), 0), own=robot.own | 1 << one.number)
        for one in robot.targets if self.is_base else ():
            monitor.report(ItemKey("target", one.number))
            robot = robot.knowing((), 1 << one.number)
        reach = self.floor.sight - 0.7 * CELL  # of a cell's centre, so that the whole cell is in sight
        near = [n for n in robot.uncovered() if robot.distance(plan, robot.centre(n)) < reach]
        return robot.covering(near)

    @periodic(every=seconds(1), order=1)
    def drive(self, navigation: Navigation, plan: FloorPlan) -> Self:
        """Choose a goal; a cell that navigation cannot reach counts as covered."""
        if self.is_base:
            return self
        is_aborted = navigation.goal is not None and navigation.goal.status is GoalStatus.ABORTED
        lost = [n for n in self.uncovered() if is_aborted and self.centre(n) == self.goal]
        robot = self.covering(lost).choosing(plan)
        if robot.goal is not None and (is_aborted or robot.goal != self.goal):
            navigation.resume()
            navigation.go_to(robot.goal)
        elif robot.goal is not None and robot.position.is_nearer(robot.goal, 0.5):
            navigation.pause()
        return robot

    def choosing(self, plan: FloorPlan) -> Self:
        """Return the robot with its goal for the next second."""
        robot = replace(self, waits=self.waits + 1 if self.own & ~self.confirmed else 0)
        if robot.waits > self.parameters.patience:
            return replace(robot, goal=self.home)
        if post := self.post(plan):
            return robot if self.goal and self.goal.is_nearer(post, 1) else replace(robot, goal=post)
        cells = [self.centre(n) for n in self.uncovered()]
        if not cells:
            return replace(robot, sweep=self.sweep + 1, covered=self.walls)
        return robot if self.goal in cells else replace(robot, goal=min(cells, key=partial(self.cost, plan)))

    def distance(self, plan: FloorPlan, cell: Point) -> float:
        """Return the length of the path to a cell, m; infinite without one."""
        length = plan.length(self.position, cell)
        return math.inf if length is None else length

    def cost(self, plan: FloorPlan, cell: Point) -> float:
        """Return the distance of a cell, with a charge for other robots' goals near it, m."""
        near = min((cell.distance_to(peer.goal or peer.position) for peer in self.peers), default=APART)
        return self.distance(plan, cell) + 2 * max(0.0, APART - near)

    def post(self, plan: FloorPlan) -> Point | None:
        """Return where to stand as a relay, on the path from the base to the farthest robot."""
        if not 0 < self.rank <= self.parameters.relays or not self.peers:
            return None
        far = max((peer.position for peer in self.peers), key=self.home.distance_to)
        away = self.rank * self.parameters.link
        path = plan.path(self.home, far) or ()
        return next((point for point in path if not point.is_nearer(self.home, away)), None)

    def knowing(self, targets: Sequence[Sighting], confirmed: int) -> Self:
        """Return the robot with further targets, without those that the base knows."""
        confirmed |= self.confirmed
        found = [one for one in (*targets, *self.targets) if 0 <= one.number < 60]  # as in SearchTable
        known = {one.number: one for one in found if not confirmed >> one.number & 1}
        return replace(self, targets=tuple(known[n] for n in sorted(known)), confirmed=confirmed)

    def sharing(self, peer: Searcher) -> Self:
        """Return the robot with the goal and the covered cells of another one."""
        robot = replace(self, peers=(*(one for one in self.peers if one.id != peer.id), peer))
        if peer.sweep < self.sweep or len(peer.covered) != len(self.covered):
            return robot
        own = self.covered if peer.sweep == self.sweep else self.walls
        covered = bytes(a | b for a, b in zip(own, peer.covered, strict=True))
        return replace(robot, sweep=peer.sweep, covered=covered)

    def centre(self, number: int) -> Point:
        """Return the centre of a cell, m; cells are numbered from south to north, then west to east."""
        (x, y), (_, north) = self.floor.low, self.floor.high
        column, row = divmod(number, math.ceil((north - y) / CELL))
        return Point(x + (column + 0.5) * CELL, y + (row + 0.5) * CELL)

    def uncovered(self) -> list[int]:
        """Return the numbers of the cells that are not covered."""
        return [n for n in range(8 * len(self.covered)) if not self.covered[n // 8] >> n % 8 & 1]

    def covering(self, cells: Sequence[int]) -> Self:
        """Return the robot with further covered cells."""
        covered = bytearray(self.covered)
        for number in cells:
            covered[number // 8] |= 1 << number % 8
        return replace(self, covered=bytes(covered)) if cells else self


@ensemble(every=seconds(1), max_age=seconds(5))
class Exchange:
    """Robots tell the base of targets, which confirms them; all robots exchange all if they share."""

    shares: bool

    def membership(self, coordinator: Searcher, member: Searcher) -> bool:
        """Return True for all robots if they share, else for the base and another one."""
        return self.shares or coordinator.is_base or member.is_base

    def at_member(self, coordinator: Searcher, member: SearchRobot) -> SearchRobot:
        """Take over what the coordinator knows."""
        robot = member.knowing(coordinator.targets, coordinator.confirmed)
        return robot.sharing(coordinator) if self.shares else robot


def _host(start: Start, *, shares: bool, relays: bool) -> Behaviour:
    parameters, here = from_settings(SearchParameters, start.settings), start.pose.point
    floor, number = convert(start.items[0], Briefing), list(start.members).index(start.robot)
    cells = math.prod(math.ceil((b - a) / CELL) for a, b in zip(floor.low, floor.high, strict=True))
    robot = SearchRobot(
        id=start.robot, position=here, parameters=parameters, floor=floor, home=here, is_base=number == 0
    )
    robot = replace(robot, covered=bytes(math.ceil(cells / 8)), rank=number if relays else 0)
    robot = robot.covering([n for n in robot.uncovered() if not start.floor.is_free(robot.centre(n))])
    return host(start, replace(robot, walls=robot.covered), Exchange(shares))


def alone(start: Start) -> Behaviour:
    """Sweep the floor alone; return to the base with each target."""
    return _host(start, shares=False, relays=False)


def sharing(start: Start) -> Behaviour:
    """Share targets and covered floor with robots in range."""
    return _host(start, shares=True, relays=False)


def relay(start: Start) -> Behaviour:
    """Share as well; some robots stand between the base and the farthest robot."""
    return _host(start, shares=True, relays=True)
