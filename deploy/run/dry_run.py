"""Creation of the first robot's behaviour in this process, before a run in memory."""

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from actors.floor.map_file import load_map
from actors.robot import assembly
from actors.robot.behaviour.handover import dry_run
from actors.robot_model import load_model
from actors.runtime.captured_output import captured_by
from actors.runtime.errors import AcrcError
from actors.runtime.failure import HardExit, failure_note, own_frames
from actors.user_code import set_folders
from deploy.scenario.resolve import ResolvedScenario, robot_setup


def preflight_in_process(resolved: ResolvedScenario, modules: Sequence[Path]) -> None:
    """Create and discard the first robot's behaviour in this process, for a run in memory.

    Raises AcrcError for wrong settings, areas or equipment, for a missing entry, and for an error in the
    strategy's code, with its frames.
    """
    name, robot = resolved.scenario.run.strategy, resolved.world.robots[0]
    setup = robot_setup(resolved, robot)
    model = load_model(robot.model, robot.sensor)
    floor = assembly.floor(load_map(resolved.world.map), model, setup.stack)
    start = assembly.start(setup, model, floor)
    # with --json, standard output is for the result only; modules imported here keep their streams
    set_folders(modules)
    with contextlib.redirect_stdout(sys.stderr), captured_by(None), raise_on_hard_exit():
        try:
            dry_run(resolved.behaviour, start)
        except AcrcError:
            raise
        except Exception as error:
            which = repr(name) if name == resolved.behaviour else f"{name!r}, {resolved.behaviour!r},"
            cause = failure_note("", 0, error).cause
            sentence = f"strategy {which.rstrip(',')}, preflight for {robot.id}: {cause}"
            raise AcrcError(f"{sentence}\n{own_frames(error)}".rstrip()) from error


@contextmanager
def raise_on_hard_exit() -> Iterator[None]:
    """Make `os._exit` raise HardExit instead of ending this process."""
    original_exit, own_pid = os._exit, os.getpid()

    def raise_hard_exit(status: int) -> NoReturn:
        if os.getpid() != own_pid:  # a child process of the strategy
            original_exit(status)
        raise HardExit(status)

    os._exit = raise_hard_exit
    try:
        yield
    finally:
        os._exit = original_exit
