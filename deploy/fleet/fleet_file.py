"""Fleet file: robots, ports of their devices, radio settings. Lengths in m, angles in rad.

Every robot has a copy of the file and of the map.
"""

import ipaddress
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

from msgspec import Meta
from msgspec.structs import replace

from actors import settings
from actors.installation.usage import OptionError
from actors.instant import milliseconds
from actors.radio.radio_model import RadioSetup, RadioTable
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.robot_model import Model, RobotDescription, SensorName, load_model
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import resolve_model
from actors.settings import ParameterError, Text
from actors.task.loading import decode_items, load_task, task_entry, task_setup
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies import entry
from deploy.hosts.address import host_and_port
from deploy.scenario.events import area_repetition_fault, repetition_fault
from deploy.scenario.resolve import Swarm
from deploy.scenario.tables import ConductTable, RobotId, Seed, StepMs, SwarmFile, decode_swarm_file
from firmware_bridge.beeclick.answer_decoder import power_setting
from firmware_bridge.onboard.device_loop import OPENNI
from firmware_bridge.ros2.settings import RobotTopics, Ros2Base

UNLIMITED_US: Final = 2**62
"""Duration of a robot's run, µs: unlimited."""
_LISTEN: Final = re.compile(r"tls/(?:\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9][A-Za-z0-9.-]*):[0-9]{1,5}")


_ABSOLUTE_PATH: Final = r"/[^\x00-\x1f\x7f]+"
NETWORK: Final = "network"
"""Value of `radio` for a robot without a board, whose frames a computer's simulated medium carries."""


class FleetRadioTable(RadioTable, frozen=True):
    """[radio]: settings of all BEE-click boards, or with `network` of the simulated medium."""

    network: Annotated[str, Meta(description='"tls/HOST:PORT", such as "tls/10.0.0.5:7450"')] | None = None
    """Endpoint of `acrc fleet radio`; HOST as robots reach that computer. None: robots have boards."""
    pan: Annotated[int, Meta(ge=0, le=0xFFFE, description="a whole number from 0 to 0xFFFE")] = 0xBABA
    """IEEE 802.15.4 PAN identifier. Default: as the original robots (d3scomp/beeclickarmROS)."""
    channel: Annotated[int, Meta(ge=11, le=26)] = 11
    """Channel in the 2.4 GHz band. Default: as the original robots; 26 has least interference from Wi-Fi."""
    power_db: float = 0.0
    """Transmit power, dBm. Default: maximum."""
    authenticated: bool = False
    """Authenticate packets with the file `packets.key` in each robot's folder of keys."""

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            power_setting(self.power_db)
        except ParameterError as error:
            raise self.wrong("power_db", error.expected) from None
        if self.network is None:
            self.check_unused({*RadioTable.__struct_fields__} - {"channel"}, "radio.network is absent")
            return
        self.check_unused(("power_db",), "radio.network is set")
        if not _is_endpoint(self.network):
            raise self.wrong("network")


class FleetRobot(RobotDescription, frozen=True, kw_only=True):
    """[[robot]]: one robot and the ports of its devices."""

    id: RobotId
    address: Annotated[int, Meta(ge=0, le=0xFFFD, description="a whole number from 0 to 0xFFFD")]
    """IEEE 802.15.4 short address, unique in the fleet."""
    model: Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the fleet file."""
    sensor: SensorName | None = None
    """The model's sensor that is mounted; None: the model's default."""
    base: Annotated[
        Annotated[str, Meta(pattern=rf"\A{_ABSOLUTE_PATH}\Z")] | Ros2Base,
        Meta(
            description='the path of a port, such as "/dev/kobuki", or a table [robot.base] '
            'with kind = "ros2"'
        ),
    ]
    """Port of the Kobuki, or the ROS 2 topics of another base and its lidar."""
    radio: Annotated[
        str,
        Meta(
            pattern=rf"\A({_ABSOLUTE_PATH}|{NETWORK})\Z",
            description='the path of a port, such as "/dev/beeclick", or "network"',
        ),
    ]
    """Port of the BEE-click board; "network": none, frames go through the medium at `radio.network`."""
    range: (
        Annotated[
            str,
            Meta(
                pattern=rf"\A({_ABSOLUTE_PATH}|{OPENNI})\Z",
                description='the path of a lidar\'s port, such as "/dev/rplidar", or "openni"',
            ),
        ]
        | None
    ) = None
    """Port of the RPLIDAR, or "openni"; None: no range sensor, or that of a ROS 2 base."""
    listen: Annotated[str, Meta(description='"tls/HOST:PORT", such as "tls/0.0.0.0:7447"')] | None = None
    """Endpoint for the operator's laptop; None: no connections."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.listen is not None and not _is_endpoint(self.listen):
            raise self.wrong("listen")
        if isinstance(self.base, Ros2Base) and self.range is not None:
            raise self.wrong("range", "absent where base is ROS 2 topics, which include the scans")

    @property
    def extras(self) -> tuple[str, ...]:
        """Extras of the packages that its computer needs."""
        return ("base", "hardware", "logs") if isinstance(self.base, Ros2Base) else ("base", "hardware")

    @property
    def needs_keys(self) -> bool:
        """True if it connects to other computers."""
        return self.listen is not None or self.radio == NETWORK

    @property
    def listen_host(self) -> str | None:
        """Host in `listen`, without brackets; None if the robot does not listen."""
        return None if self.listen is None else host_and_port(self.listen)[0]

    @property
    def listens_everywhere(self) -> bool:
        """True if `listen` is the wildcard address."""
        return self.listen_host in {"0.0.0.0", "::"}


