"""Bodies and devices of a laboratory, without clock and I/O: told what time it is, it says what goes out."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose
from actors.instant import START, Instant
from actors.messages import NO_ECHO_MM, Drive
from actors.portable import arrays, cos, sin
from actors.radio.radio_model import radio_model
from actors.randomness import generator
from actors.robot_model import RobotModel, load_model
from actors.task.referee import PlaceOutcome, Referee
from actors.world.body import Bodies, real_floor
from actors.world.orders import Orders
from actors.world.physics import SUBSTEP
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import drifting
from actors.world.world_setup import Participants
from firmware_bridge.beeclick.air import air
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.device_lines import BASE, RADIO, RANGE, Jack, SimulatedTransceiver
from firmware_bridge.kobuki.base import EXACT, BaseParameters, BodyTruth, EmulatedKobuki
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, EmulatedRplidarParameters, Sight

LIDAR: Final = EmulatedRplidarParameters(turns=5.5, samples=1980, noise=0.0025)
"""360 samples a turn, so that each lies on a whole degree, where a ray has been cast. Noise: own estimate, a
quarter of the accuracy of 1 % of the distance that Slamtec's data sheet of the A1 gives."""
_RAYS: Final = 360


class Sights:
    """The world's range sensors, with a lidar's rays in place of those of the robots' models.

    It is mounted as the model's sensor is, and as noisy.
    """

    def __init__(
        self, grid: OccupancyGrid, models: Sequence[RobotModel], generators: Sequence[Generator]
    ) -> None:
        """`generators`: one per robot, for the noise of its ranges."""
        lidars = [_with_lidar(model) for model in models]
        self._sensors = RangeSensors(grid, lidars, generators)
        self._first = lidars[0].sensor.first_angle if lidars else 0.0
        self.poses: NDArray[np.float64] = np.zeros((len(models), 3))
        """(n, 3): where the bodies are, m, rad, map frame."""
        self._obstacles: NDArray[np.float64] = np.empty((0, 3))

    def look(self, poses: Sequence[tuple[float, ...]], obstacles: NDArray[np.float64]) -> None:
        """From now on the bodies are there, and the obstacles: (n, 3), x, y and radius, m."""
        self.poses[:] = poses
        self._obstacles = obstacles

    def of(self, index: int) -> Sight:
        """What one robot's lidar sees."""

        def sight(angles: NDArray[np.float64]) -> NDArray[np.float64]:
            (ranges_mm,) = self._sensors.scan([index], self.poses, self._obstacles)
            rays = np.rint((angles - self._first) / (math.tau / _RAYS)).astype(np.intp) % _RAYS
            seen = ranges_mm[rays]
            ranges: NDArray[np.float64] = np.where(seen == NO_ECHO_MM, np.inf, seen / 1000)
            return ranges

        return sight


def _with_lidar(model: RobotModel) -> RobotModel:
    return model.with_sensor(
        field_of_view_deg=360.0,
        rays=_RAYS,
        range_min=LIDAR.range_min,
        range_max=LIDAR.range_max,
        rate=LIDAR.turns,
    )


class RobotBody:
    """A kobuki.base.Body that the simulated world moves."""

    def __init__(self, bodies: Bodies, index: int) -> None:
        self._bodies = bodies
        self._index = index
        self._wanted = (0.0, 0.0)
        """As it was told last: m/s, rad/s."""

    def drive(self, v: float, omega: float) -> None:
        """As in Body."""
        self._wanted = (v, omega)

    @property
    def is_told_to_stand(self) -> bool:
        """True if the wheels were last told not to turn; the body brakes as it can."""
        return self._wanted == (0.0, 0.0)

    def hold(self, now: Instant) -> None:
        """Go on as last told: of a watchdog in a Kobuki nothing is known, so it should be safe without.

        To be called before every move of the bodies, whose own drives forget a wish after a while.
        """
        v, omega = self._wanted
        self._bodies.command(self._index, Drive(0, v, 0.0, omega, 0), now)

    def advance(self, now: Instant) -> None:
        """As in Body: somebody else moves it."""

    def truth(self) -> BodyTruth:
        """As in Body."""
        x, y, heading, vx, vy, omega = self._bodies.truth(self._index)
        return BodyTruth(Pose(x, y, heading), vx * cos(heading) + vy * sin(heading), omega)

    def bumper(self) -> int:
        """As in Body: pressed at any time since the last call."""
        return self._bodies.senses(self._index, 0, Instant(0), 0, False).bumper


Out = Callable[[Jack, bytes], None]


class EmulatedHardware(NamedTuple):
    """One robot's devices."""

    body: RobotBody
    base: EmulatedKobuki
    radio: EmulatedBoard | SimulatedTransceiver
    lidar: EmulatedRplidar


