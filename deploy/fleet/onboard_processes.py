"""Processes on board a robot: base, bridge, and the same robot program as in simulation.

On board, the robot program continues if its recording cannot be written.
"""

import fcntl
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from msgspec.structs import replace

from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.messages import ProcessOrder
from actors.processes.launcher import Program
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials
from actors.runtime.process_setup import ActorSetup, ProcessSetup
from actors.runtime.recording import Note, RecordingError, read_recording
from actors.world.world_setup import BodySetup
from deploy.run.plan import (
    MODEL,
    RunPlan,
    actor_program,
    client_setup,
    robot_program,
    write_robot_folder,
    write_strategy_folders,
)
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.onboard import last_pose
from firmware_bridge.onboard.device_loop import PATIENCE_S, BaseSetup, BridgeSetup
from firmware_bridge.ros2.settings import Ros2Base

BASE: Final = "base"
BRIDGE: Final = "radio"
_LAST_POSE: Final = "last.pose"


class Ports(NamedTuple):
    """Ports of a robot's devices, and settings of its board."""

    base: str | Ros2Base
    radio: str
    """Port, or with `keys` and no board an endpoint `tls/HOST:PORT`."""
    range: str | None
    settings: BoardSettings
    board: bool = True
    """False for a simulated transceiver without a board."""
    listen: str | None = None
    """Endpoint for the operator's laptop; None = no connections."""
    keys: str | None = None
    """Folder with the robot's keys; None: it connects to no other computer."""


@dataclass(frozen=True)
class OnboardRobot:
    """One robot's plan, ports and start options; `plan` has this robot alone."""

    plan: RunPlan
    ports: Ports
    next_epoch: Callable[[], int]
    """Returns an epoch later than all before, for a start of the robot's program."""
    debug_port: int | None = None
    """Port at which the program waits for a debugger; None: no debugger."""
    last_pose: Path | None = None
    """File with the robot's last pose estimate; None: a new file in the base's folder."""
    link_fault: Callable[[], str] = str
    """Returns why a laptop cannot connect; empty if it can."""
    packet_key: Path | None = None
    """File with the key of the fleet's packets; None: packets are not authenticated."""

    @property
    def pose_file(self) -> Path:
        """Path of the file with the last pose estimate."""
        return self.last_pose or self.folder(BASE) / _LAST_POSE

    @property
    def router(self) -> Path:
        """Router file, in the base's folder."""
        return self.folder(BASE) / credentials.ROUTER_FILE

    @property
    def robot(self) -> BodySetup:
        """The one robot."""
        return self.plan.world.robots[0]

    def folder(self, actor: str) -> Path:
        """Return the folder of the base or the bridge; the robot's sandbox hides both."""
        return self.plan.folder(f"{self.robot.id}.{actor}")


def write_folders(onboard: OnboardRobot) -> None:
    """Write the set-up files of the processes. Raises OptionError if the robot's folder exists."""
    plan, robot = onboard.plan, onboard.robot
    if plan.folder(robot.id).exists():
        raise OptionError(f"--out: {plan.out} already contains {robot.id}/; choose another directory")
    plan.out.mkdir(parents=True, exist_ok=True)
    write_strategy_folders(plan)
    write_robot_folder(plan, robot)
    for actor in (BASE, BRIDGE):
        onboard.folder(actor).mkdir()


def issue_passwords(onboard: OnboardRobot) -> credentials.Credentials:
    """Create new passwords: the robot's in its folder, all others in the base's. Copy the key of packets.

    Raises AcrcError.
    """
    plan = onboard.plan
    if onboard.packet_key is not None:
        key = credentials.read_packet_key(onboard.packet_key)
        credentials.write_secret(plan.folder(onboard.robot.id) / credentials.PACKET_KEY_FILE, key)
    issued = credentials.issue({onboard.robot.id: plan.folder(onboard.robot.id)}, onboard.folder(BASE))
    credentials.write_router_file(onboard.router, issued)
    return issued


def remove_passwords(onboard: OnboardRobot) -> None:
    """Remove remaining passwords and sockets, and the copied key."""
    (onboard.plan.folder(onboard.robot.id) / credentials.PACKET_KEY_FILE).unlink(missing_ok=True)
    credentials.remove_router_file(onboard.router)


def base_program(onboard: OnboardRobot, start: int) -> Program:
    """Return the base's program; `start`: number of earlier starts."""
    ports, folder, robot = onboard.ports, onboard.folder(BASE), onboard.robot
    base = BaseSetup(
        id=robot.id,
        model=f"../{robot.id}/{MODEL}" if robot.model.endswith(".toml") else robot.model,
        sensor=robot.sensor,
        start=robot.start,
        items=robot.items,
        task=onboard.plan.world.task,
        step_us=onboard.plan.world.step_us,
        base=ports.base,
        range=ports.range,
        listen=ports.listen,
        keys=ports.keys,
        last_pose=str(onboard.last_pose or _LAST_POSE),
        patience_s=PATIENCE_S if onboard.debug_port is None else None,
    )
    process = ProcessSetup(
        record=f"{_numbered_name(folder.name, start)}.mcap",
        router=credentials.ROUTER_FILE,
        commit=onboard.plan.commit,
        with_parent=True,
    )
    return actor_program(BASE, "firmware_bridge.onboard.base", folder, ActorSetup(base, process))


