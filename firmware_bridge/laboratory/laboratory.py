"""Bodies and emulated devices of a laboratory, without clock and I/O, and fault injection."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose
from actors.instant import START, Duration, Instant, in_seconds, milliseconds
from actors.messages import NO_ECHO_MM, Drive, RobotTruth
from actors.portable import arrays, cos, sin
from actors.radio.radio_model import RadioSetup, radio_parameters
from actors.randomness import generator
from actors.robot_model import RobotModel, interpolate, load_model
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.task.task import Judge, Task
from actors.world.battery import Batteries
from actors.world.body import Bodies, real_floor
from actors.world.order_execution import Orders
from actors.world.physics import SUBSTEP
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import with_drift
from actors.world.world_setup import Participants, WorldSetup
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulated_medium import BodyState, create_medium
from firmware_bridge.device_lines import (
    BASE,
    DEVICES,
    RADIO,
    RANGE,
    DevicePort,
    EmulatedLines,
    SimulatedTransceiver,
)
from firmware_bridge.kobuki.emulated_kobuki import (
    NO_ERRORS,
    BaseParameters,
    BodyTruth,
    EmulatedKobuki,
    KobukiFaults,
)
from firmware_bridge.range_sensors.rplidar import Health
from firmware_bridge.range_sensors.rplidar_emulator import (
    EmulatedRplidar,
    EmulatedRplidarParameters,
    RangeFunction,
)

SAMPLE: Final = milliseconds(100)
"""Interval of recorded positions, as long as a step of a simulated run."""


class LaboratorySetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Set-up of a laboratory. Raises AcrcError if inconsistent."""

    world: WorldSetup
    """Bodies and floor; step, duration and events for robot processes are ignored."""
    radio: RadioSetup
    """Radio medium, as in a simulated run; boards get their addresses from their hosts."""
    without_board: tuple[str, ...] = ()
    """Robots with a simulated transceiver instead of a board."""
    modules: tuple[str, ...] = ()
    """Folders from which the task may be loaded, which the user has named on the command line."""

    def __post_init__(self) -> None:
        robots = [robot.id for robot in self.world.robots]
        for robot in robots:
            if not robot or robot.startswith(".") or "/" in robot or not robot.isprintable() or " " in robot:
                raise AcrcError(
                    f"robot {robot!r}: invalid name; use one that is a valid folder name without spaces"
                )
        addressed = [robot for robot, _ in self.radio.robots]
        if sorted(addressed) != sorted(set(robots)) or len(set(robots)) != len(robots):
            raise AcrcError(
                f"robots {', '.join(robots)}, but addresses of {', '.join(addressed) or 'none'}; "
                "give each robot one name and one address"
            )


class LaboratoryTruth(msgspec.Struct, frozen=True):
    """Ground truth of a robot at the end."""

    pose: tuple[float, float, float]
    """x, y in m and heading in rad, map frame."""
    travelled: float
    """Distance travelled, m."""


class LaboratoryResult(msgspec.Struct, frozen=True):
    """Ground truth and statistics of a laboratory."""

    began_us: int
    """Wall time of the start, µs since the Unix epoch."""
    simulated_s: float
    contacts: int
    lines: dict[str, int]
    """Bytes that robot processes did not read in time, by robot and device."""
    boards: dict[str, dict[str, int]]
    """Counters of each board, with address and channel (11 to 26) set by its host; simulated transceivers
    have no counters."""
    behind_ms: dict[str, int]
    """Number of physics sub-steps by lateness, in whole milliseconds."""
    lost_ms: int
    """Wall time that was skipped because the laboratory was too late."""
    robots: dict[str, LaboratoryTruth] = {}
    sample_us: Annotated[int, msgspec.Meta(ge=1)] = SAMPLE
    """Interval of `positions`."""
    positions: bytes = b""
    """True positions from the start on: float32 little-endian, (samples, robots, 2), m."""
    bases: dict[str, dict[str, int]] = {}
    """Valid frames from each base's driver, and skipped bytes."""
    frames: dict[str, int] = {}
    """Counters of radio frames, as in a simulated run."""
    frames_by_robot: dict[str, dict[str, int]] = {}
    cpu_s: float = 0.0
    """Processor time since the start, s."""


