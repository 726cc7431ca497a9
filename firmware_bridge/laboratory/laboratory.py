"""Bodies, boards and lines of a laboratory, without clock and I/O: `advance` says what has to go out."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from actors.instant import Instant
from actors.radio.parameters import preset
from actors.randomness import generator
from actors.robot_model import load_model
from actors.world.body import Bodies
from actors.world.odometry import KobukiErrors
from actors.world.physics import SUBSTEP
from actors.world.referee import Referee
from firmware_bridge.beeclick.board import Board
from firmware_bridge.beeclick.medium import Air, AirParameters, Place, advance
from firmware_bridge.emulation import EmulatedDevice
from firmware_bridge.kobuki.base import EXACT, BaseParameters, EmulatedKobuki
from firmware_bridge.laboratory.robot_body import RobotBody
from firmware_bridge.laboratory.setup import LaboratorySetup
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar

DEVICES: Final = ("base", "radio", "range")


class Laboratory:
    """The hardware of all robots; time begins at 0."""

    def __init__(self, setup: LaboratorySetup) -> None:
        world = setup.world
        self._bodies = Bodies(world)
        self._referee = Referee(world.robots, world.reach)
        seed = world.seed
        self._air = Air(generator(seed, "laboratory air", ""), AirParameters(preset(setup.radio)))
        self._robots: list[RobotBody] = []
        self._devices: dict[tuple[str, str], EmulatedDevice] = {}
        self._boards: dict[str, Board] = {}
        for index, robot in enumerate(world.robots):
            model = load_model(robot.model, robot.sensor)
            body = RobotBody(self._bodies, index, model.sensor)
            errors = KobukiErrors() if robot.odometry == "kobuki" else EXACT
            random = generator(seed, "laboratory base", robot.id)
            board = self._boards[robot.id] = Board(self._air, Instant(0))
            self._air.add(board, self._place(index))
            self._robots.append(body)
            self._devices[robot.id, "base"] = EmulatedKobuki(body, random, BaseParameters(errors))
            self._devices[robot.id, "radio"] = board
            self._devices[robot.id, "range"] = EmulatedRplidar(body.sight)
        self._now = Instant(0)
        self._watch()

    @property
    def now(self) -> Instant:
        """Up to when everything has happened."""
        return self._now

    @property
    def devices(self) -> Mapping[tuple[str, str], EmulatedDevice]:
        """Every device by robot and by one of DEVICES; bytes for one go to its `take`."""
        return self._devices

    @property
    def referee(self) -> Referee:
        """What has truly been reached."""
        return self._referee

    @property
    def contacts(self) -> int:
        """Between robots, or of a robot with a wall, that have begun so far."""
        return self._bodies.contacts

    @property
    def boards(self) -> dict[str, dict[str, int]]:
        """Each board's counters by robot."""
        return {robot: dict(board.counters) for robot, board in self._boards.items()}

    def advance(self, until: Instant, out: Callable[[str, str, bytes], None]) -> None:
        """Let time pass in sub-steps of the physics; `out` gets what a robot's device sends."""
        while self._now + SUBSTEP <= until:
            self._bodies.move(self._now, SUBSTEP)
            self._now = Instant(self._now + SUBSTEP)
            self._watch()
            advance(self._air, self._now)
            for (robot, device), emulated in self._devices.items():
                if data := emulated.run(self._now):
                    out(robot, device, data)

    def _watch(self) -> None:
        self._referee.watch(self._now, self._bodies.positions)
        for body in self._robots:
            body.sense(self._now)

    def _place(self, index: int) -> Place:
        bodies = self._bodies

        def place(_: Instant) -> tuple[float, float]:
            x, y = np.asarray(bodies.positions[index]).tolist()
            return x, y

        return place
