"""Properties of scenarios, and warnings about expected problems of a run."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from actors.array_types import Int32s
from actors.floor import raster
from actors.floor.doors import Doorways, regions
from actors.floor.grid import (
    OCCUPIED,
    Cell,
    OccupancyGrid,
    nearest_cell,
    passable,
    reachable,
)
from actors.floor.map_file import map_warnings
from actors.geometry import ORIGIN, STILL, Point, Pose
from actors.instant import Instant
from actors.items import ItemKey
from actors.radio.radio_model import radio_model, radio_parameters, reach, required_dbm
from actors.robot.assembly import navigator, shared_map_data
from actors.robot.behaviour.ports import GoalStatus
from actors.robot.navigation.cost_map import room_needed
from actors.robot.navigation.navfn import global_costs
from actors.robot.navigation.planning import narrowest_door, planning_grid
from actors.robot.navigation.potential import IMPASSABLE, descent, potential
from actors.robot.sweep import Sweep
from actors.robot_model import load_model
from actors.runtime.processor import first_names
from actors.task.loading import load_task
from actors.world.sensing import RangeSensors
from actors.world.world_setup import BodySetup
from deploy.scenario.map_survey import MapSurvey, grid_size, narrow_places
from deploy.scenario.resolve import ResolvedScenario, StartPose
from deploy.scenario.scenario_file import map_title

_CYCLE_US: Final = 200_000
_TRIAL_US: Final = 60_000_000
"""Simulated time within which a robot that can drive off commands a velocity, µs."""
_STEP: Final = 0.01
"""Increment of the tried distances from a wall, m."""
_FADING_MARGIN_DB: Final = 6.0
"""Margin below the power at which half of the longest frames arrive; at lower power none arrives, dB."""
_MAX_REFINED_CELLS: Final = 1_000_000
"""Maximum size of maps that are refined to half cells."""
_SAMPLES: Final = 80
"""Maximum number of points per part of the floor for which radio links are computed."""


def scenario_warnings(resolved: ResolvedScenario, floor: "_Floor | None" = None) -> tuple[str, ...]:
    """Return the problems to be expected in a run, one sentence each."""
    floor = floor or _floor(resolved, resolved.grid)
    return (
        *map_warnings(resolved.world.map),
        *_start_warnings(floor),
        *_item_warnings(floor),
        *_door_warnings(floor),
        *_connection_warnings(floor),
    )


class _RobotFloor(NamedTuple):
    """Floor on which both planners of one robot have room for its body."""

    clearance: float
    """Clearance that the local planner needs at any heading, m."""
    door: float
    """Minimum width of doors that both planners always pass, m."""
    parts: Int32s
    """(rows, columns): labels of connected parts of the floor, from 1 on; 0: too narrow."""


class _Floor:
    """Reachable floor of every robot's navigation."""

    def __init__(self, resolved: ResolvedScenario, grid: OccupancyGrid, slack: float = 0.0) -> None:
        """`slack`: tolerance of the clearance at the centre of a cell, m."""
        self.slack = slack
        self.resolved, self.grid, self.robots = resolved, grid, resolved.world.robots
        self.preset = f"navigation `{resolved.scenario.presets['navigation']}`"
        self.model, self._room = cache(load_model), cache(self._compute_room)
        reach = resolved.adaptation.settings.get("reach")
        self.reach = (
            float(reach) if isinstance(reach, int | float) else load_task(resolved.world.task.use).reach
        )
        self.starts = {robot.id: self.part(robot, self.room(robot)) for robot in self.robots}
        """Label of the part of the floor in which each robot starts; 0: none."""
        self.unreached = dict(self._unreached())
        """Items that their owners cannot reach, with a cell from which each could be reached, if any."""

    def radius(self, robot: BodySetup) -> float:
        """Return the radius of the robot's body, m."""
        return self.model(robot.model, robot.sensor).footprint.circumradius

    @property
    def largest_radius(self) -> float:
        """Largest radius of a robot's body, m."""
        return max(map(self.radius, self.robots))

    def room(self, robot: BodySetup) -> _RobotFloor:
        """Return the floor on which the robot's body fits."""
        return self._room(self.radius(robot))

    def _compute_room(self, radius: float) -> _RobotFloor:
        stack, grid = self.resolved.stack, self.grid
        clearance, cell = room_needed(radius, stack.local_map), self.resolved.grid.resolution
        if stack.planner.method == "navfn":
            passable = global_costs(grid, radius, stack.planner).costs < IMPASSABLE
        else:
            coarse = planning_grid(grid, radius, stack.planner)
            factor = round(coarse.grid.resolution / grid.resolution)
            passable = (coarse.costs > 0).repeat(factor, axis=0).repeat(factor, axis=1)
            passable = passable[: grid.rows, : grid.columns]
        wide = grid.clearance >= clearance - self.slack
        return _RobotFloor(
            clearance,
            max(2 * clearance, narrowest_door(radius, stack.planner, cell)),
            raster.regions(passable & wide),
        )

    def part(self, robot: BodySetup, room: _RobotFloor) -> int:
        """Return the label of the part of the floor in which the robot starts; 0: none.

        A start too close to a wall is moved a little away from it.
        """
        at = robot.start_point
        cell = nearest_cell(self.grid, room.parts > 0, at, room.clearance)
        return 0 if cell is None else int(room.parts[cell])

    def _unreached(self) -> Iterator[tuple[ItemKey, Cell | None]]:
        for robot in self.robots:
            parts, start = self.room(robot).parts, self.starts[robot.id]
            for index, here in self.resolved.points(robot):
                if start and parts[self.grid.cell(here)] == start:
                    continue
                if not start or nearest_cell(self.grid, parts == start, here, self.reach) is None:
                    yield ItemKey(robot.id, index), nearest_cell(self.grid, parts > 0, here, self.reach)


