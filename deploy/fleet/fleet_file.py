"""The fleet file: which robots there are, where their devices are plugged in, and how they talk.

Every robot has a copy of the file, beside its copy of the map. Lengths in m, angles in rad.
"""

import ipaddress
import os
import re
from pathlib import Path
from typing import Annotated, Final

from msgspec import Meta
from msgspec.structs import replace

from actors import settings
from actors.installation.usage import OptionError
from actors.instant import milliseconds
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.foreign import Permit, admitted
from actors.robot_model import Model, RobotDescription, SensorName, load_model
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import located_model
from actors.settings import ParameterError, Settings, Text
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies import entry
from deploy.scenario.resolve import Swarm
from deploy.scenario.tables import ConductTable, RobotId, Seed, StepMs, SwarmFile
from firmware_bridge.beeclick.reception import power_setting
from firmware_bridge.onboard.device_loop import OPENNI

FOREVER: Final = 2**62
"""µs; a robot's run has no end of its own."""
_LISTEN: Final = re.compile(
    r"tls/(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9][A-Za-z0-9.-]*):(?P<port>[0-9]{1,5})"
)


_A_PATH: Final = r"/[^\x00-\x1f\x7f]+"


class AirTable(Settings, frozen=True):
    """[radio]: how the BEE-click boards are set up, all alike."""

    pan: Annotated[int, Meta(ge=0, le=0xFFFE, description="a whole number from 0 to 0xFFFE")] = 0xBABA
    """IEEE 802.15.4 PAN id. Default: that of the original robots (d3scomp/beeclickarmROS)."""
    channel: Annotated[int, Meta(ge=11, le=26)] = 11
    """In the 2.4 GHz band. Default: as the original robots; 26 is the one that Wi-Fi leaves alone most."""
    power_db: float = 0.0
    """Transmit power, dBm. Default: the strongest."""

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            power_setting(self.power_db)
        except ParameterError as error:
            raise self.wrong("power_db", error.expected) from None


class FleetRobot(RobotDescription, frozen=True, kw_only=True):
    """[[robot]]: one robot, and where its devices are on its own computer."""

    id: RobotId
    address: Annotated[int, Meta(ge=0, le=0xFFFD, description="a whole number from 0 to 0xFFFD")]
    """Short address on the air; no two robots may have the same."""
    model: Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the fleet file."""
    sensor: SensorName | None = None
    """Which of the model's sensors stands for the one that is mounted; absent: the model's own choice."""
    base: Annotated[
        str, Meta(pattern=rf"\A{_A_PATH}\Z", description='the path of a port, such as "/dev/kobuki"')
    ]
    """Of the Kobuki."""
    radio: Annotated[
        str, Meta(pattern=rf"\A{_A_PATH}\Z", description='the path of a port, such as "/dev/beeclick"')
    ]
    """Of the BEE click's board."""
    range: (
        Annotated[
            str,
            Meta(
                pattern=rf"\A({_A_PATH}|{OPENNI})\Z",
                description='the path of a lidar\'s port, such as "/dev/rplidar", or "openni"',
            ),
        ]
        | None
    ) = None
    """Of the RPLIDAR, or "openni"; absent: it has no range sensor."""
    listen: Annotated[str, Meta(description='"tls/HOST:PORT", such as "tls/0.0.0.0:7447"')] | None = None
    """Where the operator's laptop may connect to watch; absent: nowhere."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.listen is not None and not _is_endpoint(self.listen):
            raise self.wrong("listen")

    @property
    def listen_host(self) -> str | None:
        """The host in `listen`, without brackets; None if it does not listen."""
        match = _LISTEN.fullmatch(self.listen or "")
        return None if match is None else match["host"].strip("[]")

    @property
    def listens_everywhere(self) -> bool:
        """True where `listen` names no address of the robot's own."""
        return self.listen_host in {"0.0.0.0", "::"}


def _is_endpoint(endpoint: str) -> bool:
    match = _LISTEN.fullmatch(endpoint)
    if match is None or not 0 < int(match["port"]) < 65536:
        return False
    try:
        return not match["host"].startswith("[") or bool(ipaddress.IPv6Address(match["host"].strip("[]")))
    except ValueError:
        return False


