"""Reproducible trials of vehicles with emulated devices in simulated time, without processes.

The base process's vehicle (firmware_bridge.onboard.vehicle) has in-memory lines to a laboratory, and a pilot
instead of the robot program.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.instant import START, Instant, milliseconds, seconds
from actors.messages import NO_ECHO_MM, Scan
from actors.portable.draws import normals
from actors.radio.radio_model import RadioSetup
from actors.randomness import generator
from actors.robot_model import load_model
from actors.task.loading import DEFAULT, task_setup
from actors.world.physics import SUBSTEP
from actors.world.world_setup import BodySetup, WorldSetup
from firmware_bridge.device_lines import BASE, NO_NOISE, RADIO, RANGE, DevicePort, LineNoise
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.laboratory.laboratory import LIDAR, Laboratory, LaboratorySetup
from firmware_bridge.onboard.vehicle import GuardianLink, LidarDevice, TurtleBot
from firmware_bridge.range_sensors.rplidar import FULL_TURN_Q6, Rplidar, Sample
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, RangeFunction
from firmware_bridge.safety import HoldCause
from firmware_bridge.serial_port import SerialPort

MODEL = load_model("turtlebot2", "chapter")
STEP = milliseconds(100)
AVOIDING = 1.2
"""Turn rate of the pilot while avoiding an obstacle, rad/s."""
Starts = Sequence[tuple[float, float, float]]


class LidarFault(NamedTuple):
    """What a lidar reports instead of its measurements."""

    turns: int = 0
    """Number of last turns that are repeated forever; 0: none."""
    share: float = 1.0
    """Part of each turn that is repeated."""
    comb: bool = False
    """Repeat every other sample only."""
    noisy: bool = False
    """Add new noise to repeated samples."""
    late_s: float = 0.0
    """Delay of all samples, at most 2 s."""
    turned_deg: float = 0.0
    """Rotation on its mount, counter-clockwise."""
    mirrored: bool = False


class FaultyRplidar(EmulatedRplidar):
    """A lidar with injected data faults."""

    def __init__(self, sight: RangeFunction, noise: Generator) -> None:
        super().__init__(self._view, LIDAR, generator=noise)
        self._true_sight = sight
        self._noise = noise
        self._fault = LidarFault()
        self._measured: deque[Sample] = deque(maxlen=2 * LIDAR.samples)
        self._repeated: list[Sample] = []
        self._since = 0

    def fail(self, fault: LidarFault) -> None:
        """Set the fault from now on."""
        self._fault, self._since = fault, self._sampled
        turn = round(LIDAR.samples / LIDAR.turns)
        self._repeated = list(self._measured)[-turn * fault.turns :] if fault.turns else []

    def send(self, number: int, sample: Sample) -> None:
        self._measured.append(sample)
        fault, said = self._fault, self._measured
        if fault.late_s:
            back = min(len(said), round(fault.late_s * LIDAR.samples) + 1)
            start = back < len(said) and said[-back].angle_q6 < said[-back - 1].angle_q6
            sample = said[-back]._replace(start=start)
        elif self._repeated and self._repeats(number, sample):
            at = (number - self._since) % len(self._repeated)
            sample = self._repeated[at]
            sample = sample._replace(start=sample.angle_q6 < self._repeated[at - 1].angle_q6)
            if fault.noisy:
                noise = 1 + LIDAR.noise * normals(self._noise, 1)[0]
                distance = max(0, round(sample.distance_q2 * noise))
                sample = sample._replace(distance_q2=distance, quality=15 if distance else 0)
        super().send(number, sample)

    def _repeats(self, number: int, sample: Sample) -> bool:
        in_share = sample.angle_q6 < self._fault.share * FULL_TURN_Q6
        return in_share and (not self._fault.comb or number % 2 == 1)

    def _view(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        looked = np.radians(self._fault.turned_deg) - angles
        return self._true_sight(looked if self._fault.mirrored else -looked)


class Pilot:
    """Random driver without a map: straight lines, arcs, and turns away from obstacles."""

    def __init__(self, speed: float, random: Generator) -> None:
        self._speed, self._random = speed, random
        self._omega = 0.0
        self._turning = self._arc = 0
        self.straight = False
        """Drive no arcs."""

    def steer(self, scan: Scan | None) -> tuple[float, float]:
        """Return the velocity of the next step, m/s and rad/s."""
        if scan is not None and self._turning == 0:
            self._avoid(scan)
        if self._turning:
            self._turning -= 1
            return 0.0, self._omega
        if self._arc == 0:
            self._arc = int(self._random.integers(10, 40))
            bends = 0.0 if self.straight else 0.8
            self._omega = float(self._random.uniform(-bends, bends)) * bool(self._random.integers(0, 2))
        self._arc -= 1
        return self._speed, self._omega

    def _avoid(self, scan: Scan) -> None:
        ranges = np.frombuffer(scan.ranges_mm, "<u2").astype(np.float64)
        ranges[ranges == NO_ECHO_MM] = 60_000.0
        angles = MODEL.sensor.first_angle + MODEL.sensor.increment * np.arange(MODEL.sensor.rays)
        if ranges[np.abs(angles) < math.radians(35)].min() < 700:
            left = np.median(ranges[(angles > 0.3) & (angles < 1.5)])
            right = np.median(ranges[(angles < -0.3) & (angles > -1.5)])
            self._omega = math.copysign(AVOIDING, left - right)
            self._turning = int(self._random.integers(8, 18))


class Straight(Pilot):
    """Pilot with a constant velocity."""

    def __init__(self, v: float, omega: float = 0.0) -> None:
        self._velocity = v, omega

    def steer(self, scan: Scan | None) -> tuple[float, float]:
        return self._velocity


class MemoryPort(SerialPort):
    """A line without a device file."""

    def __init__(self) -> None:
        self.inbox = self.outbox = b""

    def read(self) -> bytes:
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data: bytes) -> None:
        self.outbox += data

    def close(self) -> None: ...


class PassiveGuardian(GuardianLink):
    """A guardian without a process, which never intervenes."""

    def __init__(self) -> None:
        self.watches = True

    def serve(self, now: Instant, port: object) -> None: ...

    def leave(self) -> None:
        self.watches = False

    def is_operational(self, now: Instant) -> bool:
        return self.watches

    def close(self) -> None: ...


class HoldChange(NamedTuple):
    """Change of the active stop causes."""

    instant: Instant
    causes: frozenset[HoldCause]


class RigVehicle:
    """One robot's vehicle, its two lines, and its pilot."""

    def __init__(self, pilot: Pilot, noise: Generator) -> None:
        self.pilot: Pilot | None = pilot
        self.lines = {BASE: MemoryPort(), RANGE: MemoryPort()}
        self.noise = {"in": NO_NOISE, "out": NO_NOISE}
        """Noise of the bytes from and to the base."""
        self._random = noise
        self.log: list[str] = []
        self.held: list[HoldChange] = []
        self.kobuki, self.guardian = KobukiDriver(START), PassiveGuardian()
        lidar = LidarDevice(lambda: self.lines[RANGE], Rplidar(MODEL.sensor, START), self.log.append)
        ports = (lambda: self.lines[BASE], self.kobuki, lidar, self.guardian, self.log.append)
        self.bot = TurtleBot(*ports, MODEL.sensor.mount)

    def disturb(self, share: float, ways: str) -> None:
        """Damage this share of the bytes; `ways`: in, out or both."""
        for way in self.noise:
            if ways in (way, "both"):
                self.noise[way] = LineNoise(share / 3, share / 3, share / 3)

    def from_device(self, device: str, data: bytes) -> None:
        self.lines[device].inbox += self.noise["in"].apply(data, self._random) if device == BASE else data

    def to_device(self, device: str) -> bytes:
        line = self.lines[device]
        data, line.outbox = line.outbox, b""
        return self.noise["out"].apply(data, self._random) if device == BASE else data

    def serve(self, now: Instant) -> None:
        """Run one cycle of the base process."""
        self.bot.serve(now)
        causes = frozenset(stop.cause for stop in self.kobuki.allowed.stops)
        if causes != (self.held[-1].causes if self.held else frozenset()):
            self.held.append(HoldChange(now, causes))


