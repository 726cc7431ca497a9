"""From a scenario to who stands where with what to do: every choice made, every random draw drawn."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.instant import milliseconds, seconds
from actors.radio import radio_model
from actors.radio.propagation.interferers import WifiParameters
from actors.radio.propagation.walls import WallPatch, inside
from actors.radio.radio_model import RadioSetup
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.stack import Stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies import entry
from deploy.scenario.events import check_areas, of_places, timed_orders
from deploy.scenario.placement import RobotSpec, check_doors, check_events, places, starts
from deploy.scenario.stack_tables import adaptation, presets_of, stack_of
from deploy.scenario.tables import PlacesTable, RobotTable, Scenario


@dataclass(frozen=True, kw_only=True)
class Swarm:
    """A swarm of which nothing is left open."""

    world: WorldSetup
    """Floor and bodies."""
    radio: RadioSetup
    """The air."""
    behaviour: str
    """Entry string `module:function` of the robots' behaviour."""
    adaptation: Adaptation
    """What every robot is told about its strategy and exchange."""
    stack: Stack
    """What every robot is told about how it localises and navigates."""


@dataclass(frozen=True, kw_only=True)
class ResolvedScenario(Swarm):
    """A scenario of which nothing is left open."""

    scenario: Scenario
    """Means the same as the one that was given, and draws nothing: every robot has a table of its own."""
    grid: OccupancyGrid = field(compare=False)
    """The floor plan."""


def robot_setup(swarm: Swarm, robot: BodySetup) -> RobotSetup:
    """What one of its robots is told at its first start."""
    return RobotSetup(
        id=robot.id,
        epoch=0,
        first_step=0,
        seed=swarm.world.robot_seed(robot.id),
        step_us=swarm.world.step_us,
        address=dict(swarm.radio.robots)[robot.id],
        start=robot.start,
        places=tuple(Point(*place) for place in robot.places),
        behaviour=swarm.behaviour,
        model=robot.model,
        sensor=robot.sensor,
        adaptation=swarm.adaptation,
        stack=swarm.stack,
    )


def resolve(scenario: Scenario) -> ResolvedScenario:
    """Everything that the scenario leaves to be drawn or looked up, from its seed.

    What one robot gets depends on the robots before it only, so a larger count changes nothing for them.
    Raises an AcrcError where anything does not exist or does not fit.
    """
    behaviour = entry(scenario.run.strategy)
    radio_model.preset(scenario.radio.preset)
    grid = load_map(scenario.map)
    figures = [_figure(robot, scenario) for robot in scenario.ids]
    check_areas(grid, scenario)
    _check_walls(grid, scenario)
    poses = starts(grid, figures, scenario)
    check_events(grid, figures, scenario)
    check_doors(grid, figures, scenario)
    robots = tuple(
        BodySetup(
            figure.id, figure.model, figure.sensor, figure.odometry, start,
            places(grid, figure, start, scenario),
        )
        for figure, start in zip(figures, poses, strict=True)
    )  # fmt: skip
    run, step_us = scenario.run, milliseconds(scenario.run.step_ms)
    world = WorldSetup(
        map=scenario.map,
        seed=run.seed,
        key=run.key or "",
        step_us=step_us,
        duration_us=seconds(run.duration),
        robots=robots,
        events=timed_orders(scenario),
        uncertainty=Uncertainty(**dict(scenario.uncertainty)),
    )
    if world.uncertainty != Uncertainty():  # else what is said above of the map holds
        _check_floor(world)
    addresses = tuple((robot.id, number) for number, robot in enumerate(robots, start=1))
    settled = _settled(scenario, robots)
    return ResolvedScenario(
        scenario=settled,
        grid=grid,
        world=world,
        radio=_radio_setup(scenario, addresses),
        behaviour=behaviour,
        adaptation=adaptation(settled.strategy, settled.deeco, settled.area),
        stack=stack_of(settled),
    )


def _check_walls(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if a table [[wall]] holds nothing that is occupied."""
    for index, (patch, table) in enumerate(zip(_patches(scenario), scenario.wall, strict=True)):
        if not (grid.cells[inside(grid, patch)] == OCCUPIED).any():
            (x0, x1), (y0, y1) = table.x, table.y
            raise AcrcError(
                f"wall[{index}] spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g} m, where nothing is occupied,"
                " but must hold a wall"
            )


def _radio_setup(scenario: Scenario, addresses: tuple[tuple[str, int], ...]) -> RadioSetup:
    """What the radio is told: robots with their short addresses, the preset, what differs from it."""
    radio = scenario.radio
    return RadioSetup(
        seed=scenario.run.seed_of("radio"),
        step_us=milliseconds(scenario.run.step_ms),
        robots=addresses,
        preset=radio.preset,
        map=scenario.map,
        walls=radio.walls,
        patches=_patches(scenario),
        shadowing_db=radio.shadowing_db,
        correlation_distance=radio.correlation_distance,
        channel=radio.channel,
        wifi=tuple(
            WifiParameters(*station.at, station.channel, station.duty, station.power_dbm)
            for station in scenario.wifi
        ),
    )


def _patches(scenario: Scenario) -> tuple[WallPatch, ...]:
    return tuple(WallPatch(table.material, table.x, table.y) for table in scenario.wall)


def _check_floor(world: WorldSetup) -> None:
    """Raise PlacementError now, and not in the world's process, if there is no such floor."""
    from actors.world.body import real_floor  # noqa: PLC0415 - the physics, for few scenarios

    real_floor(world, [load_model(robot.model, robot.sensor) for robot in world.robots])


def _figure(robot: str, scenario: Scenario) -> RobotSpec:
    """The robot's own table, and what holds for all robots where that says nothing."""
    common = scenario.robots
    own = next((table for table in scenario.robot if table.id == robot), RobotTable(id=robot))
    name = own.model or common.model
    model = load_model(name, own.sensor or (common.sensor if name == common.model else None))
    odometry = own.odometry or common.odometry or model.odometry
    return RobotSpec(robot, name, model.sensor_name, odometry, model.footprint.circumradius, own)


def _settled(scenario: Scenario, robots: Sequence[BodySetup]) -> Scenario:
    """The scenario with a table for each robot that leaves nothing to be drawn.

    Of the areas it keeps those of the places: robots may ask for a random point there.
    """
    tables = tuple(
        RobotTable(
            id=robot.id,
            model=robot.model,
            sensor=robot.sensor,
            odometry=robot.odometry,
            start=robot.start,
            places=robot.places,
        )
        for robot in robots
    )
    return scenario.model_copy(
        update={
            "robots": scenario.robots.model_copy(update={"start": (), "areas": None}),
            "places": PlacesTable(preset="listed"),
            **{
                name: {"preset": preset, **getattr(scenario, name)}
                for name, preset in presets_of(scenario).items()
            },
            "area": of_places(scenario),
            "robot": tables,
        }
    )
