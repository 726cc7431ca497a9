"""Robots' vehicles on emulated devices in simulated time: what their sensors say, and how they are held.

The base process's vehicle (firmware_bridge.onboard.vehicle) with lines of memory to a laboratory, and a pilot
in place of the robot's program: no process, no clock, the same on every run.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator

from actors.instant import START, Instant, milliseconds, seconds
from actors.messages import NO_ECHO_MM, Scan
from actors.radio.radio_model import RadioSetup
from actors.randomness import generator
from actors.robot_model import load_model
from actors.world.physics import SUBSTEP
from actors.world.world_setup import BodySetup, WorldSetup
from firmware_bridge.device_lines import BASE, CLEAN, RADIO, RANGE, Disturbance, Jack
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.laboratory.laboratory import Laboratory
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup
from firmware_bridge.onboard.vehicle import LastWord, Lidar, TurtleBot
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.serial_port import SerialPort

MODEL: Final = load_model("turtlebot2", "chapter")
_STEP: Final = milliseconds(100)
_TURN: Final = 1.2
"""rad/s of a pilot who looks for a way."""
Starts = Sequence[tuple[float, float, float]]


class Pilot:
    """Drives at `speed`, now and then in arcs, away from what is near; as a stranger would, without a map."""

    def __init__(self, speed: float, random: Generator) -> None:
        self._speed = speed
        self._random = random
        self._omega = 0.0
        self._rotates = 0
        self._arc = 0
        self.straight = False
        """True: no arcs."""

    def steer(self, scan: Scan | None) -> tuple[float, float]:
        """m/s and rad/s for the next step."""
        if scan is not None:
            self._look(scan)
        if self._rotates:
            self._rotates -= 1
            return 0.0, self._omega
        if self._arc == 0:
            self._arc = int(self._random.integers(10, 40))
            bends = 0.0 if self.straight else 0.8
            self._omega = float(self._random.uniform(-bends, bends)) * bool(self._random.integers(0, 2))
        self._arc -= 1
        return self._speed, self._omega

    def _look(self, scan: Scan) -> None:
        ranges = np.frombuffer(scan.ranges_mm, "<u2").astype(np.float64)
        ranges[ranges == NO_ECHO_MM] = 60_000.0
        sensor = MODEL.sensor
        angles = sensor.first_angle + sensor.increment * np.arange(sensor.rays)
        ahead = np.abs(angles) < math.radians(35)
        if self._rotates == 0 and ranges[ahead].min() < 700:
            left = np.median(ranges[(angles > 0.3) & (angles < 1.5)])
            right = np.median(ranges[(angles < -0.3) & (angles > -1.5)])
            self._omega = math.copysign(_TURN, left - right)
            self._rotates = int(self._random.integers(8, 18))


class MemoryPort(SerialPort):
    """A line without a device file."""

    def __init__(self) -> None:
        self.inbox = self.outbox = b""

    def read(self) -> bytes:
        """All that has come."""
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data: bytes) -> None:
        """Never waits."""
        self.outbox += data

    def close(self) -> None:
        """Nothing."""


class Trusted(LastWord):
    """A guardian that is there, without a process."""

    def __init__(self) -> None:
        pass

    def serve(self, now: Instant, port: object) -> None:
        """Nothing."""

    def holds(self, now: Instant) -> bool:
        """It does."""
        return True

    def close(self) -> None:
        """Nothing."""


@dataclass
class Told:
    """That a robot was held by other causes than before."""

    instant: Instant
    causes: frozenset[HoldCause]


class RigVehicle:
    """One robot's vehicle, its two lines, and its pilot."""

    def __init__(self, pilot: Pilot, noise: Generator) -> None:
        self.pilot: Pilot | None = pilot
        self.lines = {BASE: MemoryPort(), RANGE: MemoryPort()}
        self.noise = {"in": CLEAN, "out": CLEAN}
        """What happens to the bytes of the base's line, from and to the base."""
        self._random = noise
        self.kobuki = KobukiDriver(START)
        lidar = Lidar(lambda: self.lines[RANGE], Rplidar(MODEL.sensor, START), self._say)
        mount = MODEL.sensor.mount
        self.bot = TurtleBot(lambda: self.lines[BASE], self.kobuki, lidar, Trusted(), self._say, mount)
        self.said: list[str] = []
        self.told: list[Told] = []

    def scramble(self, share: float, ways: str) -> None:
        """Damage so many of the bytes; `ways`: in, out or both."""
        for way in self.noise:
            if ways in (way, "both"):
                self.noise[way] = Disturbance(share / 3, share / 3, share / 3)

    def from_device(self, device: str, data: bytes) -> None:
        """Bytes on their way to the driver."""
        if device == BASE:
            data = self.noise["in"].apply(data, self._random)
        self.lines[device].inbox += data

    def to_device(self, device: str) -> bytes:
        """Bytes that have left for the device."""
        line = self.lines[device]
        data, line.outbox = line.outbox, b""
        return self.noise["out"].apply(data, self._random) if device == BASE else data

    def serve(self, now: Instant) -> None:
        """One round of the base process."""
        self.bot.serve(now)
        causes = frozenset(stop.cause for stop in self.kobuki.allowed.stops)
        if causes != (self.told[-1].causes if self.told else frozenset()):
            self.told.append(Told(now, causes))

    def _say(self, line: str) -> None:
        self.said.append(line)


