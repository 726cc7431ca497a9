"""Lays a run out on disk: what every process reads, and the command line it is started with."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import yaml

from actors.messages import ProcessOrder
from actors.processes.launch import Program
from actors.processes.real_names import NAMES, RealNames
from actors.processes.silence import Timeout
from actors.radio.radio_setup import RadioSetup
from actors.robot.behaviour import succession
from actors.runtime.access import credentials, router_file
from actors.runtime.access.credentials import Credentials, unix_endpoint
from actors.runtime.client_options import own_folder
from actors.runtime.isolation.neutral import FOLDER, Names
from actors.runtime.isolation.neutral import code as seen_code
from actors.runtime.isolation.resource_limits import ProcessLimits, as_words
from actors.runtime.spans import Window, span_words
from actors.world.world_setup import BodySetup, WorldSetup
from cleaning.strategies.registry import STRATEGIES
from deploy.run import scenario_copy
from deploy.run.out_folder import make_folder


class Debugged(NamedTuple):
    """A robot that somebody debugs while the run goes on."""

    robot: str
    terminal: str
    """The path of its device; empty in memory, where the debugger has the process's own streams."""


@dataclass(frozen=True)
class Plan:
    """A run that is ready to be laid out."""

    out: Path
    """Absolute path of the folder for everything that the run writes."""
    world: WorldSetup
    radio: RadioSetup
    behaviour: str
    """Entry string `module:function` of the robots' behaviour."""
    modules: tuple[Path, ...]
    """Folders in which a strategy of the user's own is looked for, the first one first, as was admitted."""
    adaptation: str
    """What every robot reads about its strategy and exchange, as TOML."""
    navigation: str
    """What every robot reads about how it localises and navigates, as TOML."""
    scenario: scenario_copy.ScenarioCopy
    """The resolved scenario, as it lies beside the result."""
    commit: str
    """Version of the software."""
    speed: str
    """As on the command line: "max" or a number."""
    isolate: bool
    warning: str = ""
    """What is missing of the robots' isolation, for the user; empty if nothing is."""
    hidden: tuple[Path, ...] = ()
    """Files beside the strategy's code that a robot must not see: the scenario."""
    view: bool = False
    followed: tuple[str, ...] = ()
    """Robots that the view looks into; none named: as many as it does by itself."""
    debug: Debugged | None = None
    """The robot at whose breakpoints the run stops; None: as Python has it."""
    control: bool = False
    """Serve the map page."""
    limits: ProcessLimits = field(default=ProcessLimits())
    """What each robot's process may have."""
    timeout: Timeout = field(default=Timeout())
    """How long the run may take no step."""
    spans: Window | None = None
    """Steps in which every process notes what it does, span by span."""

    @property
    def own_code(self) -> bool:
        """Some of the strategy's code does not come with the testbed."""
        shipped = STRATEGIES.values()
        return any(name not in shipped for name in succession.names(self.behaviour))

    def folder(self, actor: str) -> Path:
        """The actor's own folder."""
        return self.out / actor

    def write_scenario(self) -> None:
        """Write the scenario, with the files that it names."""
        (self.out / "scenario.toml").write_text(self.scenario.text)
        (self.out / scenario_copy.MAP).mkdir()
        copy_map(Path(self.world.map), self.out / scenario_copy.MAP)
        for source, place in self.scenario.models:
            (self.out / place).parent.mkdir(exist_ok=True)
            shutil.copy(source, self.out / place)

    def names(self, robot: str, record: str) -> Names:
        """What a robot that is shut off sees under other names; `record`: the name of its recording."""
        folder = self.folder(robot).resolve()
        code, hidden = (tuple(str(path.absolute()) for path in some) for some in (self.modules, self.hidden))
        return Names(str(folder), str(folder / record), code, hidden)

    def address(self, robot: str) -> int:
        """The robot's short address on the air."""
        return dict(self.radio.robots)[robot]


def lay_out(plan: Plan) -> None:
    """Write the files that the actors read; the folder must be new or empty."""
    make_folder(plan.out)
    plan.write_scenario()
    write_names(plan)
    for actor, setup in (("world", plan.world), ("radio", plan.radio)):
        plan.folder(actor).mkdir()
        (plan.folder(actor) / "setup.json").write_bytes(msgspec.json.format(msgspec.json.encode(setup)))
    for robot in plan.world.robots:
        lay_out_robot(plan, robot)