class Laboratory:
    """The hardware of all robots; time begins at 0.

    Bodies, bases and lidars go from sub-step to sub-step of the physics, boards and their air through every
    instant: a driver of a base does not notice 10 ms, the host of a board does. The air knows bodies as the
    radio of a simulated run does, from where they truly are and go at the beginning of a step; here that is a
    sub-step.
    """

    def __init__(self, setup: LaboratorySetup) -> None:
        """Raises AcrcError for what does not exist or does not fit."""
        world, seed = setup.world, setup.world.seed
        self._bodies = Bodies(world)
        _, self._errors = drifting(world.uncertainty)
        self._referee = Referee(world.robots, world.reach)
        models = [load_model(robot.model, robot.sensor) for robot in world.robots]
        noise = [generator(seed, "laboratory range", robot.id) for robot in world.robots]
        self._sights = Sights(real_floor(world, models).visible, models, noise)
        self.air = air(setup.radio)
        """What lies between the radios."""
        self._orders = Orders(world.events, Participants(world.robots), self._bodies, self._referee)
        self.robots: Mapping[str, EmulatedHardware] = {
            robot.id: self._hardware(index, setup) for index, robot in enumerate(world.robots)
        }
        """The devices of each robot."""
        self._now = self._instant = START
        self._travelled = np.zeros(len(models))
        self._look()

    @property
    def now(self) -> Instant:
        """Up to when the bodies have moved."""
        return self._now

    @property
    def instant(self) -> Instant:
        """Up to when the boards have lived, at most a sub-step later."""
        return self._instant

    @property
    def wake(self) -> Instant:
        """When something happens next that `advance` would have to make happen."""
        return self.air.wake() or self._due

    @property
    def contacts(self) -> int:
        """Between robots, or of a robot with a wall, that have begun so far."""
        return self._bodies.contacts

    @property
    def places(self) -> tuple[PlaceOutcome, ...]:
        """Which have truly been reached, when and by whom."""
        return self._referee.places(())

    def pose(self, robot: str) -> tuple[float, float, float]:
        """Where it truly is: x, y in m and heading in rad, map frame."""
        return self._bodies.truth(self._index(robot))[:3]

    def travelled(self, robot: str) -> float:
        """Length of its way so far, m."""
        return float(self._travelled[self._index(robot)])

    def carry(self, robot: str, pose: Pose) -> None:
        """Put a robot elsewhere. Raises AcrcError where it would not fit."""
        self._bodies.place(self._index(robot), pose)

    def take(self, jack: Jack, now: Instant, data: bytes) -> None:
        """Bytes that have come on a line; they belong to the sub-step or the instant that `advance` is at."""
        robot = self.robots[jack.robot]
        if jack.device == RADIO:
            robot.radio.take(now, data)
        elif jack.device == BASE:
            robot.base.take(self._now, data)
        else:
            robot.lidar.take(self._now, data)

    def advance(self, until: Instant, out: Out) -> None:
        """Let time pass; `out` gets what the devices send."""
        while self._due <= until:
            self.air.advance(self._due)
            self._move()
            for name, robot in self.robots.items():
                out(Jack(name, BASE), robot.base.run(self._now))
                out(Jack(name, RANGE), robot.lidar.run(self._now))
        self._instant = until
        self.air.advance(until)
        for name, robot in self.robots.items():
            out(Jack(name, RADIO), robot.radio.run(until))

    @property
    def _due(self) -> Instant:
        return Instant(self._now + SUBSTEP)

    def _move(self) -> None:
        for robot in self.robots.values():
            robot.body.hold(self._now)
        self._bodies.move(self._now, SUBSTEP)
        self._now = self._due
        before = self._sights.poses[:, :2].copy()
        self._look()
        self._travelled += arrays.hypot(*(self._sights.poses[:, :2] - before).T)

    def _look(self) -> None:
        """Carry out what is due at the beginning of a sub-step, and note where everybody is."""
        effects = self._orders.due(self._now)
        self.air.jam(self._now, effects.jams)
        for loss in effects.losses:
            self.air.withhold(self._index(loss.sender), self._index(loss.robot))
        states = [self._bodies.truth(index) for index in range(len(self.robots))]
        self.air.place(self._now, states)
        self._sights.look([state[:3] for state in states], self._bodies.obstacles)
        self._referee.watch(self._now, self._sights.poses[:, :2])

    def _hardware(self, index: int, setup: LaboratorySetup) -> EmulatedHardware:
        robot, seed = setup.world.robots[index], setup.world.seed
        body = RobotBody(self._bodies, index)
        errors = self._errors if robot.odometry == "kobuki" else EXACT
        radio = self._radio(robot.id, setup)
        self.air.add(radio)
        base = EmulatedKobuki(body, generator(seed, "laboratory base", robot.id), BaseParameters(errors))
        noise = generator(seed, "laboratory lidar", robot.id)
        lidar = EmulatedRplidar(self._sights.of(index), LIDAR, generator=noise)
        return EmulatedHardware(body, base, radio, lidar)

    def _radio(self, robot: str, setup: LaboratorySetup) -> EmulatedBoard | SimulatedTransceiver:
        if robot not in setup.without_board:
            return EmulatedBoard(self.air, START)
        channel = radio_model(setup.radio).parameters.channel
        return SimulatedTransceiver(self.air, BoardSettings(dict(setup.radio.robots)[robot], channel))

    def _index(self, robot: str) -> int:
        return list(self.robots).index(robot)
