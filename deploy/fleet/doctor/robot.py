"""Checks of what a robot is told: map, start, places, behaviour, keys."""

import contextlib
import sys
from collections.abc import Iterator, Mapping

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.geometry import Point
from actors.robot import assembly
from actors.robot.behaviour.foreign import Permit
from actors.robot.behaviour.modules import look_in
from actors.robot_model import RobotModel, load_model
from actors.runtime.access.tls import load_keys
from actors.runtime.errors import AcrcError
from deploy.fleet.doctor.machine import DoctorFinding, Machine, well, wrong
from deploy.fleet.fleet_file import Fleet, FleetRobot, own_code
from deploy.scenario.resolve import robot_setup


def floor(fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether the map loads, and start and places are on free floor."""
    try:
        grid, radii = (
            load_map(fleet.map),
            {one.id: _model(one).footprint.circumradius for one in fleet.robots},
        )
    except AcrcError as error:
        yield wrong("map", str(error))
        return
    width, height = grid.columns * grid.resolution, grid.rows * grid.resolution
    yield well("map", f"{fleet.map}: {width:.1f} m by {height:.1f} m")
    yield _start(fleet, robot, grid, radii)
    yield _places(robot, grid)


def behaviour(fleet: Fleet, robot: FleetRobot, permit: Permit) -> Iterator[DoctorFinding]:
    """Whether the robot can be made, with its strategy; runs the strategy's code once."""
    try:
        look_in(own_code(fleet, permit))
        with contextlib.redirect_stdout(sys.stderr):  # --json leaves nothing else there
            _make(fleet, robot)
    except AcrcError as error:
        yield wrong("behaviour", str(error))
    except Exception as error:
        yield wrong(
            "behaviour",
            f"strategy {fleet.run.strategy!r} fails with {type(error).__name__}: {error}; mend its code",
        )
    else:
        yield well("behaviour", f"strategy {fleet.run.strategy!r} makes a behaviour of its settings")


def keys(machine: Machine, fleet: Fleet, robot: FleetRobot) -> Iterator[DoctorFinding]:
    """Whether a robot that listens has keys of its own that hold today; nothing if it does not listen."""
    if robot.listen is None:
        return
    try:
        files = load_keys(fleet.keys_of(robot.id))
        own = machine.certificate(files.certificate)
        mode = machine.mode(files.private_key)
    except (AcrcError, OSError, ValueError) as error:
        yield wrong("keys", str(error))
        return
    now = machine.now()
    if own.name != robot.id:
        yield wrong(
            "keys", f"{files.certificate} is that of {own.name}; the folder of {robot.id} belongs here"
        )
    elif mode & 0o077:
        yield wrong("keys", f"{files.private_key} can be read by others; `chmod 600 {files.private_key}`")
    elif not own.begins <= now <= own.ends:
        yield wrong(
            "keys",
            f"{files.certificate} holds from {own.begins:%Y-%m-%d} to {own.ends:%Y-%m-%d}, but it is "
            f"{now:%Y-%m-%d} here; set the clock, or make new keys with `acrc fleet keys`",
        )
    else:
        yield well("keys", f"{files.certificate} holds until {own.ends:%Y-%m-%d}")


def _model(robot: FleetRobot) -> RobotModel:
    return load_model(robot.model, robot.sensor)


def _start(fleet: Fleet, robot: FleetRobot, grid: OccupancyGrid, radii: Mapping[str, float]) -> DoctorFinding:
    here = Point(*robot.start[:2])
    try:
        check_pose(grid, here, radii[robot.id], robot.id)
    except AcrcError as error:
        return wrong("start", str(error))
    for other in fleet.robots:
        gap, least = here.distance_to(Point(*other.start[:2])), radii[robot.id] + radii[other.id]
        if other.id != robot.id and gap < least:
            return wrong(
                "start",
                f"{robot.id} would stand {gap:.2f} m from {other.id}, but must be at least {least:.2f} m off",
            )
    return well("start", f"({here.x:g}, {here.y:g}) is free; put {robot.id} there, then switch it on")


def _places(robot: FleetRobot, grid: OccupancyGrid) -> DoctorFinding:
    for index, (x, y) in enumerate(robot.places):
        if not grid.is_free(Point(x, y)):
            return wrong("places", f"place {index} at ({x:g}, {y:g}) is not free, but must be on free floor")
    return well("places", f"all {len(robot.places)} are on free floor")


def _make(fleet: Fleet, robot: FleetRobot) -> None:
    alone = fleet.swarm(robot)
    told = robot_setup(alone, alone.world.robots[0])
    assembly.robot(told, _model(robot), load_map(fleet.map))