class SensorRig:
    """A laboratory and the vehicles in it, from sub-step to sub-step of the physics."""

    def __init__(self, floor: Path, starts: Starts, seed: int, speed: float = 0.5) -> None:
        bodies = tuple(
            BodySetup(f"r{number}", "turtlebot2", "chapter", "kobuki", start, ())
            for number, start in enumerate(starts, start=1)
        )
        world = WorldSetup(str(floor), seed, _STEP, 1_000_000, bodies)
        addresses = tuple((body.id, number) for number, body in enumerate(bodies, start=1))
        radio = RadioSetup(seed, _STEP, addresses, "beeclick")
        self.laboratory = Laboratory(LaboratorySetup(world, radio))
        self.vehicles = {
            body.id: RigVehicle(
                Pilot(speed, generator(seed, "pilot", body.id)), generator(seed, "line noise", body.id)
            )
            for body in bodies
        }

    @property
    def now(self) -> Instant:
        """Up to when everything has moved."""
        return self.laboratory.now

    def run(self, time_s: float, each: Callable[[], bool] = lambda: False) -> None:
        """Go on for so long, or until `each`, asked after every sub-step, says True."""
        end = self.now + seconds(time_s)
        while self.now < end:
            self._step(Instant(self.now + SUBSTEP))
            if each():
                return

    def speed(self, robot: str = "r1") -> float:
        """True, m/s."""
        return self.laboratory.robots[robot].body.truth().v

    def cruises(self, speed: float, bends: bool, robot: str = "r1") -> bool:
        """True while it drives at that speed, and if it is to, in an arc."""
        vehicle = self.vehicles[robot]
        fast = self.speed(robot) > speed and not self.told_to_stand(robot)
        return fast and (not bends or abs(vehicle.kobuki.allowed.omega) > 0.3)

    def told_to_stand(self, robot: str = "r1") -> bool:
        """True if its wheels were last told not to turn."""
        return self.laboratory.robots[robot].body.is_told_to_stand

    def _step(self, now: Instant) -> None:
        self.laboratory.advance(now, self._deliver)
        for name, vehicle in self.vehicles.items():
            if now % _STEP == 0:
                scan = vehicle.bot.scan()
                if vehicle.pilot is not None:
                    vehicle.bot.command(now, now, *vehicle.pilot.steer(scan))
            vehicle.serve(now)
            for device in vehicle.lines:
                self.laboratory.take(Jack(name, device), now, vehicle.to_device(device))

    def _deliver(self, jack: Jack, data: bytes) -> None:
        if jack.device != RADIO:
            self.vehicles[jack.robot].from_device(jack.device, data)
