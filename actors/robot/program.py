"""The robot's process: its command line, its core, and the core's connections."""

import argparse
import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.floor.map_file import load_map
from actors.geometry import Pose, wrap
from actors.messages import READY, Ready
from actors.robot.assembly import CommonGround, RobotSetup, common_ground, kernels, robot
from actors.robot.behaviour.adaptation import Adaptation, load_adaptation
from actors.robot.behaviour.places import load_places
from actors.robot.core import RobotCore
from actors.robot.stack import Stack, load_stack
from actors.robot_model import load_model
from actors.runtime.client_options import (
    ArgumentError,
    ArgumentParser,
    ClientOptions,
    add_client_options,
    client_options,
)
from actors.runtime.core import to
from actors.runtime.fingerprint import combined
from actors.runtime.isolation.resource_limits import ProcessLimits, limits
from actors.runtime.process import ActorProcess, run_note

_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,32}")


@dataclass(frozen=True)
class RobotOptions:
    """The robot's command line."""

    setup: RobotSetup
    map: Path
    model: str
    sensor: str | None
    path: tuple[Path, ...]
    """Folders to look for the behaviour's module in, the first one first, before Python's own."""
    limits: ProcessLimits | None
    """What its process may have; None: whatever there is."""
    isolate: bool
    """The process is shut off from everything but the router, and its recording is open (see `neutral`)."""
    preflight_s: float | None
    """Only make the robot, in at most so many seconds, and end."""
    debugger: str | None
    """The terminal at which breakpoints stop; empty: they do nothing; None: they fail."""
    client: ClientOptions


def build(options: RobotOptions) -> RobotCore:
    """The core that the options ask for. Raises an AcrcError for what does not fit."""
    model = load_model(options.model, options.sensor)
    return robot(options.setup, model, load_map(options.map))


def share(map_file: str, model: str, sensor: str, navigation: str) -> CommonGround:
    """What robots with this map, model, sensor ("": the model's own) and navigation.toml have in common.

    Those that are made while it is held, in this process or one forked from it, make none of it anew. An
    AcrcError for what does not fit.
    """
    common = common_ground(
        load_map(map_file), load_model(model, sensor or None), load_stack(Path(navigation))
    )
    if common.field is not None:
        _ = common.field.anywhere, common.field.grid
    return common


def part(argv: Sequence[str]) -> ActorProcess:
    """The robot that `argv` describes, with its connections. Raises an AcrcError if anything is wrong."""
    return part_of(parse(argv), argv)


def part_of(options: RobotOptions, argv: Sequence[str]) -> ActorProcess:
    """As `part`, from what `parse` made of `argv`."""
    look_in(options.path)
    core, setup = build(options), options.setup
    prints = kernels()
    run = run_note(
        options.client.record.stem, argv, setup, options.client.commit, seed=setup.seed, kernels=prints
    )
    ready = to(READY, Ready(setup.first_step, setup.id, setup.epoch, combined(prints)), setup.id)
    return ActorProcess(
        core=core,
        listens=core.listens(),
        run=run,
        ready=ready,
        outcome=core.outcome,
        spans=options.client.spans,
    )


def parse(argv: Sequence[str]) -> RobotOptions:
    """The options in `argv`, with the files they name; an AcrcError if they make no sense."""
    given = _parser().parse_args(argv)
    if not _ID.fullmatch(given.id):
        raise ArgumentError(f"--id is {given.id!r}; it should be 1 to 32 letters, digits, '-' or '_'")
    setup = RobotSetup(
        id=given.id,
        epoch=_whole("--epoch", given.epoch, 0),
        first_step=_whole("--first-step", given.first_step, 0),
        seed=_whole("--seed", given.seed, 0),
        step_us=_whole("--step-us", given.step_us, 1),
        address=_whole("--address", given.address, 0),
        start=_pose(given.start),
        doubt=given.doubt,
        places=load_places(given.places),
        behaviour=given.behaviour,
        adaptation=Adaptation() if given.adaptation is None else load_adaptation(given.adaptation),
        stack=Stack() if given.navigation is None else load_stack(given.navigation),
    )
    return RobotOptions(
        setup=setup,
        map=given.map,
        model=given.model,
        sensor=given.sensor,
        path=tuple(given.path),
        limits=None if given.limit is None else limits(tuple(filter(None, given.limit))),
        isolate=given.isolate,
        preflight_s=given.preflight,
        debugger=given.debugger,
        client=client_options(given),
    )


def code_of(argv: Sequence[str]) -> tuple[str, tuple[Path, ...]]:
    """The entry of the behaviour in `argv`, and the folders that it is looked for in first; reads no file."""
    given = _parser().parse_args(argv)
    return given.behaviour, tuple(given.path)


def look_in(folders: Sequence[Path]) -> None:
    """Let Python find modules in these folders, too."""
    for folder in reversed(folders):
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(prog="python -m actors.robot", description="One robot.")
    parser.add_argument("--id", required=True, help="the robot's name in the swarm")
    parser.add_argument("--epoch", type=int, default=0, help="how often it has been restarted")
    parser.add_argument("--first-step", type=int, default=0, help="the step it begins with")
    parser.add_argument("--seed", type=int, default=0, help="the robot's own seed")
    parser.add_argument("--step-us", type=int, default=100_000, help="length of a step, µs")
    parser.add_argument("--address", type=int, required=True, help="short address on the radio")
    parser.add_argument("--map", type=Path, required=True, help="YAML file of the floor plan")
    parser.add_argument("--model", required=True, help="name of a robot model, or its TOML file")
    parser.add_argument("--sensor", help="the model's range sensor to use; default: the model's own")
    parser.add_argument(
        "--start", required=True, help="x,y,heading at switch-on, m and rad; =-1,2,0 if x < 0"
    )
    parser.add_argument(
        "--doubt", type=_spread, help="standard deviation of the start, m: it stands until it is located"
    )
    parser.add_argument("--places", type=Path, required=True, help="TOML file: places = [[x, y], ...]")
    parser.add_argument(
        "--adaptation", type=Path, help="TOML file: settings of the strategy and of the exchange, areas"
    )
    parser.add_argument("--navigation", type=Path, help="TOML file: how it localises and navigates")
    parser.add_argument("--behaviour", required=True, help="entry of the behaviour, module:function")
    parser.add_argument(
        "--path", type=Path, action="append", default=[], help="folder with the behaviour's module"
    )
    parser.add_argument(
        "--isolate", action="store_true", help="it is shut off; its recording is open at descriptor 3"
    )
    parser.add_argument(
        "--limit", action="append", help="limit of the process, name=number; '' for the default"
    )
    parser.add_argument(
        "--hide", action="append", help=argparse.SUPPRESS
    )  # in recordings of earlier versions
    parser.add_argument("--debugger", metavar="TTY", help="where breakpoints stop; '': nowhere")
    parser.add_argument("--preflight", type=float, metavar="S", help="only make the robot, within S seconds")
    add_client_options(parser)
    return parser


def _whole(option: str, value: int, least: int) -> int:
    if value < least:
        raise ArgumentError(f"{option} is {value}; it should be at least {least}")
    return value


def _spread(text: str) -> float:
    spread = float(text)
    if not 0 < spread <= 100:
        raise ValueError
    return spread


def _pose(text: str) -> Pose:
    try:
        x, y, heading = (float(part) for part in text.split(","))
    except ValueError:
        x = y = heading = math.nan
    if not all(map(math.isfinite, (x, y, heading))):
        raise ArgumentError(f"--start is {text!r}; it should be three numbers x,y,heading in m and rad")
    return Pose(x, y, wrap(heading))
