"""Plan of a run: its files on disk, and the program of each of its processes."""

import os
import shutil
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from acrc_testbed.results.result import UNKNOWN_ORIGIN, Origin, package_versions
from acrc_testbed.results.summary import ROS2_LOG, VIEW_LOG
from actors.floor import offices
from actors.floor.map_file import read_header
from actors.installation.version import software_version
from actors.messages import ProcessOrder
from actors.processes.launcher import Program
from actors.processes.monitor import Timeout
from actors.radio.radio_model import RadioSetup
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour import handover
from actors.robot.program import RobotProcess
from actors.runtime import typed_json
from actors.runtime.isolation import credentials
from actors.runtime.isolation.credentials import Credentials, HostGateway
from actors.runtime.isolation.sandbox import (
    FOLDER,
    NAMES,
    SandboxPaths,
    StrategyFolders,
    code_paths,
    own_folder,
)
from actors.runtime.process_setup import SETUP, ActorSetup, ProcessSetup, resolve_model
from actors.task.loading import TASKS
from actors.user_code import FINDER
from actors.world.world_setup import BodySetup, WorldProcess, WorldSetup
from cleaning.strategies.registry import STRATEGIES
from deploy.run.options import RunOptions
from deploy.run.out_folder import make_folder
from deploy.scenario.resolve import ResolvedScenario, Swarm, robot_setup
from deploy.scenario.scenario_file import with_models
from deploy.scenario.tables import to_toml

if TYPE_CHECKING:  # runs without ROS 2 import nothing of it
    from firmware_bridge.ros2.settings import RouterLink

MAP: Final = "map"
"""Map folder in the run's folder."""
_MODELS: Final = "models"


class ScenarioCopy(NamedTuple):
    """The scenario as written into the run's folder."""

    text: str
    """Content of `scenario.toml`."""
    models: tuple[tuple[Path, str], ...]
    """User robot models, and their paths in the run's folder."""
    origin: Origin = UNKNOWN_ORIGIN
    """Origin of the run, for the result."""


def scenario_copy(resolved: ResolvedScenario, options: RunOptions) -> ScenarioCopy:
    """Return a copy of the scenario with paths relative to the run's folder."""
    scenario, out = resolved.scenario, options.out
    models_used = dict.fromkeys((scenario.robots.model, *(robot.model for robot in scenario.robot)))
    files = [name for name in models_used if name is not None and name.endswith(".toml")]
    places = {name: f"{_MODELS}/{number}-{Path(name).name}" for number, name in enumerate(files, start=1)}

    folder = options.modules[0] if options.modules else scenario.run.modules
    modules = os.path.relpath(folder, out) if ":" in scenario.run.strategy and folder else None
    run = msgspec.structs.replace(scenario.run, modules=modules)
    relative = msgspec.structs.replace(scenario, map=f"{MAP}/map.yaml", run=run)
    relative = with_models(relative, lambda model: places.get(model, model))
    models = tuple((Path(name), place) for name, place in places.items())
    origin = Origin(
        options.scenario,
        run.strategy,
        resolved.behaviour,
        dict(scenario.strategy),
        software_version(),
        package_versions(),
        key=run.key or "",
        navigation=scenario.presets["navigation"],
        localisation=scenario.presets["localisation"],
    )
    return ScenarioCopy(to_toml(relative), models, origin)


MODEL: Final = "model.toml"
"""File of a user's robot model in a robot's folder."""
_MAP: Final = f"../{MAP}/map.yaml"
"""Path of the map, relative to the folders of world and radio."""


class DebuggedRobot(NamedTuple):
    """A robot to debug during the run."""

    robot: str
    terminal: str
    """Path of its device; empty in memory, where the debugger uses the process's streams."""


@dataclass(frozen=True, kw_only=True)
class RunPlan(Swarm):
    """A run that is ready to be written to disk."""

    options: RunOptions
    """Options as given; `modules`: as permitted."""
    scenario: ScenarioCopy
    """Resolved scenario for the run's folder."""
    commit: str
    """Version of the software."""
    isolate: bool
    warning: str = ""
    """Why the robots' isolation is incomplete; empty if it is complete."""
    warnings: tuple[str, ...] = ()
    """Problems that the scenario will cause, one sentence each."""
    debug: DebuggedRobot | None = None
    """Robot whose breakpoints stop the run; None: Python's default."""
    timeout: Timeout = field(default=Timeout())
    """Stall timeouts."""

    @property
    def out(self) -> Path:
        """Absolute path of the output folder."""
        return self.options.out

    @property
    def has_user_code(self) -> bool:
        """True if any code of the strategy or of the task is the user's."""
        shipped = (*STRATEGIES.values(), *TASKS.values())
        return any(name not in shipped for name in (*handover.names(self.behaviour), self.world.task.use))

    def folder(self, actor: str) -> Path:
        """Return the actor's folder."""
        return self.out / actor

    def write_scenario(self) -> None:
        """Write the scenario and the files that it names."""
        (self.out / "scenario.toml").write_text(self.scenario.text)
        (self.out / MAP).mkdir()
        copy_map(Path(self.world.map), self.out / MAP)
        for source, place in self.scenario.models:
            (self.out / place).parent.mkdir(exist_ok=True)
            shutil.copy(source, self.out / place)

    @property
    def code(self) -> tuple[str, ...]:
        """Absolute paths of the folders with the user's code."""
        return tuple(str(path.absolute()) for path in self.options.modules)