def load(path: Path) -> LaboratorySetup:
    """Read the set-up from a JSON file, whose paths are relative to its folder. Raises AcrcError."""
    setup = typed_json.read(path, LaboratorySetup, "set-up of a laboratory")
    world, radio = setup.world.resolve_paths(path.parent), setup.radio.resolve_paths(path.parent)
    return msgspec.structs.replace(setup, world=world, radio=radio)


LIDAR: Final = EmulatedRplidarParameters(samples=1980, noise=0.0025)
"""360 samples per turn, at whole degrees like the cast rays. Noise: own estimate, a quarter of the accuracy
of 1 % of the distance in Slamtec's data sheet of the A1."""
_RAYS: Final = 360


class LaboratoryScanners:
    """The world's range sensors with the rays of a lidar; mount and noise as in the robots' models."""

    def __init__(
        self, grid: OccupancyGrid, models: Sequence[RobotModel], generators: Sequence[Generator]
    ) -> None:
        """Create them; `generators`: of the range noise, one per robot."""
        lidars = [
            model.with_sensor(
                field_of_view_deg=360.0, rays=_RAYS, rate=LIDAR.turns,
                range_min=LIDAR.range_min, range_max=LIDAR.range_max,
            )
            for model in models
        ]  # fmt: skip
        self._sensors = RangeSensors(grid, lidars, generators)
        self._first = lidars[0].sensor.first_angle if lidars else 0.0
        self.poses: Floats = np.zeros((len(models), 3))
        """Poses of the bodies, (n, 3), m, rad, map frame."""
        self._obstacles: Floats = np.empty((0, 3))

    def set_state(self, poses: Sequence[tuple[float, ...]], obstacles: Floats) -> None:
        """Set poses of the bodies, and obstacles: (n, 3), x, y and radius, m."""
        self.poses[:] = poses
        self._obstacles = obstacles

    def range_function(self, index: int) -> RangeFunction:
        """Return the range function of one robot's lidar."""

        def ranges_at(angles: Floats) -> Floats:
            (ranges_mm,) = self._sensors.scan([index], self.poses, self._obstacles)
            rays = np.rint((angles - self._first) / (math.tau / _RAYS)).astype(np.intp) % _RAYS
            echoes_mm = ranges_mm[rays]
            return np.where(echoes_mm == NO_ECHO_MM, np.inf, echoes_mm / 1000)

        return ranges_at


class RobotBody:
    """Body of an emulated base (`emulated_kobuki.Body`), moved by the simulated world."""

    def __init__(self, bodies: Bodies, index: int) -> None:
        self._bodies = bodies
        self._index = index
        self._command = (0.0, 0.0)
        """Last command: m/s, rad/s."""

    def drive(self, v: float, omega: float) -> None:
        """Set the commanded velocity: `v` m/s forward and `omega` rad/s."""
        self._command = (v, omega)

    @property
    def is_commanded_to_stand(self) -> bool:
        """True if the last command is zero velocity; the body may still be braking."""
        return self._command == (0.0, 0.0)

    def hold(self, now: Instant) -> None:
        """Repeat the last command, as no watchdog is documented for a Kobuki.

        Call it before each move of the bodies, whose commands expire.
        """
        v, omega = self._command
        self._bodies.command(self._index, Drive(0, v, 0.0, omega, 0), now)

    def advance(self, now: Instant) -> None:
        """Do nothing: the world moves the body."""

    def truth(self) -> BodyTruth:
        """Return the current ground truth."""
        x, y, heading, vx, vy, omega = self._bodies.truth(self._index)
        return BodyTruth(Pose(x, y, heading), vx * cos(heading) + vy * sin(heading), omega)

    def bumper(self) -> int:
        """Return the sectors pressed at any time since the last call, as in Body."""
        return self._bodies.senses(self._index, 0, Instant(0), 0, False).bumper


Out = Callable[[DevicePort, bytes], None]


class EmulatedHardware(NamedTuple):
    """Emulated devices of one robot."""

    body: RobotBody
    base: EmulatedKobuki
    radio: EmulatedBoard | SimulatedTransceiver
    lidar: EmulatedRplidar