def write_names(plan: Plan) -> None:
    """Write what isolated robots see under other names, where none of them can read it."""
    if plan.isolate:
        names = RealNames(str(plan.out.resolve()), tuple(str(path.absolute()) for path in plan.modules))
        (plan.out / NAMES).write_bytes(msgspec.json.format(msgspec.json.encode(names)) + b"\n")


def lay_out_robot(plan: Plan, robot: BodySetup) -> None:
    """Write the files that one robot reads."""
    own_folder(plan.folder(robot.id)).mkdir(parents=True)
    copy_map(Path(plan.world.map), plan.folder(robot.id))
    _write_places(robot, plan.folder(robot.id) / "places.toml")
    (plan.folder(robot.id) / "adaptation.toml").write_text(plan.adaptation)
    (plan.folder(robot.id) / "navigation.toml").write_text(plan.navigation)
    if Path(robot.model).is_file():
        shutil.copy(robot.model, plan.folder(robot.id) / "model.toml")


def copy_map(map_file: Path, folder: Path) -> None:
    """Copy a map_server map, its YAML file as `map.yaml` and its image beside it, as onto a robot's disk."""
    content = yaml.safe_load(map_file.read_text())
    image = (map_file.parent / content["image"]).resolve()
    shutil.copy(image, folder / f"map{image.suffix}")
    content["image"] = f"map{image.suffix}"
    (folder / "map.yaml").write_text(yaml.safe_dump(content, sort_keys=False))


def world_program(plan: Plan) -> Program:
    """The world's program."""
    folder = plan.folder("world")
    argv = (
        *("--setup", str(folder / "setup.json"), "--router", str(router_of(plan))),
        *("--record", str(folder / "world.mcap"), "--commit", plan.commit),
        *("--speed", plan.speed, "--with-parent", *span_words(plan.spans)),
    )
    return Program("world", "actors.world", argv, folder / "world.log", folder / "world.mcap")


def radio_program(plan: Plan) -> Program:
    """The radio's program."""
    folder = plan.folder("radio")
    argv = (
        "--setup",
        str(folder / "setup.json"),
        *client_argv(plan, "world", "radio", folder / "radio.mcap"),
    )
    return Program("radio", "actors.radio", argv, folder / "radio.log", folder / "radio.mcap")


def robot_program(
    plan: Plan, robot: BodySetup, order: ProcessOrder, first_step: int, name: str | None = None
) -> Program:
    """A robot's program; the same but for endpoint and time source as on a robot.

    `name`: of its recording and its log. Default: the robot's id, with its epoch behind it after a restart.
    """
    folder = plan.folder(robot.id)
    name = name or (robot.id if order.epoch == 0 else f"{robot.id}.{order.epoch}")
    isolated = plan.isolate and not _is_debugged(plan, robot.id)
    seen, code = (FOLDER, seen_code(len(plan.modules))) if isolated else (folder, plan.modules)
    argv = (
        *_robot_argv(plan, robot, order.epoch, first_step, seen),
        *(word for path in code for word in ("--path", str(path))),
        *_client_argv(plan, seen if isolated else seen.resolve(), "credentials", seen / f"{name}.mcap"),
        *(("--isolate",) if isolated else ()),
        *(() if plan.debug is None else ("--debugger", _terminal(plan, robot.id))),
        *(word for limit in (as_words(plan.limits) or ("",)) for word in ("--limit", limit)),
    )
    names = plan.names(robot.id, f"{name}.mcap") if isolated else None
    return Program(robot.id, "actors.robot", argv, folder / f"{name}.log", folder / f"{name}.mcap", names)


def _is_debugged(plan: Plan, robot: str) -> bool:
    return plan.debug is not None and plan.debug.robot == robot


def _terminal(plan: Plan, robot: str) -> str:
    assert plan.debug is not None
    return plan.debug.terminal if _is_debugged(plan, robot) else ""