def _floor(resolved: ResolvedScenario, grid: OccupancyGrid) -> _Floor:
    """Return the floor, refined to half cells if disconnected: robots can be between two cells."""
    floor = _Floor(resolved, grid)
    if not floor.unreached and len(set(floor.starts.values())) == 1:
        return floor
    if grid.cells.size <= _MAX_REFINED_CELLS:
        halves = grid.cells.repeat(2, axis=0).repeat(2, axis=1)
        grid = OccupancyGrid(halves, grid.resolution / 2, grid.origin)
    return _Floor(resolved, grid, grid.resolution / 2)


def _start_warnings(floor: _Floor) -> Iterator[str]:
    """Yield a warning per robot whose local planner cannot drive off the wall that it starts at."""
    for robot in floor.robots:
        clearance, at = floor.room(robot).clearance, robot.start_point
        gap = floor.grid.clearance_at(at, clearance)
        if gap < clearance and floor.resolved.points(robot) and not _can_drive_off(floor, robot, robot.start):
            needed = _required_distance(floor, robot, gap, clearance)
            yield (
                f"robot {robot.id} starts {gap:.2f} m from a wall, at ({at.x:.2f}, {at.y:.2f}); the local "
                f"planner of {floor.preset} cannot drive off from there: it needs {_rounded_up(needed)} m"
            )


def _required_distance(floor: _Floor, robot: BodySetup, gap: float, max_distance: float) -> float:
    """Return the distance from which on the robot drives off the wall that it starts at, m."""
    x, y, heading = robot.start
    east, north = np.gradient(floor.grid.clearance)[::-1]
    cell = floor.grid.cell(Point(x, y))
    away = math.atan2(north[cell], east[cell])
    for step in range(1, math.ceil((max_distance - gap) / _STEP)):
        pose = x + step * _STEP * math.cos(away), y + step * _STEP * math.sin(away), heading
        if _can_drive_off(floor, robot, pose):
            return gap + step * _STEP
    return max_distance


