"""Construction of a robot's process from its set-up file."""

from pathlib import Path

import msgspec

from actors import user_code
from actors.floor.map_file import load_map
from actors.messages import READY, Ready
from actors.robot.assembly import RobotSetup, SharedMapData, kernels, robot, shared_map_data
from actors.robot.core import RobotCore
from actors.robot.stack import Stack
from actors.robot_model import load_model
from actors.runtime.core import to
from actors.runtime.isolation import credentials
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process import ActorProcess, run_note
from actors.runtime.process_setup import ActorSetup, ProcessSetup, read_setup, resolve_model
from actors.runtime.processor import combine_fingerprints


class RobotProcess(ProcessSetup, frozen=True):
    """Process settings of a robot in a run."""

    code: tuple[str, ...] = ()
    """Folders with modules of the behaviour, in order, searched after Python's path."""
    limits: ProcessLimits | None = None
    """Resource limits; None: unlimited."""
    isolate: bool = False
    """Run in a sandbox: only the router is reachable, and the recording is already open."""
    debugger: str | None = None
    """Terminal for breakpoints; empty: breakpoints do nothing; None: they fail."""
    spares_record: bool = False
    """Continue without recording if the disk is full; for robots on hardware."""


RobotProgram = ActorSetup[RobotSetup, RobotProcess]
"""Set-up file of a robot's process."""


def load_setup(path: Path) -> RobotProgram:
    """Read the set-up file of a robot's process. Raises AcrcError."""
    return read_setup(path, RobotProgram, "a robot")


def build(setup: RobotSetup, folder: Path) -> RobotCore:
    """Return the core of a robot whose files are in `folder`. Raises AcrcError for invalid parts."""
    if setup.key_file is not None:
        adaptation = setup.adaptation
        exchange = msgspec.structs.replace(
            adaptation.exchange, key=credentials.read_packet_key(folder / setup.key_file)
        )
        adaptation = msgspec.structs.replace(adaptation, exchange=exchange)
        setup = msgspec.structs.replace(setup, adaptation=adaptation)
    model = load_model(resolve_model(setup.model, folder), setup.sensor)
    return robot(setup, model, load_map(folder / setup.map))


def share(map_file: str, model: str, sensor: str, stack: str) -> SharedMapData:
    """Compute the data shared by robots with this map, model, sensor ("": the model's) and stack (JSON).

    While the result is referenced, robots created in this process or its forks reuse it. Raises AcrcError.
    """
    parameters = msgspec.json.decode(stack, type=Stack)
    common = shared_map_data(load_map(map_file), load_model(model, sensor or None), parameters)
    if common.field is not None:
        _ = common.field.anywhere, common.field.grid
    return common


def actor_process(program: RobotProgram, folder: Path) -> ActorProcess:
    """Return the process of a robot whose files are in `folder`. Raises AcrcError for invalid parts."""
    process = program.process
    user_code.set_folders([folder / path for path in process.code])
    return actor_process_of(program.actor, folder, Path(process.record).stem, process.commit)


def actor_process_of(setup: RobotSetup, folder: Path, name: str, commit: str) -> ActorProcess:
    """Return a robot's process with a recording of that name, without changing the module folders."""
    core, prints = build(setup, folder), kernels()
    run = run_note(name, setup, commit, seed=setup.seed, kernels=prints)
    run = msgspec.structs.replace(run, code=user_code.FINDER.hashes() or None)
    ready = to(READY, Ready(setup.first_step, setup.id, setup.epoch, combine_fingerprints(prints)), setup.id)
    return ActorProcess(
        core=core,
        listens=core.listens(),
        run=run,
        ready=ready,
        outcome=core.outcome,
        code=user_code.FINDER.hashes,
    )