class _FleetFile(SwarmFile, frozen=True, kw_only=True):
    """The file."""

    step_ms: StepMs = 100
    """Length of a step, ms."""
    seed: Seed = 1
    """From which the behaviours' random streams are derived."""
    keys: Annotated[Text, Meta(description="the path of a folder, relative to the fleet file")] | None = None
    """Folder with a folder of keys for each machine; absent: beside the file, `office-keys` for
    office.toml."""
    radio: AirTable = AirTable()
    run: ConductTable = ConductTable()
    robot: Annotated[tuple[FleetRobot, ...], Meta(min_length=1)]


class Fleet(_FleetFile, frozen=True, kw_only=True):
    """What a fleet file says; all paths are absolute, and `run.modules` is set."""

    path: Path
    """Of the file itself."""
    keys: str

    @property
    def robots(self) -> tuple[FleetRobot, ...]:
        """All of them, in the order of the file."""
        return self.robot

    def robot_named(self, name: str) -> FleetRobot:
        """The robot of that id, as an option names it. Raises OptionError if there is none."""
        for robot in self.robot:
            if robot.id == name:
                return robot
        known = ", ".join(robot.id for robot in self.robot)
        raise OptionError(f'{self.path}: there is no robot "{name}" in the fleet; it has {known}')

    def swarm(self, robot: FleetRobot) -> Swarm:
        """That robot alone, as the swarm that it is told of."""
        model, step_us = load_model(robot.model, robot.sensor), milliseconds(self.step_ms)
        body = BodySetup(
            robot.id, robot.model, model.default_sensor, robot.start, robot.places, odometry=model.odometry
        )
        return Swarm(
            world=WorldSetup(self.map, self.seed, step_us, FOREVER, (body,)),
            radio=RadioSetup(
                "beeclick", seed=self.seed, step_us=step_us, robots=((robot.id, robot.address),)
            ),
            behaviour=entry(self.run.strategy),
            adaptation=self.adaptation,
            stack=self.stack,
        )

    def keys_of(self, machine: str) -> Path:
        """The folder with the keys of a robot, by its id, or of the "operator"."""
        return Path(self.keys) / machine


def load_fleet(path: Path) -> Fleet:
    """The fleet in the file. Raises AcrcError."""
    return parse(settings.read_text(path, "fleet"), path)


def parse(text: str, path: Path) -> Fleet:
    """The fleet in the text of the file `path`, as load_fleet gives it."""
    file = settings.parse(text, _FleetFile, str(path))
    try:
        fault = _fault(file)
        _ = file.stack
    except AcrcError as error:
        fault = str(error)
    if fault:
        raise AcrcError(f"{path}: {fault}")
    return _located(file, Path(os.path.realpath(path)))


def _fault(file: _FleetFile) -> str | None:
    """Return what is wrong between the tables, in words without an end; None if nothing is."""
    for index, robot in enumerate(file.robot):
        key, earlier = f"robot[{index}]", file.robot[:index]
        if robot.id in {one.id for one in earlier}:
            return f'{key}.id is a second "{robot.id}"; each robot must have its own id'
        for one in earlier:
            if one.address == robot.address:
                return (
                    f"{key}.address is {robot.address} as that of {one.id}, "
                    "but each robot must have an address of its own"
                )
        taken: dict[str, str] = {}
        for name, port in (("base", robot.base), ("radio", robot.radio), ("range", robot.range)):
            if port is not None and (other := taken.setdefault(port, name)) != name:
                return f'{key}.{name} is "{port}" as {key}.{other}, but each device must have its own port'
    names = [area.name for area in file.area]
    for index, name in enumerate(names):
        if name in names[:index]:
            return f'area[{index}].name is a second "{name}"; each area must have its own name'
    return None


def _located(file: _FleetFile, path: Path) -> Fleet:
    folder = path.parent
    told = {name: getattr(file, name) for name in file.__struct_fields__} | {
        "map": os.path.realpath(folder / file.map),
        "keys": str(folder / (file.keys or f"{path.stem}-keys")),
        "run": replace(file.run, modules=str(folder / (file.run.modules or "."))),
        "robot": tuple(replace(one, model=located_model(one.model, folder)) for one in file.robot),
    }
    return Fleet(path=path, **told)


def own_code(fleet: Fleet, permit: Permit) -> tuple[Path, ...]:
    """Its folders, none for one that is installed. Raises as `foreign.admitted` does."""
    hints = (Path(fleet.run.modules),) if fleet.run.modules else ()
    return admitted(fleet.path, entry(fleet.run.strategy), hints, permit)