def _can_drive_off(floor: _Floor, robot: BodySetup, start: StartPose) -> bool:
    """Return whether the robot's navigation finds a first command towards its first item."""
    model, grid = floor.model(robot.model, robot.sensor), floor.resolved.grid
    stack = msgspec.structs.replace(floor.resolved.stack, localisation=None)
    navigation = navigator(shared_map_data(grid, model, stack), model, stack)
    sensors = RangeSensors(grid, [model], [np.random.default_rng(0)])
    (ranges,) = sensors.scan([0], np.array([start]), np.zeros((0, 3)))
    ranges.setflags(write=False)
    (_, first), *_ = floor.resolved.points(robot)
    navigation.take(first)
    for instant in range(0, _TRIAL_US, _CYCLE_US):
        navigation.sense(Instant(instant), ORIGIN, Sweep(ranges, ORIGIN))
        if navigation.advance(Instant(instant), ORIGIN, Pose(*start), STILL) != STILL:
            return True
        if navigation.goal is None or navigation.goal.status is not GoalStatus.ACTIVE:
            return False
    return False


def _item_warnings(floor: _Floor) -> Iterator[str]:
    """Yield a warning per reason for which items are unreachable, such as a narrow door."""
    obstacles: dict[tuple[float, str | int, int], str] = {}
    items_by_reason: dict[str, list[str]] = {}
    for robot in floor.robots:
        needed = floor.room(robot).clearance
        for index, at in floor.resolved.points(robot):
            key, noun = ItemKey(robot.id, index), floor.resolved.world.task.declaration.item
            gap = floor.grid.clearance_at(at, needed)
            wall = f"{noun} {key} is {gap:.2f} m from a wall; {floor.preset} needs {_rounded_up(needed)} m"
            if key not in floor.unreached:
                if gap < floor.radius(robot):
                    yield (
                        f"{wall}, so that the robot visits it from a distance, within its reach of "
                        f"{floor.reach:g} m"
                    )
            elif (cell := floor.unreached[key]) is None:
                yield f"{wall}, but no point within the robot's reach of {floor.reach:g} m has that much"
            else:
                part = int(floor.room(robot).parts[cell])
                path = floor.radius(robot), floor.starts[robot.id] or robot.id, part
                reason = obstacles.get(path) or obstacles.setdefault(path, _bottleneck(floor, robot, cell))
                items_by_reason.setdefault(reason, []).append(str(key))
    for reason, names in items_by_reason.items():
        yield f"{reason} to {_item_names(floor.resolved, names)}"


def _bottleneck(floor: _Floor, robot: BodySetup, goal: Cell) -> str:
    """Describe the narrowest spot on the widest path from the robot's start to a cell."""
    grid, room, x, y = floor.grid, floor.room(robot), *robot.start[:2]
    parts = room.parts == floor.starts[robot.id] if floor.starts[robot.id] else None
    start = grid.cell(Point(x, y)) if parts is None else nearest_cell(grid, parts, Point(x, y))
    assert start is not None
    if not raster.flood(grid.free, *start)[goal]:
        return f"no path leads from the start of robot {robot.id} at ({x:.2f}, {y:.2f})"
    low, high = 0.0, room.clearance
    while high - low > grid.resolution / 8:  # bisect the minimum clearance of the widest path
        middle = (low + high) / 2
        found = grid.clearance[start] >= middle and raster.flood(grid.clearance >= middle, *start)[goal]
        low, high = (middle, high) if found else (low, middle)
    costs = (grid.free & (grid.clearance >= low)).astype(np.int32)
    costs.setflags(write=False)  # as in a robot: kernels are compiled for read-only costs
    path = descent(costs, potential(costs, *goal), *start)
    row, column = path[int(np.argmin(grid.clearance[path[:, 0], path[:, 1]]))].tolist()
    at, width = grid.centre(Cell(row, column)), _width(grid, row, column)
    return (
        f"the door at ({at.x:.2f}, {at.y:.2f}), {width:.2f} m wide, is too narrow for robots of "
        f"{2 * floor.radius(robot):g} m with {floor.preset}, which needs "
        f"{_rounded_up(max(room.door, width + 0.01))} m: robots may not get"
    )