class Laboratory:
    """Emulated hardware of all robots; time starts at 0.

    Bodies, bases and lidars advance by physics sub-steps of 10 ms; boards and medium are event-driven, as
    their hosts need finer timing. The medium uses the true poses and velocities at the start of each
    sub-step.
    """

    def __init__(self, setup: LaboratorySetup) -> None:
        """Create the hardware. Raises AcrcError for missing files and invalid positions."""
        world, seed = setup.world, setup.world.seed
        self._bodies = Bodies(world)
        models = [load_model(robot.model, robot.sensor) for robot in world.robots]
        self._errors = [with_drift(model, world.uncertainty).kobuki_errors for model in models]
        self._parameters = [model.battery for model in models]
        self._batteries = Batteries(msgspec.structs.replace(world, step_us=SUBSTEP), models)
        noise = [generator(seed, "laboratory range", robot.id) for robot in world.robots]
        self._scanners = LaboratoryScanners(real_floor(world, models).visible, models, noise)
        self.medium = create_medium(setup.radio)
        """Radio medium."""
        self._orders = Orders(world.events, Participants(world.robots), self._bodies, Task(), Judge())
        self.robots: Mapping[str, EmulatedHardware] = {
            robot.id: self._hardware(index, setup) for index, robot in enumerate(world.robots)
        }
        """Devices by robot."""
        self.now = self.instant = START
        """Time of the bodies, and of the boards, which are at most a sub-step ahead."""
        self._travelled = np.zeros(len(models))
        self._positions = bytearray()
        self._update_surroundings()

    @property
    def wake(self) -> Instant:
        """Time of the next event."""
        return self.medium.wake() or self._due

    @property
    def contacts(self) -> int:
        """Number of contacts so far between robots or with walls."""
        return self._bodies.contacts

    @property
    def positions(self) -> bytes:
        """True positions so far, as in LaboratoryResult."""
        return bytes(self._positions)

    def pose(self, robot: str) -> tuple[float, float, float]:
        """Return the true pose: x, y in m and heading in rad, map frame."""
        return self._bodies.truth(self._index(robot))[:3]

    def travelled(self, robot: str) -> float:
        """Return the distance travelled so far, m."""
        return float(self._travelled[self._index(robot)])

    def move_robot(self, robot: str, pose: Pose) -> None:
        """Move a robot to another pose. Raises AcrcError if it does not fit."""
        self._bodies.place(self._index(robot), pose)

    def take(self, port: DevicePort, now: Instant, data: bytes) -> None:
        """Accept bytes from a line, at the current time of `advance`."""
        robot = self.robots[port.robot]
        if port.device == RADIO:
            robot.radio.take(now, data)
        elif port.device == BASE:
            robot.base.take(self.now, data)
        else:
            robot.lidar.take(self.now, data)

    def advance(self, until: Instant, out: Out) -> None:
        """Advance to `until`; pass the devices' bytes to `out`."""
        while self._due <= until:
            self.medium.advance(self._due)
            self._move()
            for name, robot in self.robots.items():
                out(DevicePort(name, BASE), robot.base.run(self.now))
                out(DevicePort(name, RANGE), robot.lidar.run(self.now))
        self.instant = until
        self.medium.advance(until)
        for name, robot in self.robots.items():
            out(DevicePort(name, RADIO), robot.radio.run(until))

    @property
    def _due(self) -> Instant:
        return Instant(self.now + SUBSTEP)

    def _move(self) -> None:
        for robot in self.robots.values():
            robot.body.hold(self.now)
        self._bodies.move(self.now, SUBSTEP)
        self.now = self._due
        before = self._scanners.poses[:, :2].copy()
        self._update_surroundings()
        self._travelled += arrays.hypot(*(self._scanners.poses[:, :2] - before).T)

    def _update_surroundings(self) -> None:
        """Execute orders at the start of a sub-step, and update medium and scanners."""
        self._orders.begin(self.now)
        effects = self._orders.effects
        self.medium.jam(self.now, effects.jams)
        for loss in effects.losses:
            self.medium.withhold(self._index(loss.sender), self._index(loss.robot))
        states = [self._bodies.truth(index) for index in range(len(self.robots))]
        self.medium.set_states(self.now, states)
        self._scanners.set_state([state[:3] for state in states], self._bodies.obstacles)
        if not self.now % SAMPLE:
            self._positions += self._scanners.poses[:, :2].astype("<f4").tobytes()
        if self._batteries.exist:
            self._discharge(states)

    def _discharge(self, states: Sequence[BodyState]) -> None:
        """Discharge the batteries by the last sub-step, without airtimes, and set the bases' voltages."""
        if self.now:
            self._batteries.end(self.now, self._bodies.truth, (0,) * len(states))
        truths = [
            RobotTruth(name, *state, stepping=True, powered=True, transmits=0)
            for name, state in zip(self.robots, states, strict=True)
        ]
        self._batteries.begin(truths)
        for hardware, battery, charge in zip(
            self.robots.values(), self._parameters, self._batteries.charges, strict=True
        ):
            if charge is not None and battery is not None and battery.voltage is not None:
                hardware.base.faults.battery = interpolate(battery.voltage, charge)

    def _hardware(self, index: int, setup: LaboratorySetup) -> EmulatedHardware:
        robot, seed = setup.world.robots[index], setup.world.seed
        body = RobotBody(self._bodies, index)
        errors = self._errors[index] if robot.odometry == "kobuki" else NO_ERRORS
        radio: EmulatedBoard | SimulatedTransceiver
        if robot.id in setup.without_board:
            channel = radio_parameters(setup.radio).channel
            settings = BoardSettings(dict(setup.radio.robots)[robot.id], channel)
            radio = SimulatedTransceiver(self.medium, settings)
        else:
            radio = EmulatedBoard(self.medium, START)
        self.medium.add(radio)
        base = EmulatedKobuki(body, generator(seed, "laboratory base", robot.id), BaseParameters(errors))
        noise = generator(seed, "laboratory lidar", robot.id)
        lidar = EmulatedRplidar(self._scanners.range_function(index), LIDAR, generator=noise)
        return EmulatedHardware(body, base, radio, lidar)

    def _index(self, robot: str) -> int:
        return list(self.robots).index(robot)