def bridge_program(onboard: OnboardRobot, start: int) -> Program:
    """Return the bridge's program."""
    plan, ports, folder = onboard.plan, onboard.ports, onboard.folder(BRIDGE)
    keys = None if ports.board else ports.keys
    bridge = BridgeSetup(onboard.robot.id, plan.world.step_us, ports.radio, ports.settings, ports.board, keys)
    record = f"{_numbered_name(folder.name, start)}.mcap"
    process = client_setup(plan, f"../{onboard.folder(BASE).name}", record)
    return actor_program(BRIDGE, "firmware_bridge.onboard.bridge", folder, ActorSetup(bridge, process))


def onboard_robot_program(onboard: OnboardRobot, start: int) -> Program:
    """Return the robot's program in a new epoch; under a debugger if `debug_port` is set."""
    robot, doubt = onboard.robot, None
    if (last := last_pose.read(onboard.pose_file)) is not None:
        robot, doubt = msgspec.structs.replace(robot, start=(*last.origin,)), last.spread
    order = ProcessOrder(robot.id, onboard.next_epoch())
    program = robot_program(onboard.plan, robot, order, first_step=0, name=_numbered_name(robot.id, start))
    assert program.setup is not None
    key_file = None if onboard.packet_key is None else credentials.PACKET_KEY_FILE
    actor_setup = msgspec.structs.replace(program.setup.actor, doubt=doubt, key_file=key_file)
    process = msgspec.structs.replace(program.setup.process, spares_record=True)
    program = replace(program, setup=ActorSetup(actor_setup, process))
    if onboard.debug_port is None:
        return program
    waiting = ("--listen", str(onboard.debug_port), "-m", program.module)
    return replace(program, module="debugpy", argv=(*waiting, *program.argv))


def _numbered_name(actor: str, start: int) -> str:
    return actor if start == 0 else f"{actor}.{start}"


STATE: Final = REPOSITORY / ".state"
"""Folder of the counters, one per computer, independent of the folders of runs."""
LAST_EPOCH: Final = 2**31 - 1
"""Maximum epoch in frame tags (actors.robot.behaviour.node_host), for 68 years of one start per second."""
_MAX_FILE_BYTES: Final = 64
"""Maximum length of the file, bytes."""
_EPOCH_ORIGIN: Final = 1_577_836_800
"""2020-01-01 in Unix time, s: origin of epochs derived from the clock. They exceed counted epochs, because a
start takes longer than 1 s."""
_CLOCK_IS_SET: Final = 1_767_225_600
"""2026-01-01 in Unix time, s; if the clock shows an earlier time, it was never set."""


class _RecordedRobot(msgspec.Struct):
    id: str
    epoch: int


class _RecordedRun(msgspec.Struct):
    """Required fields of the first record in a robot's recording."""

    setup: _RecordedRobot


@dataclass(frozen=True)
class EpochCounter:
    """Persistent counter of one robot's epochs on this computer."""

    robot: str
    runs: Path
    """Folder of earlier runs, whose recordings are read if the counter is missing or damaged."""
    say: Callable[[str], None]
    """Called with a warning about a damaged counter."""
    state: Path = STATE
    clock: Callable[[], float] = field(default=time.time)
    """Unix time, s."""

    @property
    def file(self) -> Path:
        """File with the latest epoch."""
        return self.state / f"{self.robot}.epochs"

    def claim(self) -> int:
        """Return a new epoch, later than all before. Raises AcrcError."""
        try:
            self.state.mkdir(parents=True, exist_ok=True)
            with (self.state / f"{self.robot}.lock").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                epoch = self._next()
                if epoch > LAST_EPOCH:
                    raise AcrcError(f"{self.file}: the next epoch, {epoch}, exceeds the maximum {LAST_EPOCH}")
                regular_file.write_atomically(self.file, _line(epoch), durable=True)
        except OSError as error:
            raise AcrcError(
                f"{self.file}: the epoch of {self.robot} cannot be stored ({error.strerror}); make the file "
                "writable, or other robots will discard this robot's frames"
            ) from None
        return epoch

    def _next(self) -> int:
        if not self.file.exists():
            return self._latest_recorded() + 1
        with self.file.open("rb") as file:
            line = file.read(_MAX_FILE_BYTES)
        number, _, _ = line.partition(b" ")
        if number.isdigit() and line == _line(int(number)):
            return int(number) + 1
        now = int(self.clock())
        if now < _CLOCK_IS_SET:
            today = time.strftime("%Y-%m-%d", time.gmtime(now))
            raise AcrcError(
                f"{self.file}: no valid epoch, and the clock shows {today}, so it was never set; set the "
                f"clock, then start {self.robot} again"
            )
        epoch = max(now - _EPOCH_ORIGIN, self._latest_recorded() + 1)
        self.say(
            f"{self.file}: no valid epoch, file damaged; {self.robot} continues with epoch {epoch}, derived "
            "from the clock"
        )
        return epoch

    def _latest_recorded(self) -> int:
        """Return the latest epoch in the robot's recordings; -1 = none."""
        found = map(_recorded_robot, self.runs.glob(f"*/{self.robot}/*.mcap"))
        return max((one.epoch for one in found if one and one.id == self.robot), default=-1)


def _line(epoch: int) -> bytes:
    number = b"%d" % epoch
    return b"%b %08x\n" % (number, zlib.crc32(number))


def _recorded_robot(path: Path) -> _RecordedRobot | None:
    """Return the robot in a recording's first record; None if the recording is not a robot's."""
    try:
        first = next(read_recording(path), None)
        return msgspec.json.decode(first.json, type=_RecordedRun).setup if isinstance(first, Note) else None
    except (RecordingError, OSError, ValueError):
        return None
