"""The fleet file: which robots there are, where their devices are plugged in, and how they talk.

Every robot has a copy of the file, beside its copy of the map. Lengths in m, angles in rad.
"""

import ipaddress
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints

from actors import table_wording, toml_file
from actors.installation.usage import OptionError
from actors.instant import milliseconds
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.foreign import Permit, admitted
from actors.robot.stack import Stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.table import A_POINT, A_POSE, FileTable, Point, Pose, Right, Text, as_tuples
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies import entry
from deploy.scenario.resolve import Swarm
from deploy.scenario.stack_tables import AreaTable, DeecoTable, Settings, adaptation, stack_fault, stack_of
from deploy.scenario.tables import MOST_PLACES, Model, Parameters, RobotId, Sensor
from firmware_bridge.beeclick.parameters import POWERS, power_setting
from firmware_bridge.onboard.onboard_setup import OPENNI

FOREVER: Final = 2**62
"""µs; a robot's run has no end of its own."""
_LISTEN: Final = re.compile(
    r"tls/(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9][A-Za-z0-9.-]*):(?P<port>[0-9]{1,5})"
)


def _power(power_dbm: float) -> float:
    power_setting(power_dbm)
    return power_dbm


def _listen(endpoint: str) -> str:
    match = _LISTEN.fullmatch(endpoint)
    if match is None or not 0 < int(match["port"]) < 65536:
        raise ValueError
    if match["host"].startswith("["):
        ipaddress.IPv6Address(match["host"].strip("[]"))
    return endpoint


_A_PATH: Final = r"/[^\x00-\x1f\x7f]+"
_Path = Annotated[str, StringConstraints(pattern=rf"^{_A_PATH}$")]


class AirTable(FileTable):
    """[radio]: how the BEE-click boards are set up, all alike."""

    pan: Annotated[int, Field(ge=0, le=0xFFFE), Right("a whole number from 0 to 0xFFFE")] = 0xBABA
    """IEEE 802.15.4 PAN id. Default: that of the original robots (d3scomp/beeclickarmROS)."""
    channel: Annotated[int, Field(ge=11, le=26), Right("a whole number from 11 to 26")] = 11
    """In the 2.4 GHz band. Default: as the original robots; 26 is the one that Wi-Fi leaves alone most."""
    power_db: Annotated[
        float,
        AfterValidator(_power),
        Right(POWERS),
    ] = 0.0
    """Transmit power, dBm. Default: the strongest."""


class ConductTable(FileTable):
    """[run]: what the robots do."""

    strategy: Annotated[Text, Right('the name of a strategy, such as "none"')] = "none"
    """Name of the adaptation strategy, or the entry "module:function" of one's own."""
    modules: Annotated[Text | None, Right("the path of a folder, relative to the fleet file")] = None
    """Where one's own strategy is looked for; absent: beside the file."""


class FleetRobot(FileTable):
    """[[robot]]: one robot, and where its devices are on its own computer."""

    id: RobotId
    address: Annotated[int, Field(ge=0, le=0xFFFD), Right("a whole number from 0 to 0xFFFD")]
    """Short address on the air; no two robots may have the same."""
    model: Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the fleet file."""
    sensor: Sensor | None = None
    """Which of the model's sensors stands for the one that is mounted; absent: the model's own choice."""
    start: Annotated[Pose, Right(A_POSE)]
    """Where it is put before it is switched on: by hand, so as exactly as can be."""
    places: Annotated[
        tuple[Point, ...],
        BeforeValidator(as_tuples),
        Field(max_length=MOST_PLACES),
        Right(f"a list of points [x, y] in m, at most {MOST_PLACES}", item=A_POINT),
    ]
    """The places it has to clean, in this order."""
    base: Annotated[_Path, Right('the path of a port, such as "/dev/kobuki"')]
    """Of the Kobuki."""
    radio: Annotated[_Path, Right('the path of a port, such as "/dev/beeclick"')]
    """Of the BEE click's board."""
    range: Annotated[
        Annotated[str, StringConstraints(pattern=rf"^({_A_PATH}|{OPENNI})$")] | None,
        Right('the path of a lidar\'s port, such as "/dev/rplidar", or "openni"'),
    ] = None
    """Of the RPLIDAR, or "openni"; absent: it has no range sensor."""
    listen: Annotated[
        Annotated[str, AfterValidator(_listen)] | None,
        Right('"tls/HOST:PORT", such as "tls/0.0.0.0:7447"'),
    ] = None
    """Where the operator's laptop may connect to watch; absent: nowhere."""

    @property
    def listen_host(self) -> str | None:
        """The host in `listen`, without brackets; None if it does not listen."""
        match = _LISTEN.fullmatch(self.listen or "")
        return None if match is None else match["host"].strip("[]")

    @property
    def listens_everywhere(self) -> bool:
        """True where `listen` names no address of the robot's own."""
        return self.listen_host in {"0.0.0.0", "::"}