_USAGE: Final = {
    "battery": "VOLTS",
    "block-lidar": "",
    "cliff": "",
    "corrupt": "base|radio|range SHARE",
    "fail-lidar": "",
    "gps": "SENTENCE",
    "gyro": "works|frozen|absent",
    "ignore-commands": "",
    "lift": "",
    "no-echo": "",
    "overcurrent": "left|right|none",
    "plug": "base|radio|range",
    "press": "bumper|left|centre|right|radio",
    "put-down": "",
    "reboot": "radio",
    "release": "",
    "repair": "",
    "silence": "base|range",
    "unplug": "base|radio|range",
    "where": "",
}
"""Arguments after verb and robot."""
_BASE_FAULTS: Final[Mapping[str, tuple[str, object]]] = {
    "ignore-commands": ("deaf", True),
    "cliff": ("cliff", 7),
    "gyro works": ("gyro", "works"),
    "gyro frozen": ("gyro", "frozen"),
    "gyro absent": ("gyro", "absent"),
    "lift": ("wheel_drop", 3),
    "put-down": ("wheel_drop", 0),
    "press bumper": ("bumper", 2),
    "press left": ("bumper", 4),
    "press centre": ("bumper", 2),
    "press right": ("bumper", 1),
    "release": ("bumper", 0),
    "silence base": ("silent", True),
    "overcurrent left": ("overcurrent", 1),
    "overcurrent right": ("overcurrent", 2),
    "overcurrent none": ("overcurrent", 0),
}
"""Attribute of the base's faults, and its value, by command."""
_LIDAR_FAULTS: Final[Mapping[str, tuple[str, object]]] = {
    "no-echo": ("dark", True),
    "block-lidar": ("stuck", True),
    "fail-lidar": ("health", Health(2, 1)),
    "silence range": ("silent", True),
}
"""Attribute of the lidar, and its value: no echoes, blocked head, health error, silence."""
_HEALTHY_LIDAR: Final = {"dark": False, "stuck": False, "health": Health(0), "silent": False}


