"""Bodies and devices of a laboratory, without clock and I/O: told what time it is, it says what goes out."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from actors.geometry import Pose
from actors.instant import START, Instant
from actors.portable import arrays
from actors.radio.presets import preset
from actors.randomness import generator
from actors.robot_model import load_model
from actors.task.referee import PlaceOutcome, Referee
from actors.world.body import Bodies, real_floor
from actors.world.physics import SUBSTEP
from actors.world.uncertainty import drifting
from firmware_bridge.beeclick.emulation import emulated_medium
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulation.emulated_medium import EmulatedMedium, MediumParameters, Place
from firmware_bridge.kobuki.base import EXACT, BaseParameters, EmulatedKobuki
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup
from firmware_bridge.laboratory.robot_body import RobotBody
from firmware_bridge.laboratory.sights import LIDAR, Sights
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar

BASE: Final = "base"
RADIO: Final = "radio"
RANGE: Final = "range"
DEVICES: Final = (BASE, RADIO, RANGE)


class Jack(NamedTuple):
    """Where a device is plugged in."""

    robot: str
    device: str
    """One of DEVICES."""


Out = Callable[[Jack, bytes], None]


class EmulatedHardware(NamedTuple):
    """One robot's devices."""

    body: RobotBody
    base: EmulatedKobuki
    board: EmulatedBoard
    lidar: EmulatedRplidar


class Laboratory:
    """The hardware of all robots; time begins at 0.

    Bodies, bases and lidars go from sub-step to sub-step of the physics, boards and their medium through
    every instant: a driver of a base does not notice 10 ms, the host of a board does.
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
        self._medium = EmulatedMedium(
            generator(seed, "laboratory air", ""), MediumParameters(preset(setup.radio))
        )
        self.robots: Mapping[str, EmulatedHardware] = {
            robot.id: self._hardware(
                index,
                generator(seed, "laboratory base", robot.id),
                generator(seed, "laboratory lidar", robot.id),
                robot.odometry,
            )
            for index, robot in enumerate(world.robots)
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
        wakes = (self._medium.wake(), *(board.wake() for board in self._medium.boards))
        return min((at for at in wakes if at is not None), default=self._due)

    @property
    def contacts(self) -> int:
        """Between robots, or of a robot with a wall, that have begun so far."""
        return self._bodies.contacts

    @property
    def places(self) -> tuple[PlaceOutcome, ...]:
        """Which have truly been reached, when and by whom."""
        return self._referee.places(())

    @property
    def medium(self) -> Mapping[str, int]:
        """Counters of the boards' medium."""
        return self._medium.counters

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
            robot.board.take(now, data)
        elif jack.device == BASE:
            robot.base.take(self._now, data)
        else:
            robot.lidar.take(self._now, data)

    def advance(self, until: Instant, out: Out) -> None:
        """Let time pass; `out` gets what the devices send."""
        while self._due <= until:
            self._move()
            for name, robot in self.robots.items():
                out(Jack(name, BASE), robot.base.run(self._now))
                out(Jack(name, RANGE), robot.lidar.run(self._now))
        self._instant = until
        emulated_medium.advance(self._medium, until)
        for name, robot in self.robots.items():
            out(Jack(name, RADIO), robot.board.run(until))

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
        for index in range(len(self.robots)):
            self._sights.poses[index] = self._bodies.truth(index)[:3]
        self._referee.watch(self._now, self._sights.poses[:, :2])

    def _hardware(
        self, index: int, random: np.random.Generator, noise: np.random.Generator, odometry: str
    ) -> EmulatedHardware:
        body = RobotBody(self._bodies, index)
        errors = self._errors if odometry == "kobuki" else EXACT
        board = EmulatedBoard(self._medium, START)
        self._medium.add(board, self._place(index))
        base = EmulatedKobuki(body, random, BaseParameters(errors))
        lidar = EmulatedRplidar(self._sights.of(index), LIDAR, generator=noise)
        return EmulatedHardware(body, base, board, lidar)

    def _place(self, index: int) -> Place:
        def place(_: Instant) -> tuple[float, float]:
            x, y, *_rest = self._bodies.truth(index)
            return x, y

        return place

    def _index(self, robot: str) -> int:
        return list(self.robots).index(robot)