def in_common(plan: Plan, out: Path | None = None) -> list[tuple[str, ...]]:
    """For each kind of robot the words for `share` of its program, once the run is laid out.

    `out`: what the run's folder is called there.
    """
    kinds = {(robot.model, robot.sensor): robot for robot in plan.world.robots}
    folders = {kind: (out or plan.out) / robot.id for kind, robot in kinds.items()}
    return [
        (
            *(str(folders[kind] / "map.yaml"), _model(plan, robot, folders[kind])),
            *(robot.sensor or "", str(folders[kind] / "navigation.toml")),
        )
        for kind, robot in kinds.items()
    ]


def _robot_argv(plan: Plan, robot: BodySetup, epoch: int, first_step: int, folder: Path) -> tuple[str, ...]:
    """What a robot is, apart from its connections; its files lie in `folder`, as it sees it."""
    x, y, heading = robot.start
    return (
        *("--id", robot.id, "--epoch", str(epoch), "--first-step", str(first_step)),
        *("--seed", str(plan.world.robot_seed(robot.id)), "--step-us", str(plan.world.step_us)),
        *("--address", str(plan.address(robot.id)), "--map", str(folder / "map.yaml")),
        *("--model", _model(plan, robot, folder)),
        *(("--sensor", robot.sensor) if robot.sensor else ()),
        *(f"--start={x!r},{y!r},{heading!r}", "--places", str(folder / "places.toml")),
        *("--adaptation", str(folder / "adaptation.toml"), "--navigation", str(folder / "navigation.toml")),
        *("--behaviour", plan.behaviour),
    )


def _model(plan: Plan, robot: BodySetup, folder: Path) -> str:
    """The robot's own copy of its model's file, in `folder`, or the name of a shipped one."""
    own = plan.folder(robot.id) / "model.toml"
    return str(folder / own.name) if own.exists() else robot.model


def router_of(plan: Plan) -> Path:
    """The run's router file."""
    return plan.folder("world") / router_file.NAME


def issue_credentials(plan: Plan) -> Credentials:
    """Draw the run's passwords; the robots' lie in their folders, all others in the world's."""
    issued = credentials.issue(
        {robot.id: plan.folder(robot.id) for robot in plan.world.robots}, plan.folder("world")
    )
    router_file.write(router_of(plan), issued)
    return issued


def remove_credentials(plan: Plan) -> None:
    """Remove what the run has left of passwords and sockets, if the world has not done so."""
    router_file.remove(router_of(plan))


def observer_program(plan: Plan) -> Program:
    """The observer's program, which reads what the others record, and needs nothing of the mesh."""
    argv = (
        *("--out", str(plan.out), *(word for robot in plan.followed for word in ("--robot", robot))),
        *(word for path in plan.modules for word in ("--modules", str(path))),
        *(("--isolate",) if plan.isolate and plan.debug is None else ()),
    )
    return Program("observer", "observation.view", argv, plan.out / "view.log", None)


CONTROL_ADDRESS: Final = "control.url"
"""File in a run's folder with the address of its map page, for as long as it is served."""


def control_program(plan: Plan) -> Program:
    """The map page's program."""
    folder = plan.folder("world").resolve()
    argv = (
        *("--setup", str(folder / "setup.json"), "--address", str(plan.out / CONTROL_ADDRESS)),
        *("--router", unix_endpoint(folder / "router.sock")),
        *("--observer", str(folder / "observer.credentials")),
        *("--operator", str(folder / "operator.credentials"), "--speed", plan.speed),
    )
    return Program("control", "deploy.control", argv, plan.out / "control.log", None)


def client_argv(plan: Plan, folder: str, user: str, record: Path) -> tuple[str, ...]:
    """The options of a client that is no robot; router's socket and `user`'s credentials lie in `folder`."""
    return _client_argv(plan, plan.folder(folder).resolve(), f"{user}.credentials", record)


def _client_argv(plan: Plan, place: Path, secret: str, record: Path) -> tuple[str, ...]:
    return (
        *("--router", unix_endpoint(place / "router.sock"), "--credentials", str(place / secret)),
        *("--record", str(record), "--commit", plan.commit, "--with-parent"),
        *span_words(plan.spans),
    )


def _write_places(robot: BodySetup, path: Path) -> None:
    title = f"# Places that {robot.id} has to clean: x, y in metres, map frame."
    rows = "".join(f"    [{x!r}, {y!r}],\n" for x, y in robot.places)
    path.write_text(f"{title}\nplaces = [\n{rows}]\n")