def write_run_folder(plan: RunPlan) -> None:
    """Write all files that the actors read; the run's folder must be new or empty."""
    make_folder(plan.out)
    plan.write_scenario()
    write_strategy_folders(plan)
    for actor in ("world", "radio"):
        plan.folder(actor).mkdir()
    for robot in plan.world.robots:
        write_robot_folder(plan, robot)


def write_strategy_folders(plan: RunPlan) -> None:
    """Write the paths of the strategy's code to a file that isolated robots cannot read."""
    if plan.code:
        names = StrategyFolders(str(plan.out.resolve()), plan.code)
        (plan.out / NAMES).write_bytes(typed_json.dump(names))


def write_robot_folder(plan: RunPlan, robot: BodySetup) -> None:
    """Write a robot's folder with its map and model; its set-up follows at its start."""
    own_folder(plan.folder(robot.id)).mkdir(parents=True)
    copy_map(Path(plan.world.map), plan.folder(robot.id))
    if robot.model.endswith(".toml"):
        shutil.copy(robot.model, plan.folder(robot.id) / MODEL)


def copy_map(map_file: Path, folder: Path) -> None:
    """Copy a map_server map (`map.yaml` and its image) into a folder, or write a generated floor there."""
    if offices.is_name(map_file):
        offices.write(str(map_file), folder / "map")
        return
    header = read_header(map_file)
    image = f"map{header.image.resolve().suffix}"
    shutil.copy(header.image, folder / image)
    (folder / "map.yaml").write_text(header.text(image))


def world_program(plan: RunPlan) -> Program:
    """Return the world's program."""
    process = WorldProcess(
        record="world.mcap",
        router=credentials.ROUTER_FILE,
        commit=plan.commit,
        with_parent=True,
        speed=None if plan.options.speed == "max" else float(plan.options.speed),
        modules=tuple(str(folder) for folder in FINDER.task_folders),
    )
    world = relative_world_setup(plan, lambda robot: f"../{robot.id}/{MODEL}")
    return actor_program("world", "actors.world", plan.folder("world"), ActorSetup(world, process))


def relative_world_setup(plan: RunPlan, own_model: Callable[[BodySetup], str]) -> WorldSetup:
    """Return the world's set-up with paths relative to its folder; `own_model`: path of a user's model."""
    robots = tuple(
        msgspec.structs.replace(robot, model=own_model(robot)) if robot.model.endswith(".toml") else robot
        for robot in plan.world.robots
    )
    return msgspec.structs.replace(plan.world, map=_MAP, robots=robots, detail=plan.options.record)


def relative_radio_setup(plan: RunPlan) -> RadioSetup:
    """Return the radio's set-up with paths relative to its folder."""
    place = _MAP if plan.radio.map else ""
    return msgspec.structs.replace(plan.radio, map=place, detail=plan.options.record)


def radio_program(plan: RunPlan) -> Program:
    """Return the radio's program."""
    process = client_setup(plan, "../world", "radio.mcap")
    return actor_program(
        "radio", "actors.radio", plan.folder("radio"), ActorSetup(relative_radio_setup(plan), process)
    )


def client_setup(plan: RunPlan, place: str, record: str) -> ProcessSetup:
    """Return the process set-up of a radio; `place`: folder with the router's socket and the credentials."""
    return ProcessSetup(
        record=record,
        router=f"{place}/router.sock",
        credentials=f"{place}/radio.credentials",
        commit=plan.commit,
        with_parent=True,
    )


def actor_program(actor: str, module: str, folder: Path, setup: ActorSetup[Any, Any]) -> Program:
    """Return the program of an actor with its set-up in `folder`."""
    record = folder / setup.process.record
    return Program(actor, module, (str(folder / SETUP),), record.with_suffix(".log"), record, setup=setup)


