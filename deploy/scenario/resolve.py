"""Resolution of scenarios: robots, starts, items of the task and all random draws."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import msgspec
from msgspec import UNSET, UnsetType, to_builtins
from msgspec.structs import asdict, replace

from actors import wording
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError, areas_named, check_pose, draw_points
from actors.geometry import Point, Pose, wrap
from actors.instant import milliseconds, seconds
from actors.radio import radio_model
from actors.radio.radio_model import RadioSetup
from actors.radio.walls import cells_in
from actors.randomness import generator
from actors.robot.assembly import RobotSetup
from actors.robot.stack import Adaptation, Stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.settings import plain
from actors.task.loading import decode_items, load_task, named_faults, task_setup
from actors.task.task import DrawInput, Task
from actors.world.people import PeopleParameters, PeopleSetup
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies import entry
from deploy.scenario.events import (
    check_areas,
    item_area_tables,
    people_area_tables,
    scenario_task,
    timed_orders,
)
from deploy.scenario.tables import RobotTable, Scenario

StartPose = tuple[float, float, float]
"""x, y, m, and heading, rad."""


class LayoutError(AcrcError):
    """A start, item or event that does not fit the floor plan."""


_SPACING: Final = 0.6
"""Minimum distance of drawn starts from walls and each other, m. A robot can pass between such a point and
the wall."""


class RobotSpec(msgspec.Struct, frozen=True):
    """One robot before its start and items are drawn."""

    table: RobotTable
    """Its table, completed with the values of all robots and of its model."""
    radius: float

    @property
    def id(self) -> str:
        """Id of the robot."""
        return self.table.id


@dataclass(frozen=True, kw_only=True)
class Swarm:
    """Complete set-ups of world, radio and robots."""

    world: WorldSetup
    """Floor and bodies."""
    radio: RadioSetup
    """Radio channel, and transceivers of all robots, of which `world` may have one only."""
    behaviour: str
    """Entry string `module:function` of the robots' behaviour."""
    adaptation: Adaptation
    """Strategy settings and exchange of every robot."""
    stack: Stack
    """Localisation and navigation of every robot."""


@dataclass(frozen=True, kw_only=True)
class ResolvedScenario(Swarm):
    """A scenario with all set-ups derived from it."""

    scenario: Scenario
    """Equivalent scenario without random draws: every robot has its own table."""
    grid: OccupancyGrid = field(compare=False)
    """The floor plan."""

    def points(self, robot: BodySetup) -> list[tuple[int, Point]]:
        """Return the points of a robot's items, m, with their indices; items without point are left out."""
        task = load_task(self.world.task.use)
        points = enumerate(map(task.point, decode_items(task, robot.items)))
        return [(index, point) for index, point in points if point is not None]


def robot_setup(swarm: Swarm, robot: BodySetup) -> RobotSetup:
    """Return the set-up of a robot at its first start."""
    return RobotSetup(
        id=robot.id,
        epoch=0,
        first_step=0,
        seed=swarm.world.robot_seed(robot.id),
        step_us=swarm.world.step_us,
        address=dict(swarm.radio.robots)[robot.id],
        members=swarm.radio.robots,
        start=robot.start,
        items=robot.items,
        adversary=robot.adversary,
        behaviour=swarm.behaviour,
        model=robot.model,
        sensor=robot.sensor,
        adaptation=swarm.adaptation,
        stack=swarm.stack,
    )


def resolve(scenario: Scenario) -> ResolvedScenario:
    """Resolve names and draw all random starts and items of a scenario, from its seed.

    A robot's draws depend on earlier robots only, so a larger count does not change them. Raises AcrcError.
    """
    behaviour = entry(scenario.run.strategy)
    radio_model.preset(scenario.radio.preset)
    grid = load_map(scenario.map)
    specs = [_robot_spec(robot, scenario) for robot in scenario.ids]
    check_areas(grid, scenario)
    _check_walls(grid, scenario)
    start_poses = starts(grid, specs, scenario)
    check_events(grid, specs, scenario)
    check_doors(grid, specs, scenario)
    robots = tuple(
        BodySetup(**asdict(spec.table) | {"start": start, "items": _items(grid, spec, start, scenario)})
        for spec, start in zip(specs, start_poses, strict=True)
    )
    explicit = _explicit_scenario(scenario, robots)
    run, step_us = scenario.run, milliseconds(scenario.run.step_ms)
    world = WorldSetup(
        map=scenario.map,
        seed=run.seed,
        key=run.key or "",
        step_us=step_us,
        duration_us=seconds(run.duration),
        robots=robots,
        task=task_setup(scenario.task.use, explicit.task_settings),
        events=timed_orders(scenario),
        uncertainty=scenario.uncertainty,
        people=_people_setup(scenario),
    )
    if (
        world.has_people or world.uncertainty != Uncertainty()
    ):  # otherwise the checks of the map above suffice
        _check_floor(world)
    addresses = tuple((robot.id, number) for number, robot in enumerate(robots, start=1))
    return ResolvedScenario(
        scenario=explicit,
        grid=grid,
        world=world,
        radio=RadioSetup(
            **asdict(scenario.radio),
            seed=run.seed_of("radio"),
            step_us=step_us,
            robots=addresses,
            map=scenario.map,
            patches=scenario.wall,
            wifi=scenario.wifi,
        ),
        behaviour=behaviour,
        adaptation=explicit.adaptation,
        stack=explicit.stack,
    )