def _width(grid: OccupancyGrid, row: int, column: int) -> float:
    """Return the width of the free floor at a cell, m: the shorter of its row and column."""
    runs = []
    for line, at in ((grid.blocking[row], column), (grid.blocking[:, column], row)):
        walls = np.concatenate(([-1], np.flatnonzero(line), [line.size]))
        after = int(np.searchsorted(walls, at))
        runs.append(int(walls[after] - walls[after - 1]) - 1)
    return min(runs) * grid.resolution


def _door_warnings(floor: _Floor) -> Iterator[str]:
    """Yield a warning if items are unreachable behind doors that no event reopens."""
    grid = floor.resolved.grid
    doors = Doorways(grid, floor.largest_radius)
    closed: dict[int, float] = {}
    for event in sorted(floor.resolved.scenario.event, key=lambda one: one.at):
        if event.close is not None:
            closed[doors.at(Point(*event.close)).index] = event.at
        elif event.open is not None:
            del closed[doors.at(Point(*event.open)).index]
    cells = grid.cells.copy()
    for index in closed:
        cells[doors.closed_cells(doors.regions.doors[index])] = OCCUPIED
    if closed:
        floor_after = _floor(floor.resolved, OccupancyGrid(cells, grid.resolution, grid.origin))
        if names := [str(key) for key in floor_after.unreached if key not in floor.unreached]:
            yield (
                f"no event reopens the doors closed by {max(closed.values()):g} s: no path then "
                f"leads to {_item_names(floor.resolved, names)}"
            )


def _connection_warnings(floor: _Floor) -> Iterator[str]:
    """Yield a warning per group of robots with no path, or no radio link, to the other robots."""
    room, robots_by_part = floor.room(max(floor.robots, key=floor.radius)), dict[int, list[BodySetup]]()
    for robot in floor.robots:
        robots_by_part.setdefault(floor.part(robot, room), []).append(robot)
    groups = [robots for part, robots in sorted(robots_by_part.items()) if part]
    for number, robots in enumerate(groups[1:], start=1):
        others = [one for group in groups[:number] for one in group]
        names, rest = (first_names([one.id for one in group]) for group in (robots, others))
        yield f"{floor.preset} finds no path between the parts of the floor where {names} and {rest} start"
        if not floor.resolved.scenario.run.strategy.startswith("none") and not _has_radio_link(
            floor, room, robots, others
        ):
            yield f"no radio frame reaches the floor of {rest} from that of {names}"


def _has_radio_link(
    floor: _Floor, room: _RobotFloor, senders: list[BodySetup], receivers: list[BodySetup]
) -> bool:
    """Return whether a frame can arrive from any floor of the senders on any floor of the receivers."""
    grid, model = floor.grid, radio_model(floor.resolved.radio)
    points = []
    for robots in (senders, receivers):
        inside = np.isin(room.parts, [floor.part(one, room) for one in robots])
        rows, columns = np.nonzero(inside)
        chosen = np.linspace(0, rows.size - 1, min(rows.size, _SAMPLES)).astype(np.intp)
        x, y = grid.centres()
        points.append(np.column_stack((x[columns[chosen]], y[rows[chosen]])))
    budget = model.parameters.transceiver.tx_power_dbm - required_dbm(model.parameters)
    return bool((model.propagation.loss_db(points[0], points[1]) <= budget + _FADING_MARGIN_DB).any())


def _rounded_up(length: float) -> str:
    """Return a length in m, rounded up to centimetres."""
    return f"{math.ceil(length * 100 - 1e-6) / 100:.2f}"


