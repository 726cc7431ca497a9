"""A robot as a program: `python -m actors.robot --id r1 --map FILE … --router ENDPOINT …`.

The same whoever sends it Senses: time arrives in messages.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs a process of one thread

import faulthandler
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace

from actors.robot import assembly, program
from actors.runtime import debugger, prints
from actors.runtime.access.rules import client_config
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.neutral import RECORDING
from actors.runtime.isolation.resource_limits import enforce
from actors.runtime.lifecycle.failure import failure_note
from actors.runtime.lifecycle.parent import answer_where, die_with_parent, leave
from actors.runtime.process import ActorProcess, play
from actors.runtime.recording import Recorder


def preflight(make: Callable[[], ActorProcess], recorder: Recorder, patience_s: float) -> int:
    """Make the robot and no more; the recording's first record, or its last, says what came of it."""
    faulthandler.dump_traceback_later(patience_s, exit=True)
    with recorder:
        try:
            recorder.note("run", make().run)
        except Exception as error:
            recorder.note("failure", failure_note("robot", 0, error))
            if not isinstance(error, AcrcError):
                traceback.print_exc()
            return 1
    return 0


def _robot(options: program.RobotOptions, argv: Sequence[str]) -> ActorProcess:
    """What its code prints goes to the log, with simulated time."""
    printed = prints.on(sys.stdout, options.setup.step_us)
    with printed.during(options.setup.first_step):
        return replace(program.part_of(options, argv), prints=printed)


def main(argv: Sequence[str]) -> int:
    """Be one robot until told to halt; the exit code."""
    parent, threads = os.getppid(), threading.enumerate()
    answer_where()
    try:
        options = program.parse(argv)
        assembly.kernels()
        recorder = Recorder(
            options.client.record, options.setup.step_us, RECORDING if options.isolate else None
        )
        if options.client.with_parent and not options.isolate:  # else its keeper sees to that
            die_with_parent(parent)
        if options.debugger:
            debugger.stop_at(options.debugger)
        elif options.debugger is not None:
            debugger.ignore_breakpoints()
        else:
            debugger.refuse_breakpoints(options.setup.id)
        if options.limits is not None:
            enforce(options.limits, isolated=options.isolate)
        if options.preflight_s is not None:
            return preflight(lambda: program.part_of(options, argv), recorder, options.preflight_s)
        config = client_config(options.client.credentials, options.client.router)
        robot, patience_s = _robot(options, argv), options.client.patience_s
        return play(robot, recorder, config, threads=threads, patience_s=patience_s)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    leave(main(sys.argv[1:]))