def _check_walls(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if a [[wall]] table covers no occupied cell."""
    for index, patch in enumerate(scenario.wall):
        if not (grid.cells[cells_in(grid, patch)] == OCCUPIED).any():
            (x0, x1), (y0, y1) = patch.x, patch.y
            raise AcrcError(
                f"wall[{index}] spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g} m, where nothing is occupied;"
                " it must cover a wall"
            )


def _check_floor(world: WorldSetup) -> None:
    """Raise PlacementError if floor or people cannot be made, before the world's process would."""
    from actors.world import body  # noqa: PLC0415 - loads the physics, which few scenarios need here

    models = [load_model(robot.model, robot.sensor) for robot in world.robots]
    floor = body.real_floor(world, models)
    if world.has_people:
        body.pedestrians(world, floor, models)


def _people_setup(scenario: Scenario) -> PeopleSetup | UnsetType:
    """Return the people of a scenario; unset without any."""
    people = scenario.people
    if people is None or not people.count:
        return UNSET
    values = {name: getattr(people, name) for name in PeopleParameters.__struct_fields__}
    areas = tuple(table.area for table in people_area_tables(scenario))
    return PeopleSetup(PeopleParameters(**values), areas)


def _robot_spec(robot: str, scenario: Scenario) -> RobotSpec:
    """Return the robot's table, with missing values from [robots] and its model."""
    common = scenario.robots
    table = next((table for table in scenario.robot if table.id == robot), RobotTable(id=robot))
    name = table.model or common.model
    model = load_model(name, table.sensor or (common.sensor if name == common.model else None))
    odometry = table.odometry or common.odometry or model.odometry
    battery = common.battery if table.battery is None else table.battery
    if battery is not None and model.battery is None:
        raise AcrcError(
            f"robot {robot}: battery is {battery:g}, but the model {wording.toml_text(name)} has no table"
            " [battery]; add it, or remove the key"
        )
    table = replace(table, model=name, sensor=model.default_sensor, odometry=odometry, battery=battery)
    return RobotSpec(table, model.footprint.circumradius)


def _explicit_scenario(scenario: Scenario, robots: Sequence[BodySetup]) -> Scenario:
    """Return the scenario with every start and item listed in [[robot]] tables.

    Areas of items are kept: robots may request random points in them. Those of people become their own.
    """
    tables = tuple(RobotTable(**asdict(robot)) for robot in robots)
    presets = {name: {"preset": one, **getattr(scenario, name)} for name, one in scenario.presets.items()}
    people, (task, settings) = scenario.people, scenario_task(scenario)
    if people is not None:
        people = replace(people, areas=None, area=people_area_tables(scenario))
    return replace(
        scenario,
        people=people,
        robots=replace(scenario.robots, start=(), areas=None),
        task_settings=plain(task.listed(settings)),
        area=item_area_tables(scenario),
        robot=tables,
        **presets,
    )


def starts(grid: OccupancyGrid, specs: Sequence[RobotSpec], scenario: Scenario) -> list[StartPose]:
    """Return the robots' start poses in order: as in the scenario, else drawn apart from all others."""
    poses: dict[str, StartPose] = {}
    for index, spec in enumerate(specs):
        pose = spec.table.start
        if pose is None and index < len(scenario.robots.start):
            pose = scenario.robots.start[index]
        if pose is not None:
            check_pose(grid, Point(*pose[:2]), spec.radius, spec.id)
            poses[spec.id] = (pose[0], pose[1], wrap(pose[2]))
    _check_distances([spec for spec in specs if spec.id in poses], poses)
    taken = [Point(*pose[:2]) for pose in poses.values()]
    floor = taken[0] if taken else None
    for spec in specs:
        if spec.id in poses:
            continue
        point = _draw_start(grid, spec, scenario, taken, floor)
        taken.append(point)
        poses[spec.id] = (round(point.x, 3), round(point.y, 3), 0.0)
    return [poses[spec.id] for spec in specs]


def _draw_start(
    grid: OccupancyGrid, spec: RobotSpec, scenario: Scenario, taken: Sequence[Point], floor: Point | None
) -> Point:
    names = scenario.robots.areas
    try:
        (point,) = draw_points(
            grid,
            1,
            rng=generator(scenario.run.seed_of("placement"), "start", spec.id),
            clearance=max(_SPACING, spec.radius),
            apart=max(_SPACING, 2 * spec.radius),
            keep_off=taken,
            start=floor,
            passage=spec.radius,
            areas=None if names is None else areas_named(scenario.areas, names),
        )
    except PlacementError as error:
        where = "" if names is None else " in robots.areas"
        raise LayoutError(
            f"no start for robot {spec.id}{where} beside {len(taken)} others: {error}"
        ) from error
    return point


def _check_distances(specs: Sequence[RobotSpec], poses: dict[str, StartPose]) -> None:
    for index, spec in enumerate(specs):
        here = Point(*poses[spec.id][:2])
        for other in specs[:index]:
            distance, minimum = here.distance_to(Point(*poses[other.id][:2])), spec.radius + other.radius
            if distance < minimum:
                raise LayoutError(
                    f"robots {other.id} and {spec.id} start {distance:.3f} m apart at"
                    f" ({here.x:g}, {here.y:g}), but must be at least {minimum:.3f} m apart"
                )


def check_events(grid: OccupancyGrid, specs: Sequence[RobotSpec], scenario: Scenario) -> None:
    """Raise AcrcError if an event puts a robot or an item into a wall."""
    radius, (task, _) = {spec.id: spec.radius for spec in specs}, scenario_task(scenario)
    for index, event in enumerate(scenario.event):
        if event.move is not None and event.to is not None:
            check_pose(grid, Point(*event.to[:2]), radius[event.move], event.move)
        for item, read in zip(event.items or (), decode_items(task, event.items or ()), strict=True):
            if fault := _item_fault(task, read, grid):
                raise LayoutError(
                    f"event[{index}].{scenario.table} has {wording.toml_text(item)}, but must {fault}"
                )


def check_doors(grid: OccupancyGrid, specs: Sequence[RobotSpec], scenario: Scenario) -> None:
    """Raise LayoutError for an unknown door, or one that is already closed or open at an event."""
    doorways = Doorways(grid, max(spec.radius for spec in specs))
    closed: set[int] = set()
    for index, event in sorted(enumerate(scenario.event), key=lambda item: item[1].at):
        point, verb = event.close or event.open, "open" if event.close is None else "close"
        if point is None:
            continue
        try:
            door = doorways.at(Point(*point))
            doorways.closed_cells(door)
        except DoorError as error:
            raise LayoutError(f"event[{index}].{verb}: {error}") from None
        if (door.index in closed) == (verb == "close"):
            state = "closed" if verb == "close" else "open"
            raise LayoutError(f"event[{index}] cannot {verb} a door at {event.at:g} s: it is {state} then")
        closed ^= {door.index}


def _items(grid: OccupancyGrid, spec: RobotSpec, start: StartPose, scenario: Scenario) -> tuple[Any, ...]:
    """Return the robot's items as in a file: listed in its table, or drawn by the task."""
    (task, settings), listed = scenario_task(scenario), spec.table.items
    if listed is not None:
        items = decode_items(task, listed)
    else:
        placing = DrawInput(
            robot=spec.id,
            index=scenario.ids.index(spec.id),
            start=Pose(*start),
            radius=spec.radius,
            grid=grid,
            map=scenario.map,
            areas=scenario.areas,
            generator=partial(generator, scenario.run.seed_of("placement")),
        )
        with named_faults(task, "draw"):
            items = decode_items(task, task.draw(settings, placing), f"{scenario.table} drawn for {spec.id}")
    for index, item in enumerate(items):
        if fault := _item_fault(task, item, grid):
            text = wording.toml_text(to_builtins(item) if listed is None else listed[index])
            raise LayoutError(
                f"{task.declaration.item} {index} of robot {spec.id} is {text}, "
                f"but must {fault} of {scenario.map}"
            )
    return tuple(tuple(one) if isinstance(one, list) else one for one in map(to_builtins, items))


def _item_fault(task: Task, item: Any, grid: OccupancyGrid) -> str | None:
    with named_faults(task, "check"):
        return task.check(item, grid)
