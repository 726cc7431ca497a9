"""Resolution of scenarios: robots, starts, places and all random draws."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from msgspec import UNSET, UnsetType
from msgspec.structs import asdict, replace

from actors import wording
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError, check_pose, draw_points
from actors.geometry import Point, wrap
from actors.instant import milliseconds, seconds
from actors.radio import radio_model
from actors.radio.radio_model import RadioSetup
from actors.radio.walls import cells_in
from actors.randomness import generator
from actors.robot.assembly import RobotSetup
from actors.robot.stack import Adaptation, Stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.world.people import PeopleParameters, PeopleSetup
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.place import GOLDEN
from cleaning.strategies import entry
from deploy.scenario.events import (
    check_areas,
    people_area_tables,
    place_area_tables,
    place_areas,
    start_areas,
    timed_orders,
)
from deploy.scenario.tables import PlacesTable, RobotTable, Scenario


class LayoutError(AcrcError):
    """A start, place or event that does not fit the floor plan."""


_SPACING: Final = 0.6
"""Minimum distance of drawn starts, and of one robot's places, from walls and each other, m. A robot can
pass between such a point and the wall."""
_DEFAULT_PLACES: Final = 10
"""Default number of places of a robot (d3scomp/deeco-adaptation-testbed, GARBAGE_PER_ROBOT)."""


@dataclass(frozen=True)
class RobotSpec:
    """One robot before its start and places are drawn."""

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
        places=tuple(Point(*place) for place in robot.places),
        behaviour=swarm.behaviour,
        model=robot.model,
        sensor=robot.sensor,
        adaptation=swarm.adaptation,
        stack=swarm.stack,
    )


def resolve(scenario: Scenario) -> ResolvedScenario:
    """Resolve names and draw all random starts and places of a scenario, from its seed.

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
        BodySetup(**asdict(spec.table) | {"start": start, "places": places(grid, spec, start, scenario)})
        for spec, start in zip(specs, start_poses, strict=True)
    )
    run, step_us = scenario.run, milliseconds(scenario.run.step_ms)
    world = WorldSetup(
        map=scenario.map,
        seed=run.seed,
        key=run.key or "",
        step_us=step_us,
        duration_us=seconds(run.duration),
        robots=robots,
        events=timed_orders(scenario),
        uncertainty=scenario.uncertainty,
        people=_people_setup(scenario),
    )
    if (
        world.has_people or world.uncertainty != Uncertainty()
    ):  # otherwise the checks of the map above suffice
        _check_floor(world)
    addresses = tuple((robot.id, number) for number, robot in enumerate(robots, start=1))
    explicit = _explicit_scenario(scenario, robots)
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
    """Return the scenario with every start and place listed in [[robot]] tables.

    Areas of places are kept: robots may request random points in them. Those of people become their own.
    """
    tables = tuple(RobotTable(**asdict(robot)) for robot in robots)
    presets = {name: {"preset": one, **getattr(scenario, name)} for name, one in scenario.presets.items()}
    people = scenario.people
    if people is not None:
        people = replace(people, areas=None, area=people_area_tables(scenario))
    return replace(
        scenario,
        people=people,
        robots=replace(scenario.robots, start=(), areas=None),
        places=PlacesTable(preset="listed"),
        area=place_area_tables(scenario),
        robot=tables,
        **presets,
    )


def starts(
    grid: OccupancyGrid, specs: Sequence[RobotSpec], scenario: Scenario
) -> list[tuple[float, float, float]]:
    """Return the robots' start poses in order: as in the scenario, else drawn apart from all others."""
    poses: dict[str, tuple[float, float, float]] = {}
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
        poses[spec.id] = (*_rounded_to_mm(point), 0.0)
    return [poses[spec.id] for spec in specs]


def _draw_start(
    grid: OccupancyGrid, spec: RobotSpec, scenario: Scenario, taken: Sequence[Point], floor: Point | None
) -> Point:
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
            areas=start_areas(scenario),
        )
    except PlacementError as error:
        where = "" if scenario.robots.areas is None else " in robots.areas"
        raise LayoutError(
            f"no start for robot {spec.id}{where} beside {len(taken)} others: {error}"
        ) from error
    return point


def _check_distances(specs: Sequence[RobotSpec], poses: dict[str, tuple[float, float, float]]) -> None:
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
    """Raise AcrcError if an event puts a robot or a place into a wall."""
    radius = {spec.id: spec.radius for spec in specs}
    for index, event in enumerate(scenario.event):
        if event.move is not None and event.to is not None:
            check_pose(grid, Point(*event.to[:2]), radius[event.move], event.move)
        for x, y in event.places or ():
            if not grid.is_free(Point(x, y)):
                raise LayoutError(f"event[{index}].places has ({x:g}, {y:g}), but must be on free floor")


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


def places(
    grid: OccupancyGrid, spec: RobotSpec, start: tuple[float, float, float], scenario: Scenario
) -> tuple[tuple[float, float], ...]:
    """Return the robot's places: listed in its table, or by preset."""
    if spec.table.places is not None:
        return _require_free(grid, spec, spec.table.places, f"of {scenario.map}")
    index = scenario.ids.index(spec.id)
    count = _DEFAULT_PLACES if scenario.places.per_robot is None else scenario.places.per_robot
    if scenario.places.preset == "golden" and index < len(GOLDEN):
        where = f'of {scenario.map}; places.preset "golden" is made for the map corridor'
        return _require_free(grid, spec, _golden_places(index, count), where)
    if count == 0:
        return ()
    areas = place_areas(scenario)
    try:
        points = draw_points(
            grid,
            count,
            rng=generator(scenario.run.seed_of("placement"), "places", spec.id),
            clearance=_SPACING,
            apart=_SPACING,
            start=Point(*start[:2]),
            passage=spec.radius,
            areas=areas,
        )
    except PlacementError as error:
        where = "on all free floor" if areas is None else "in places.areas"
        raise LayoutError(f"cannot draw {count} places for robot {spec.id} {where}: {error}") from error
    return tuple(map(_rounded_to_mm, points))


def _rounded_to_mm(point: Point) -> tuple[float, float]:
    """Round to mm, for a readable scenario file."""
    return round(point.x, 3), round(point.y, 3)


def _golden_places(index: int, count: int) -> Sequence[tuple[float, float]]:
    points = GOLDEN[index]
    if count > len(points):
        raise LayoutError(
            f'places.per_robot is {count}, but must be at most {len(points)} where places.preset is "golden"'
        )
    return points[:count]


def _require_free(
    grid: OccupancyGrid, spec: RobotSpec, points: Sequence[tuple[float, float]], where: str
) -> tuple[tuple[float, float], ...]:
    """Return the points. Raises LayoutError if one is not on free floor; `where`: end of the message."""
    for index, (x, y) in enumerate(points):
        if not grid.is_free(Point(x, y)):
            raise LayoutError(
                f"place {index} of robot {spec.id} is at ({x:g}, {y:g}), but must be on free floor {where}"
            )
    return tuple((x, y) for x, y in points)