class SensorRig:
    """A laboratory and its vehicles, advanced by sub-steps of the physics."""

    def __init__(self, floor: Path, starts: Starts, seed: int, speed: float = 0.5) -> None:
        bodies = tuple(
            BodySetup(
                id=f"r{number}",
                model="turtlebot2",
                sensor="chapter",
                odometry="kobuki",
                start=start,
            )
            for number, start in enumerate(starts, start=1)
        )
        world = WorldSetup(str(floor), seed, STEP, 1_000_000, bodies, task_setup(DEFAULT, {}))
        addresses = tuple((body.id, number) for number, body in enumerate(bodies, start=1))
        self.laboratory = Laboratory(
            LaboratorySetup(world, RadioSetup(seed=seed, step_us=STEP, robots=addresses, preset="beeclick"))
        )
        self.lidars = {
            name: FaultyRplidar(hardware.lidar._sight, generator(seed, "laboratory lidar", name))
            for name, hardware in self.laboratory.robots.items()
        }
        self.laboratory.robots = {
            name: hardware._replace(lidar=self.lidars[name])
            for name, hardware in self.laboratory.robots.items()
        }
        self.vehicles = {
            body.id: RigVehicle(
                Pilot(speed, generator(seed, "pilot", body.id)), generator(seed, "line noise", body.id)
            )
            for body in bodies
        }

    @property
    def now(self) -> Instant:
        return self.laboratory.now

    def run(self, time_s: float, until: Callable[[], bool] = lambda: False) -> None:
        """Advance for this time, or until the condition holds after a sub-step."""
        end = self.now + seconds(time_s)
        while self.now < end:
            self._step(Instant(self.now + SUBSTEP))
            if until():
                return

    def speed(self) -> float:
        """Return the true speed of r1, m/s."""
        return self.laboratory.robots["r1"].body.truth().v

    def cruises(self, speed: float, in_arc: bool) -> bool:
        """Return whether r1 drives faster than `speed`, and in an arc if `in_arc`."""
        omega = self.vehicles["r1"].kobuki.allowed.omega
        return self.speed() > speed and not self.commanded_to_stand() and (not in_arc or abs(omega) > 0.3)

    def commanded_to_stand(self) -> bool:
        """Return whether the last command to the wheels of r1 was a stop."""
        return self.laboratory.robots["r1"].body.is_commanded_to_stand

    def _step(self, now: Instant) -> None:
        self.laboratory.advance(now, self._deliver)
        for name, vehicle in self.vehicles.items():
            if now % STEP == 0:
                scan = vehicle.bot.scan()
                if vehicle.pilot is not None:
                    vehicle.bot.command(now, now, *vehicle.pilot.steer(scan))
            vehicle.serve(now)
            for device in vehicle.lines:
                self.laboratory.take(DevicePort(name, device), now, vehicle.to_device(device))

    def _deliver(self, port: DevicePort, data: bytes) -> None:
        if port.device != RADIO:
            self.vehicles[port.robot].from_device(port.device, data)