def robot_program(
    plan: RunPlan, robot: BodySetup, order: ProcessOrder, first_step: int, name: str | None = None
) -> Program:
    """Return a robot's program; a physical robot's differs only in endpoint and time source.

    `name`: of its recording and log. Default: the robot's id, followed by the epoch after a restart.
    """
    folder = plan.folder(robot.id)
    name = name or (robot.id if order.epoch == 0 else f"{robot.id}.{order.epoch}")
    debug = plan.debug
    is_debugged = debug is not None and debug.robot == robot.id
    is_isolated = plan.isolate and not is_debugged
    modules = plan.options.modules
    seen, code = (FOLDER, code_paths(len(modules))) if is_isolated else (folder, modules)
    process = RobotProcess(
        record=f"{name}.mcap",
        router="router.sock",
        credentials="credentials",
        commit=plan.commit,
        with_parent=True,
        code=tuple(str(path) for path in code),
        limits=plan.options.limits,
        isolate=is_isolated,
        debugger=None if debug is None else debug.terminal if is_debugged else "",
    )
    setup = msgspec.structs.replace(
        _relative_robot_setup(plan, robot), epoch=order.epoch, first_step=first_step
    )
    program = actor_program(robot.id, "actors.robot", folder, ActorSetup(setup, process))
    real, hidden = folder.resolve(), tuple(str(path.absolute()) for path in plan.options.hidden)
    names = SandboxPaths(str(real), str(real / process.record), plan.code, hidden) if is_isolated else None
    return replace(program, argv=(str(seen / SETUP),), names=names)


def _relative_robot_setup(plan: RunPlan, robot: BodySetup) -> RobotSetup:
    """Return the robot's set-up, with the path of a user's model in its folder."""
    setup = msgspec.structs.replace(robot_setup(plan, robot), detail=plan.options.record)
    return msgspec.structs.replace(setup, model=MODEL) if setup.model.endswith(".toml") else setup


def shared_arguments(
    plan: RunPlan, out: Path | None = None, robots: Collection[str] | None = None
) -> list[tuple[str, ...]]:
    """Return the arguments for `actors.robot.program.share`, once per combination of model and sensor.

    They do not depend on a single robot. `out`: path of the run's folder on its host. `robots`: only these.
    """
    chosen = [robot for robot in plan.world.robots if robots is None or robot.id in robots]
    kinds = {(robot.model, robot.sensor): robot for robot in chosen}
    stack = msgspec.json.encode(plan.stack).decode()
    setups = [(_relative_robot_setup(plan, robot), (out or plan.out) / robot.id) for robot in kinds.values()]
    return [
        (str(folder / one.map), resolve_model(one.model, folder), one.sensor or "", stack)
        for one, folder in setups
    ]


def router_file(plan: RunPlan) -> Path:
    """Return the path of the run's router file."""
    return plan.folder("world") / credentials.ROUTER_FILE


def issue_credentials(plan: RunPlan, gateway: HostGateway | None) -> Credentials:
    """Create the run's passwords: the robots' in their folders, all others in the world's.

    `gateway`: endpoint for robots on hosts; their passwords are created there.
    """
    remote = {robot for robots in gateway.robots.values() for robot in robots} if gateway else set()
    local = [robot.id for robot in plan.world.robots if robot.id not in remote]
    issued = credentials.issue({robot: plan.folder(robot) for robot in local}, plan.folder("world"))
    issued = replace(issued, gate=gateway)
    credentials.write_router_file(router_file(plan), issued)
    return issued


def remove_credentials(plan: RunPlan) -> None:
    """Remove passwords and sockets, in case the world has not."""
    credentials.remove_router_file(router_file(plan))


def observer_program(plan: RunPlan) -> Program:
    """Return the observer's program; it reads recordings and does not connect to the mesh."""
    robots = (word for robot in plan.options.followed for word in ("--robot", robot))
    return Program(
        "observer", "acrc_testbed.view", ("--out", str(plan.out), *robots), plan.out / VIEW_LOG, None
    )


def ros2_program(out: Path, link: "RouterLink", robot: str = "") -> Program:
    """Return the publisher of a run's ROS 2 topics, an observer like the live view; `robot`: one on board."""
    argv = ("--out", str(out), "--router", link.router, "--domain", str(link.domain), "--robot", robot)
    return Program("ros2", "acrc_testbed.export.live_topics", argv, out / ROS2_LOG, None)


CONTROL_ADDRESS: Final = "control.url"
"""File in a run's folder with the URL of its map page while it is served."""


def control_program(plan: RunPlan) -> Program:
    """Return the map page's program."""
    argv = (str(plan.out.resolve()), str(plan.out / CONTROL_ADDRESS))
    return Program("control", "deploy.control", argv, plan.out / "control.log", None)