def _item_names(resolved: ResolvedScenario, names: list[str]) -> str:
    words = resolved.world.task.declaration
    return f"{words.items if len(names) > 1 else words.item} {first_names(names)}"


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenarioSurvey(MapSurvey):
    """Properties of a scenario."""

    resolved: ResolvedScenario
    out_of_reach: tuple[ItemKey, ...]
    """Items that their owner's navigation cannot reach."""
    close: tuple[tuple[ItemKey, ItemKey, float], ...]
    """Pairs of one robot's items, and their distance in m, so close that one visit may do both."""
    radio_reach: float
    """Distance in line of sight at which half of the longest frames arrive, m."""

    def sentences(self) -> Iterator[str]:
        """Yield the properties as sentences."""
        facts = self.json_content()
        floor, count, words = facts["floor"], facts["robots"], self.resolved.world.task.declaration
        work = f"{facts['items']} {words.items}" if facts["items"] else f"task {words.name}"
        yield (
            f"{count} robot{'s' * (count > 1)}, {work}, {facts['duration_s']:g} s at most, "
            f"strategy {facts['strategy']}, seed {facts['seed']}"
        )
        yield (
            f"floor: {floor['width_m']:.1f} m by {floor['depth_m']:.1f} m, of which a robot's centre can "
            f"reach {floor['reached_m2']:.0f} m²; {facts['regions']} regions, "
            f"{narrow_places(floor['narrow_places'])}"
        )
        yield f"navigation {facts['navigation']}, localisation {facts['localisation']}"
        yield f"radio: half of the longest frames arrive at {facts['radio_reach_m']:.1f} m in line of sight"
        people = self.resolved.scenario.people
        if people is not None and people.count:
            yield f"people: {people.count}, walking between {people.between}"
        for one, other, apart in self.close:
            yield f"{words.items} {one} and {other} are {apart:.2f} m apart: one visit may do both"
        yield from (f"warning: {sentence}" for sentence in self.warnings)

    def json_content(self) -> dict[str, Any]:
        """Return the properties as JSON content, in m, m², s."""
        world, grid = self.resolved.world, self.grid
        return {
            "is": "scenario",
            "robots": len(world.robots),
            "task": self.resolved.scenario.task.use,
            "items": world.initial_work,
            "duration_s": world.duration_us / 1e6,
            "strategy": self.resolved.scenario.run.strategy,
            "seed": world.seed,
            "floor": {**grid_size(grid), "reached_m2": self.surface, "narrow_places": len(self.parts.doors)},
            "regions": self.parts.count,
            "radio_reach_m": self.radio_reach,
            "warnings": self.warnings,
            **self.resolved.scenario.presets,
            "out_of_reach": [str(key) for key in self.out_of_reach],
            "close": [
                {"one": str(one), "other": str(other), "apart_m": apart} for one, other, apart in self.close
            ],
        }


def survey(resolved: ResolvedScenario) -> ScenarioSurvey:
    """Survey a scenario. Raises AcrcError if a file that it names cannot be read."""
    world, grid = resolved.world, resolved.grid
    floor = _floor(resolved, grid)
    floors = [reachable(grid, body.start_point, floor.radius(body)) for body in world.robots]
    radius = floor.largest_radius
    return ScenarioSurvey(
        name=map_title(resolved.scenario.map),
        resolved=resolved,
        grid=grid,
        radius=radius,
        reached=np.logical_or.reduce(floors),
        parts=regions(grid, passable(grid, radius), grid.clearance),
        out_of_reach=tuple(floor.unreached),
        warnings=scenario_warnings(resolved, floor),
        close=tuple(
            (ItemKey(body.id, one), ItemKey(body.id, other), apart)
            for body in world.robots
            for (one, here), (other, there) in combinations(resolved.points(body), 2)
            if (apart := math.dist(here, there)) < load_task(world.task.use).reach
        ),
        radio_reach=reach(radio_parameters(resolved.radio)),
    )
