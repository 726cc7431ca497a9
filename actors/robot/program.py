"""The robot's process: its set-up, its core, and the core's connections."""

from pathlib import Path

import msgspec

from actors.floor.map_file import load_map
from actors.messages import READY, Ready
from actors.robot.assembly import CommonGround, RobotSetup, common_ground, kernels, robot
from actors.robot.behaviour import loading
from actors.robot.core import RobotCore
from actors.robot.stack import Stack
from actors.robot_model import load_model
from actors.runtime.core import to
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process import ActorProcess, run_note
from actors.runtime.process_setup import ActorSetup, ProcessSetup, located_model, read_setup
from actors.runtime.processor import combined


class RobotProcess(ProcessSetup, frozen=True, forbid_unknown_fields=True):
    """A robot's place in a run."""

    code: tuple[str, ...] = ()
    """Folders to look for the behaviour's module in, the first one first, behind Python's own."""
    limits: ProcessLimits | None = None
    """What its process may have; None: whatever there is."""
    isolate: bool = False
    """The process is shut off from everything but the router, and its recording is open (see `sandbox`)."""
    debugger: str | None = None
    """The terminal at which breakpoints stop; empty: they do nothing; None: they fail."""
    spares_record: bool = False
    """Go on where the disk takes no record any more: on board, where stopping would cost more."""


RobotProgram = ActorSetup[RobotSetup, RobotProcess]
"""What a robot's process reads."""


def load_setup(path: Path) -> RobotProgram:
    """What a robot's process is told in a file; its files are called as in there. Raises AcrcError."""
    return read_setup(path, RobotProgram, "a robot")


def build(setup: RobotSetup, folder: Path) -> RobotCore:
    """The core of a robot whose set-up lies in `folder`. Raises an AcrcError for what does not fit."""
    model = load_model(located_model(setup.model, folder), setup.sensor)
    return robot(setup, model, load_map(folder / setup.map))


def share(map_file: str, model: str, sensor: str, stack: str) -> CommonGround:
    """What robots with this map, model, sensor ("": the model's own) and stack, as JSON, have in common.

    Those that are made while it is held, in this process or one forked from it, make none of it anew. An
    AcrcError for what does not fit.
    """
    parameters = msgspec.json.decode(stack, type=Stack)
    common = common_ground(load_map(map_file), load_model(model, sensor or None), parameters)
    if common.field is not None:
        _ = common.field.anywhere, common.field.grid
    return common


def part(told: RobotProgram, folder: Path) -> ActorProcess:
    """The robot of a set-up in `folder`, with its connections. Raises an AcrcError if anything is wrong."""
    process = told.process
    loading.look_in([folder / path for path in process.code])
    return part_of(told.actor, folder, Path(process.record).stem, process.commit)


def part_of(setup: RobotSetup, folder: Path, name: str, commit: str) -> ActorProcess:
    """As `part`, with a recording of that name; its code is looked for where this process looks."""
    core, prints = build(setup, folder), kernels()
    run = run_note(name, setup, commit, seed=setup.seed, kernels=prints)
    run = msgspec.structs.replace(run, code=loading.FOLDERS.hashes() or None)
    ready = to(READY, Ready(setup.first_step, setup.id, setup.epoch, combined(prints)), setup.id)
    return ActorProcess(
        core=core,
        listens=core.listens(),
        run=run,
        ready=ready,
        outcome=core.outcome,
        code=loading.FOLDERS.hashes,
    )
