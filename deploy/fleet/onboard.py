"""A robot's own processes: base, bridge, and the robot program with the set-up that simulation gives it.

On board it goes on where the disk takes no record.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

from actors.installation.usage import OptionError
from actors.messages import ProcessOrder
from actors.processes.launch import Program
from actors.runtime.access import credentials, router_file
from actors.runtime.access.credentials import Credentials
from actors.runtime.process_setup import ActorSetup, ProcessSetup
from actors.world.world_setup import BodySetup
from deploy.run.plan import (
    MODEL,
    RunPlan,
    actor_program,
    client,
    lay_out_robot,
    robot_program,
    write_names,
)
from firmware_bridge.onboard import last_pose
from firmware_bridge.onboard.onboard_setup import PATIENCE_S, BaseSetup, BridgeSetup

BASE: Final = "base"
BRIDGE: Final = "radio"
_LAST_POSE: Final = "last.pose"
OPERATORS: Final = ("radio", "observer", "operator")


@dataclass(frozen=True)
class Ports:
    """Where a robot's devices are plugged in, and how its board is set up."""

    base: str
    radio: str
    range: str | None
    pan: int
    channel: int
    power_dbm: float
    listen: str | None = None
    """Where the operator's laptop may connect; None = nowhere."""
    keys: str | None = None
    """Folder with the robot's own keys."""
    board: bool = True
    """False: at the radio's port is a laboratory's transceiver without a board."""


@dataclass(frozen=True)
class Onboard:
    """One robot, ready to be laid out; `plan` has this robot alone."""

    plan: RunPlan
    ports: Ports
    epochs: Callable[[], int]
    """Gives each start of the robot's program an epoch of its own, later than all before."""
    debug_port: int | None = None
    """Wait there for a debugger, and end without one."""

    last_pose: Path | None = None
    """File with where the robot last held itself to be; None: one in the base's folder, not there yet."""
    link_fault: Callable[[], str] = str
    """What keeps a laptop from watching it, in a sentence; empty if nothing does."""

    @property
    def pose_file(self) -> Path:
        """As `last_pose`."""
        return self.last_pose or self.folder(BASE) / _LAST_POSE

    @property
    def router(self) -> Path:
        """The router file, in the base's folder."""
        return self.folder(BASE) / router_file.NAME

    @property
    def robot(self) -> BodySetup:
        """The one robot."""
        (robot,) = self.plan.world.robots
        return robot

    def folder(self, actor: str) -> Path:
        """Of the base or the bridge: beside the robot's own, from which the robot sees neither."""
        return self.plan.folder(f"{self.robot.id}.{actor}")


def lay_out(onboard: Onboard) -> None:
    """Write the files that the processes read; the robot must have no folder there yet."""
    plan, robot = onboard.plan, onboard.robot
    own = plan.folder(robot.id)
    if own.exists():
        raise OptionError(f"--out: {plan.out} has a folder of {robot.id}; must be a folder without")
    plan.out.mkdir(parents=True, exist_ok=True)
    write_names(plan)
    lay_out_robot(plan, robot)
    for actor in (BASE, BRIDGE):
        onboard.folder(actor).mkdir()


def issue(onboard: Onboard) -> Credentials:
    """Draw new passwords: the robot's lies in its folder, all others in the base's."""
    plan = onboard.plan
    issued = credentials.issue({onboard.robot.id: plan.folder(onboard.robot.id)}, onboard.folder(BASE))
    router_file.write(onboard.router, issued)
    return issued


def withdraw(onboard: Onboard) -> None:
    """Remove what is left of passwords and sockets."""
    router_file.remove(onboard.router)


def base_program(onboard: Onboard, start: int) -> Program:
    """The base's program; `start` counts its starts."""
    plan, ports, folder = onboard.plan, onboard.ports, onboard.folder(BASE)
    robot = onboard.robot
    base = BaseSetup(
        robot=robot.id,
        model=f"../{robot.id}/{MODEL}" if robot.model.endswith(".toml") else robot.model,
        sensor=robot.sensor,
        start=robot.start,
        places=len(robot.places),
        step_us=plan.world.step_us,
        base=ports.base,
        range=ports.range,
        listen=ports.listen,
        keys=ports.keys,
        last_pose=str(onboard.last_pose or _LAST_POSE),
        patience_s=PATIENCE_S if onboard.debug_port is None else None,
    )
    process = ProcessSetup(
        record=f"{_numbered(folder.name, start)}.mcap",
        router=router_file.NAME,
        commit=plan.commit,
        with_parent=True,
    )
    return actor_program(BASE, "firmware_bridge.onboard.base", folder, ActorSetup(base, process))


def bridge_program(onboard: Onboard, start: int) -> Program:
    """The bridge's program."""
    plan, ports, folder = onboard.plan, onboard.ports, onboard.folder(BRIDGE)
    bridge = BridgeSetup(
        robot=onboard.robot.id,
        step_us=plan.world.step_us,
        radio=ports.radio,
        address=plan.address(onboard.robot.id),
        pan=ports.pan,
        channel=ports.channel,
        power_dbm=ports.power_dbm,
        board=ports.board,
    )
    record = f"{_numbered(folder.name, start)}.mcap"
    process = client(plan, f"../{onboard.folder(BASE).name}", "radio", record)
    return actor_program(BRIDGE, "firmware_bridge.onboard.bridge", folder, ActorSetup(bridge, process))


def onboard_robot_program(onboard: Onboard, start: int) -> Program:
    """The robot's program, as in simulation and in a new epoch; under a debugger if one is wanted."""
    robot, doubt = onboard.robot, None
    if (last := last_pose.read(onboard.pose_file)) is not None:
        robot, doubt = msgspec.structs.replace(robot, start=(*last.origin,)), last.spread
    order = ProcessOrder(robot.id, onboard.epochs())
    program = robot_program(onboard.plan, robot, order, first_step=0, name=_numbered(robot.id, start))
    assert program.setup is not None
    told = msgspec.structs.replace(program.setup.actor, doubt=doubt)
    process = msgspec.structs.replace(program.setup.process, spares_record=True)
    program = replace(program, setup=ActorSetup(told, process))
    if onboard.debug_port is None:
        return program
    waiting = ("--listen", str(onboard.debug_port), "-m", program.module)
    return replace(program, module="debugpy", argv=(*waiting, *program.argv))


def _numbered(actor: str, start: int) -> str:
    return actor if start == 0 else f"{actor}.{start}"