class FaultInjector(NamedTuple):
    """Executor of commands that inject and remove faults."""

    laboratory: Laboratory
    lines: EmulatedLines

    def execute(self, line: str) -> str:
        """Execute one line (verb, robot, arguments) and return the answer, mostly "ok". Raises AcrcError."""
        verb, *words = line.split() or [""]
        if verb not in _USAGE:
            raise AcrcError(f"unknown command {verb!r}; use one of {', '.join(_USAGE)}")
        robots, usage = self.laboratory.robots, _USAGE[verb].split()
        robot = words[0] if words else ""
        if robot not in robots:
            raise AcrcError(f"unknown robot {robot!r}; use one of {', '.join(robots)}")
        for word, choice in zip(words[1:], usage, strict=False):
            if choice.islower() and word not in choice.split("|"):
                raise AcrcError(f"invalid argument {word!r}; use one of {choice}")
        if len(words) != 1 + len(usage):
            raise AcrcError(f"{line.strip()!r}: usage is {f'{verb} ROBOT {_USAGE[verb]}'.rstrip()!r}")
        return self._execute(robots[robot], robot, (verb, *words[1:])) or "ok"

    def _execute(self, hardware: EmulatedHardware, robot: str, words: tuple[str, ...]) -> str | None:
        command = " ".join(words)
        if command in _BASE_FAULTS:
            setattr(hardware.base.faults, *_BASE_FAULTS[command])
        elif command in _LIDAR_FAULTS:
            setattr(hardware.lidar, *_LIDAR_FAULTS[command])
        match words:
            case ("lift",):
                hardware.body.drive(0.0, 0.0)
            case ("battery", volts):
                hardware.base.faults.battery = _number(volts, "a voltage", 25.5)
            case ("repair",):
                self._repair(hardware, robot)
            case ("where",):
                return self._position_line(hardware, robot)
            case ("corrupt", device, share):
                self.lines.corrupt(DevicePort(robot, device), _number(share, "a share", 1.0))
            case ("plug" | "unplug" as verb, device):
                self._plug(DevicePort(robot, device), plug=verb == "plug")
            case ("press" | "reboot", "radio") | ("gps", _):
                self._change_board(hardware, robot, words)
        return None

    def _plug(self, port: DevicePort, *, plug: bool) -> None:
        if plug is self.lines.is_plugged(port):
            state = "plugged in already; unplug it first" if plug else "not plugged in; plug it first"
            raise AcrcError(f"the {port.device} of {port.robot} is {state}")
        (self.lines.plug if plug else self.lines.unplug)(port)

    def _change_board(self, hardware: EmulatedHardware, robot: str, words: Sequence[str]) -> None:
        board, now = hardware.radio, self.laboratory.instant
        if not isinstance(board, EmulatedBoard):
            raise AcrcError(f"{robot} has a simulated transceiver without a board")
        if words[0] == "gps":
            board.gps(now, words[1].encode())
        elif words[0] == "press":
            board.press(now)
        else:
            board.reboot(now)

    def _repair(self, hardware: EmulatedHardware, robot: str) -> None:
        """Remove all faults and connect all lines."""
        hardware.base.faults = KobukiFaults()
        for attribute, value in _HEALTHY_LIDAR.items():
            setattr(hardware.lidar, attribute, value)
        for port in (DevicePort(robot, device) for device in DEVICES):
            self.lines.corrupt(port, 0.0)
            if not self.lines.is_plugged(port):
                self.lines.plug(port)

    def _position_line(self, hardware: EmulatedHardware, robot: str) -> str:
        """Return time, s; true distance travelled, m; speed, m/s; 1 if the commanded velocity is zero."""
        time = in_seconds(Duration(self.laboratory.now - START))
        commanded_to_stand = int(hardware.body.is_commanded_to_stand)
        speed = hardware.body.truth().v
        return f"{time:.3f} {self.laboratory.travelled(robot):.4f} {speed:.4f} {commanded_to_stand}"


def _number(word: str, what: str, maximum: float) -> float:
    """Parse a number from 0 to `maximum`. Raises AcrcError."""
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0 <= value <= maximum:
        raise AcrcError(f"{word!r} is not {what}; must be a number from 0 to {maximum:g}")
    return value
