"""A robot from its parts: which localiser, which driver, whose behaviour."""

from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

from actors import distance, flood
from actors.geometry import Point, Pose
from actors.grid import OccupancyGrid
from actors.instant import in_seconds
from actors.randomness import generator
from actors.robot import aim, obstruction, potential, swerve
from actors.robot.adaptation import Adaptation
from actors.robot.behaviour import load_behaviour
from actors.robot.core import Parts, RobotCore
from actors.robot.driving import Driver, DrivingParameters
from actors.robot.floor_plan import ReachableFloor
from actors.robot.localisation import DeadReckoning
from actors.robot.navigation import Navigation
from actors.robot.planning import Ground, Planner, ground
from actors.robot.ports import Start
from actors.robot.surroundings import Surroundings
from actors.robot_model import RobotModel
from actors.runtime.fingerprint import fingerprints

_BRAKING_SHARE: Final = 0.4
"""Of the base's deceleration, at most so much is planned with; see DrivingParameters.braking."""


@dataclass(frozen=True)
class RobotSetup:
    """Everything that makes up one robot, whatever process it runs in."""

    id: str
    epoch: int
    first_step: int
    seed: int
    step_us: int
    address: int
    start: Pose
    places: tuple[Point, ...]
    behaviour: str
    """Entry string `module:function`."""
    adaptation: Adaptation = field(default_factory=Adaptation)


def floor(plan: OccupancyGrid, model: RobotModel) -> Ground:
    """The floor plan for the model's body; may be shared by all robots of a process."""
    return ground(plan, model.footprint.circumradius)


def start(setup: RobotSetup, model: RobotModel, floor: Ground) -> Start:
    """What the robot's behaviour is told before its first step."""
    own, told = generator(setup.seed, "behaviour", setup.id, setup.epoch), setup.adaptation
    return Start(
        robot=setup.id,
        address=setup.address,
        epoch=setup.epoch,
        pose=setup.start,
        places=setup.places,
        generator=own,
        settings=MappingProxyType(dict(told.settings)),
        exchange=told.exchange,
        floor=ReachableFloor(floor, model.footprint.circumradius, setup.start.point, told.areas, own),
    )


def robot(setup: RobotSetup, model: RobotModel, floor: Ground) -> RobotCore:
    """The core of a robot."""
    surroundings = Surroundings(model.sensor)
    driver = Driver(
        floor, surroundings, model.footprint.circumradius, in_seconds(setup.step_us), _driving(model)
    )
    parts = Parts(
        localisation=DeadReckoning(setup.start),
        surroundings=surroundings,
        navigation=Navigation(Planner(floor), driver),
        behaviour=load_behaviour(setup.behaviour, start(setup, model, floor)),
    )
    return RobotCore(
        setup.id, parts, entry=setup.behaviour, first_step=setup.first_step, step_us=setup.step_us
    )


def _driving(model: RobotModel) -> DrivingParameters:
    """The default parameters, within what the model's drive can do."""
    drive, parameters = model.drive, DrivingParameters()
    return replace(
        parameters,
        speed=min(parameters.speed, drive.speed),
        turn_rate=min(parameters.turn_rate, drive.turn_rate),
        acceleration=min(parameters.acceleration, drive.acceleration),
        turn_acceleration=min(parameters.turn_acceleration, drive.turn_acceleration),
        braking=min(parameters.braking, _BRAKING_SHARE * drive.acceleration),
    )


def kernels() -> dict[str, str]:
    """Fingerprint of every numeric kernel that a robot computes with, by module; also compiles them all."""
    return fingerprints((distance, flood, potential, aim, obstruction, swerve))