def _is_endpoint(endpoint: str) -> bool:
    if not _LISTEN.fullmatch(endpoint):
        return False
    host, port = host_and_port(endpoint)
    try:
        return 0 < port < 65536 and (endpoint[4] != "[" or bool(ipaddress.IPv6Address(host)))
    except ValueError:
        return False


class _FleetFile(SwarmFile, frozen=True, kw_only=True):
    """Contents of a fleet file."""

    step_ms: StepMs = 100
    """Length of a step, ms."""
    seed: Seed = 1
    """Seed of the behaviours' random streams."""
    keys: Annotated[Text, Meta(description="the path of a folder, relative to the fleet file")] | None = None
    """Folder with one folder of keys per machine; None: `office-keys` for office.toml."""
    radio: FleetRadioTable = FleetRadioTable()
    run: ConductTable = ConductTable()
    robot: Annotated[tuple[FleetRobot, ...], Meta(min_length=1)]


class Fleet(_FleetFile, frozen=True, kw_only=True):
    """A loaded fleet file: all paths are absolute, and `run.modules` is set."""

    path: Path
    """The fleet file."""
    keys: str

    @property
    def robots(self) -> tuple[FleetRobot, ...]:
        """Robots in the order of the file."""
        return self.robot

    def robot_named(self, name: str) -> FleetRobot:
        """Return the robot with the id `name`. Raises OptionError."""
        for robot in self.robot:
            if robot.id == name:
                return robot
        known = ", ".join(robot.id for robot in self.robot)
        raise OptionError(f'{self.path}: no robot "{name}" in the fleet; give one of {known}')

    def swarm(self, robot: FleetRobot) -> Swarm:
        """Return a swarm whose world has this robot alone."""
        model, step_us = load_model(robot.model, robot.sensor), milliseconds(self.step_ms)
        body = BodySetup(
            robot.id, robot.model, model.default_sensor, robot.start, robot.items, odometry=model.odometry
        )
        task = task_setup(self.task.use, self.task_settings)
        return Swarm(
            world=WorldSetup(self.map, self.seed, step_us, UNLIMITED_US, (body,), task),
            radio=RadioSetup(
                "beeclick",
                seed=self.seed,
                step_us=step_us,
                robots=tuple((one.id, one.address) for one in self.robots),
            ),
            behaviour=entry(self.run.strategy),
            adaptation=self.adaptation,
            stack=self.stack,
        )

    @property
    def medium(self) -> RadioSetup:
        """Set-up of the simulated medium in place of boards."""
        return RadioSetup(
            **{name: getattr(self.radio, name) for name in RadioTable.__struct_fields__},
            seed=self.seed,
            step_us=milliseconds(self.step_ms),
            robots=tuple((one.id, one.address) for one in self.robots),
            map=self.map,
            detail="full",
        )

    def key_folder(self, machine: str) -> Path:
        """Return the folder with the keys of a robot, by id, of the "operator", or of the "radio"."""
        return Path(self.keys) / machine


def load_fleet(path: Path) -> Fleet:
    """Read a fleet file. Raises AcrcError."""
    return parse_fleet(settings.read_text(path, "fleet"), path)


