"""Makes the first robot once before a run: what is wrong with a strategy is said before anything is laid out.

In a run of processes it is made as it will be, by a process of its own that is shut off like a robot's: the
strategy is somebody's code, and in the parent it could reach every robot's folder.
"""

import contextlib
import re
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

from actors.floor.map_file import load_map
from actors.messages import ProcessOrder
from actors.processes.last_word import said, show
from actors.processes.launch import Child, Launcher, Program
from actors.processes.scratch import scratch_folder
from actors.robot import assembly
from actors.robot.behaviour.modules import look_in
from actors.robot.behaviour.succession import rehearse
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError, printable
from actors.runtime.lifecycle.failure import FailureNote, failure_note, own_frames
from actors.runtime.prints import taken_by
from actors.runtime.recording import RecordingError, read_notes
from deploy.run.memory_swarm import exits_caught
from deploy.run.plan import Debugged, RunPlan, lay_out_robot, robot_program
from deploy.scenario.resolve import ResolvedScenario, robot_setup

_HUNG: Final = re.compile(r'^Timeout.*?File "([^"\n]*)", line (\d+)', re.DOTALL | re.MULTILINE)
"""What faulthandler writes of the place where the main thread was."""


@dataclass(frozen=True)
class PreflightLimits:
    """What a preflight may take."""

    patience_s: float = 120.0
    """Until the robot has been made, kernels included, which are compiled at the first start ever."""
    grace_s: float = 5.0
    """Beyond that, for a process that does not heed it."""


def preflight(plan: RunPlan, launched: Launcher, bounds: PreflightLimits = PreflightLimits()) -> None:
    """Make the first robot in a process of its own, in a folder that is gone afterwards.

    Raises AcrcError where that fails, hangs or ends; a bug's traceback is shown first.
    """
    robot = plan.world.robots[0]
    with scratch_folder() as folder:
        options = replace(plan.options, out=folder)
        stage = replace(plan, options=options, debug=plan.debug and Debugged("", ""))
        lay_out_robot(stage, robot)
        program = robot_program(stage, robot, ProcessOrder(robot.id, 0), 0)
        program = replace(program, argv=(*program.argv, "--preflight", f"{bounds.patience_s:g}"))
        child = launched.start(program)
        try:
            _await_end(child, launched, bounds)
            hung = child.exit_code is None
        finally:
            child.send(signal.SIGKILL)
            _await_end(child, launched, replace(bounds, patience_s=0.0))
        _judge(plan, child, bounds, hung=hung)


def preflight_here(settled: ResolvedScenario, modules: Sequence[Path]) -> None:
    """Make the first robot's behaviour in this process, and drop it.

    For a run in memory, where the strategy runs in this process anyway. Raises an AcrcError for settings,
    areas or equipment that do not fit, for an entry that leads nowhere, and for an error in the strategy's
    own code, with its frames.
    """
    name, robot = settled.scenario.run.strategy, settled.world.robots[0]
    told = robot_setup(settled, robot)
    model = load_model(robot.model, robot.sensor)
    floor = assembly.floor(load_map(settled.world.map), model, told.stack)
    start = assembly.start(told, model, floor)
    # --json leaves nothing else there; and a module is imported once, so what it keeps hold of is kept here
    look_in(modules)
    with contextlib.redirect_stdout(sys.stderr), taken_by(None), exits_caught():
        try:
            rehearse(settled.behaviour, start)
        except AcrcError:
            raise
        except Exception as error:
            which = repr(name) if name == settled.behaviour else f"{name!r}, {settled.behaviour!r},"
            cause = failure_note("", 0, error).cause
            sentence = f"strategy {which.rstrip(',')}, made for {robot.id} before the run: {cause}"
            raise AcrcError(f"{sentence}\n{own_frames(error)}".rstrip()) from error


def _await_end(child: Child, launched: Launcher, bounds: PreflightLimits) -> None:
    deadline = time.monotonic() + bounds.patience_s + bounds.grace_s
    while child.exit_code is None and time.monotonic() < deadline:
        launched.wait(0.05)


def _judge(plan: RunPlan, child: Child, bounds: PreflightLimits, *, hung: bool) -> None:
    """AcrcError unless the robot's process says that the robot could be made.

    `hung`: it had not ended by itself in time, so the signal that ended it was ours.
    """
    made = f"strategy {plan.behaviour!r}, made for {child.program.actor} before the run"
    notes = _notes(child.program)
    if "failure" in notes:
        note = msgspec.json.decode(notes["failure"], type=FailureNote)
        if note.expected:
            raise AcrcError(printable(note.cause))
        show(said(child.program))
        raise AcrcError(f"{made}: {printable(note.cause)}")
    if child.exit_code == 0 and "run" in notes:
        return
    told = said(child.program)
    place = _HUNG.search(told)
    if place is not None:
        where = f"{Path(place[1]).name}:{place[2]}"
        raise AcrcError(f"{made}: is not done after {bounds.patience_s:g} s; it is at {where}")
    if child.exit_code == 2 and told.strip():  # it says why before it comes to the strategy
        raise AcrcError(told.strip().splitlines()[-1])
    show(told)
    if hung:
        raise AcrcError(f"{made}: is not done after {bounds.patience_s + bounds.grace_s:g} s")
    assert child.exit_code is not None
    if child.exit_code < 0:
        number = signal.Signals(-child.exit_code)
        raise AcrcError(f"{made}: its process was ended by signal {number.name}")
    raise AcrcError(f"{made}: its process ended with exit code {child.exit_code}")


def _notes(program: Program) -> dict[str, bytes]:
    assert program.record is not None
    try:
        return {name: bytes(text, "utf-8") for name, text in read_notes(program.record).items()}
    except (OSError, RecordingError):
        return {}
