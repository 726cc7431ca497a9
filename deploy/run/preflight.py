"""Creation of the first robot in a separate process, before a run."""

import dataclasses
import re
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from actors.messages import ProcessOrder
from actors.processes.launcher import ChildProcess, Launcher, scratch_folder
from actors.processes.robot_logs import print_output, program_output
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import FailureNote
from actors.runtime.recording import RecordingError
from deploy.run.plan import DebuggedRobot, RunPlan, robot_program, shared_arguments, write_robot_folder

_HUNG: Final = re.compile(r'^Timeout.*?File "([^"\n]*)", line (\d+)', re.DOTALL | re.MULTILINE)
"""Position of the main thread in faulthandler's output."""


@dataclass(frozen=True)
class PreflightLimits:
    """Time limits of a preflight."""

    patience_s: float = 120.0
    """Timeout of the creation of a robot, s, including the first compilation of kernels."""
    grace_s: float = 5.0
    """Additional time for a process that ignores its timeout, s."""


def preflight(plan: RunPlan, launcher: Launcher, limits: PreflightLimits = PreflightLimits()) -> None:
    """Create the first robot in a separate process and a temporary folder.

    Raises AcrcError if that fails, hangs or exits; the traceback of an unexpected error is printed first.
    """
    robot = plan.world.robots[0]
    with scratch_folder() as folder:
        options = replace(plan.options, out=folder)
        trial = dataclasses.replace(plan, options=options, debug=plan.debug and DebuggedRobot("", ""))
        write_robot_folder(trial, robot)
        for words in shared_arguments(trial, Path(), {robot.id}):  # the run's robots need the same data
            launcher.share("actors.robot.program", words, folder)
        launcher.share("cleaning.strategies.registry", (plan.behaviour,), folder)
        program = robot_program(trial, robot, ProcessOrder(robot.id, 0), 0)
        program = replace(program, argv=(*program.argv, "--preflight", f"{limits.patience_s:g}"))
        child = launcher.start(program)
        try:
            _await_exit(child, launcher, limits)
            hung = child.exit_code is None
        finally:
            child.send(signal.SIGKILL)
            _await_exit(child, launcher, dataclasses.replace(limits, patience_s=0.0))
        _check_preflight(plan, child, limits, hung=hung)


def _await_exit(child: ChildProcess, launcher: Launcher, limits: PreflightLimits) -> None:
    deadline = time.monotonic() + limits.patience_s + limits.grace_s
    while child.exit_code is None and time.monotonic() < deadline:
        launcher.wait(0.05)


def _check_preflight(plan: RunPlan, child: ChildProcess, limits: PreflightLimits, *, hung: bool) -> None:
    """Raise AcrcError unless the process has created its robot.

    `hung`: it was killed after the timeout.
    """
    context = f"strategy {plan.behaviour!r}, preflight for {child.program.actor}"
    notes = _notes(child)
    if "failure" in notes:
        note = msgspec.json.decode(notes["failure"], type=FailureNote)
        if note.expected:
            raise AcrcError(printable(note.cause))
        print_output(program_output(child.program))
        raise AcrcError(f"{context}: {printable(note.cause)}")
    if child.exit_code == 0 and "run" in notes:
        return
    output = program_output(child.program)
    place = _HUNG.search(output)
    if place is not None:
        where = f"{Path(place[1]).name}:{place[2]}"
        raise AcrcError(f"{context}: not finished after {limits.patience_s:g} s; it is at {where}")
    if child.exit_code == 2 and output.strip():  # an error before the strategy was loaded
        raise AcrcError(output.strip().splitlines()[-1])
    print_output(output)
    if hung:
        raise AcrcError(f"{context}: not finished after {limits.patience_s + limits.grace_s:g} s")
    assert child.exit_code is not None
    if child.exit_code < 0:
        number = signal.Signals(-child.exit_code)
        raise AcrcError(f"{context}: its process was killed by {number.name}")
    raise AcrcError(f"{context}: its process ended with exit code {child.exit_code}")


def _notes(child: ChildProcess) -> Mapping[str, str]:
    try:
        return child.notes()
    except (OSError, RecordingError):
        return {}