def parse_fleet(text: str, path: Path) -> Fleet:
    """Parse the text of the fleet file `path`. Raises AcrcError."""
    content = settings.toml_tables(text, path)
    try:
        file = decode_swarm_file(_FleetFile, content)
        fault = _fault(file) or _task_fault(file, content)
        _ = file.stack
    except AcrcError as error:
        raise AcrcError(f"{path}: {error}") from None
    if fault:
        raise AcrcError(f"{path}: {fault}")
    path = Path(os.path.realpath(path))
    folder = path.parent
    values = {name: getattr(file, name) for name in file.__struct_fields__} | {
        "map": os.path.realpath(folder / file.map),
        "keys": str(folder / (file.keys or f"{path.stem}-keys")),
        "run": replace(file.run, modules=str(folder / (file.run.modules or "."))),
        "robot": tuple(replace(one, model=resolve_model(one.model, folder)) for one in file.robot),
    }
    return Fleet(path=path, **values)


def _fault(file: _FleetFile) -> str | None:
    """Return the first inconsistency between tables, in words; None if there is none."""
    if file.deeco.key is not None:
        return (
            "deeco.key must be absent, as fleet files are not secret; use radio.authenticated = true and the "
            "key of `acrc fleet keys`"
        )
    ids, owners = [robot.id for robot in file.robot], dict[int, str]()
    if fault := repetition_fault(ids, "robot[{}].id", "each robot must have its own id"):
        return fault
    for index, robot in enumerate(file.robot):
        key = f"robot[{index}]"
        if (robot.radio == NETWORK) is (file.radio.network is None):
            return (
                f'{key}.radio is "{robot.radio}", but must be "{NETWORK}" for all robots where radio.network '
                "is set, and a port where it is absent"
            )
        if (owner := owners.setdefault(robot.address, robot.id)) != robot.id:
            return (
                f"{key}.address: {robot.address} is the address of {owner}, too; "
                "give each robot its own address"
            )
        used_ports: dict[str, str] = {}
        for name, port in (("base", robot.base), ("radio", robot.radio), ("range", robot.range)):
            if isinstance(port, str) and (other := used_ports.setdefault(port, name)) != name:
                return f'{key}.{name}: "{port}" is the port of {other}, too; each device has its own port'
    return _topic_fault(file.robot) or area_repetition_fault(file)


def _topic_fault(robots: Sequence[FleetRobot]) -> str | None:
    """Return the first topic that is used twice, in words; None if there is none."""
    used: dict[tuple[object, ...], str] = {}
    for index, robot in enumerate(robots):
        if not isinstance(base := robot.base, Ros2Base):
            continue
        # Each robot's own computer has this address.
        router = f"{base.router} of {robot.id}" if base.is_local else base.router
        for name in RobotTopics.__struct_fields__:
            topic, purpose = base.topic(name), f"{name} of {robot.id}"
            other = used.setdefault((router, base.domain, topic), purpose)
            if other != purpose:
                return (
                    f"robot[{index}].base.topics.{name} is {topic} at {base.router}, which is {other}, too; "
                    "correct router, domain, namespace or topics"
                )
    return None


def _task_fault(file: _FleetFile, content: Mapping[str, Any]) -> str | None:
    """Return the first fault of the task's settings and of the robots' items; None if there is none."""
    task = load_task(file.task.use)
    settings.decode(task.settings, file.task_settings, file.table)
    for index, robot in enumerate(file.robot):
        key = f"robot[{index}].{file.table}"
        if task.declaration.lists_items and file.table not in content["robot"][index]:
            return f"{key} is missing, but must be a list of {task.declaration.items}"
        decode_items(task, robot.items, key)
    return None


def user_code_folders(fleet: Fleet, permit: Permit) -> tuple[Path, ...]:
    """Return the folders of the user's strategy; none if it is installed. Raises as `permitted_folders`."""
    hints = (Path(fleet.run.modules),) if fleet.run.modules else ()
    return permitted_folders(fleet.path, entry(fleet.run.strategy), hints, permit)


def task_folders(fleet: Fleet, permit: Permit) -> tuple[Path, ...]:
    """Return the folders of the user's task; none if it is installed. Raises as `permitted_folders`."""
    return permitted_folders(fleet.path, task_entry(fleet.task.use), (), permit, "task")