class _FleetFile(FileTable):
    map: Annotated[Text, Right("the path of a map's YAML file, relative to the fleet file")]
    step_ms: Annotated[
        int, Field(ge=10, le=100, multiple_of=10), Right("a multiple of 10 ms, from 10 to 100")
    ] = 100
    seed: Annotated[int, Field(ge=0, lt=2**63), Right("a whole number from 0 to 9223372036854775807")] = 1
    keys: Annotated[Text | None, Right("the path of a folder, relative to the fleet file")] = None
    radio: AirTable = AirTable()
    run: ConductTable = ConductTable()
    strategy: Settings = Field(default_factory=dict)
    deeco: DeecoTable = DeecoTable()
    localisation: Parameters = Field(default_factory=dict)
    navigation: Parameters = Field(default_factory=dict)
    planner: Parameters = Field(default_factory=dict)
    local_map: Parameters = Field(default_factory=dict)
    dwa: Parameters = Field(default_factory=dict)
    area: Annotated[tuple[AreaTable, ...], BeforeValidator(as_tuples)] = ()
    robot: Annotated[tuple[FleetRobot, ...], BeforeValidator(as_tuples), Field(min_length=1)]


@dataclass(frozen=True)
class Fleet:
    """What a fleet file says; all paths are absolute."""

    path: Path
    """Of the file itself."""
    map: Path
    """YAML file of the floor plan."""
    step_ms: int
    """Length of a step, ms."""
    seed: int
    """From which the behaviours' random streams are derived."""
    keys: Path
    """Folder with a folder of keys for each machine; by default beside the file, `office-keys` for
    office.toml."""
    radio: AirTable
    run: ConductTable
    """With `modules` set."""
    adaptation: Adaptation
    """What every robot is told about its strategy and exchange."""
    stack: Stack
    """What every robot is told about how it localises and navigates."""
    robots: tuple[FleetRobot, ...]

    def robot(self, name: str) -> FleetRobot:
        """The robot of that id, as an option names it. Raises OptionError if there is none."""
        for robot in self.robots:
            if robot.id == name:
                return robot
        known = ", ".join(robot.id for robot in self.robots)
        raise OptionError(f'{self.path}: there is no robot "{name}" in the fleet; it has {known}')

    def swarm(self, robot: FleetRobot) -> Swarm:
        """That robot alone, as the swarm that it is told of."""
        model, step_us = load_model(robot.model, robot.sensor), milliseconds(self.step_ms)
        body = BodySetup(robot.id, robot.model, model.sensor_name, model.odometry, robot.start, robot.places)
        return Swarm(
            world=WorldSetup(str(self.map), self.seed, step_us, FOREVER, (body,)),
            radio=RadioSetup(self.seed, step_us, ((robot.id, robot.address),), "beeclick"),
            behaviour=entry(self.run.strategy),
            adaptation=self.adaptation,
            stack=self.stack,
        )

    def keys_of(self, machine: str) -> Path:
        """The folder with the keys of a robot, by its id, or of the "operator"."""
        return self.keys / machine


def load_fleet(path: Path) -> Fleet:
    """The fleet in the file. Raises AcrcError."""
    return parse(toml_file.read(path, "fleet"), path)


def parse(text: str, path: Path) -> Fleet:
    """The fleet in the text of the file `path`, as load_fleet gives it."""
    file = table_wording.parse(text, _FleetFile, str(path))
    if fault := _fault(file) or stack_fault(file):
        raise AcrcError(f"{path}: {fault}")
    return _fleet(file, Path(os.path.realpath(path)))


def _fault(file: _FleetFile) -> str | None:
    """What is wrong between the tables, in words without an end; None if nothing is."""
    ids: set[str] = set()
    addresses: dict[int, str] = {}
    for index, robot in enumerate(file.robot):
        if robot.id in ids:
            return f'robot[{index}].id is "{robot.id}" once more, but each robot must have an id of its own'
        if robot.address in addresses:
            return (
                f"robot[{index}].address is {robot.address} as that of {addresses[robot.address]}, "
                "but each robot must have an address of its own"
            )
        ids.add(robot.id)
        addresses[robot.address] = robot.id
        if fault := _ports_fault(robot, f"robot[{index}]"):
            return fault
    names = [area.name for area in file.area]
    for index, name in enumerate(names):
        if name in names[:index]:
            return f'area[{index}].name is "{name}" once more, but each area must have a name of its own'
    return None


def _ports_fault(robot: FleetRobot, key: str) -> str | None:
    taken: dict[str, str] = {}
    for name, port in (("base", robot.base), ("radio", robot.radio), ("range", robot.range)):
        if port is None:
            continue
        if port in taken:
            return f'{key}.{name} is "{port}" as {key}.{taken[port]}, but each device must have its own port'
        taken[port] = name
    return None


def _fleet(file: _FleetFile, path: Path) -> Fleet:
    folder = path.parent

    def absolute(model: str) -> str:
        return str(folder / model) if model.endswith(".toml") else model

    return Fleet(
        path=path,
        map=Path(os.path.realpath(folder / file.map)),
        step_ms=file.step_ms,
        seed=file.seed,
        keys=folder / (file.keys or f"{path.stem}-keys"),
        radio=file.radio,
        run=file.run.model_copy(update={"modules": str(folder / (file.run.modules or "."))}),
        adaptation=adaptation(file.strategy, file.deeco, file.area),
        stack=stack_of(file),
        robots=tuple(robot.model_copy(update={"model": absolute(robot.model)}) for robot in file.robot),
    )


def own_code(fleet: Fleet, permit: Permit) -> tuple[Path, ...]:
    """Its folders, none for one that is installed. Raises as `foreign.admitted` does."""
    hints = (Path(fleet.run.modules),) if fleet.run.modules else ()
    return admitted(fleet.path, entry(fleet.run.strategy), hints, permit)
