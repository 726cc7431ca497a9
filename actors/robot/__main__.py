"""Program of a robot's process: `python -m actors.robot SETUP`, in simulation and on hardware."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs a single-threaded process

import faulthandler
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec.structs import replace

from actors.robot import assembly, program
from actors.runtime import captured_output, debugger, failure
from actors.runtime.background import LossyRecorder
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.rules import client_config
from actors.runtime.isolation.sandbox import RECORDING, enforce_limits, own_folder
from actors.runtime.linux import die_with_parent, enable_stack_dumps, exit_now
from actors.runtime.process import ActorProcess, report_failure, run_actor
from actors.runtime.process_setup import setup_parser
from actors.runtime.recording import Recorder


def preflight(make: Callable[[], ActorProcess], recorder: Recorder, patience_s: float) -> int:
    """Create the robot without running it and record the outcome; return the exit code."""
    faulthandler.dump_traceback_later(patience_s, exit=True)
    with recorder:
        try:
            recorder.note("run", make().run)
        except Exception as error:
            report_failure(recorder, "robot", 0, error)
            return 1
    return 0


def _robot(setup: program.RobotProgram, folder: Path) -> ActorProcess:
    """Create the robot; output of user code goes to the log with simulated time."""
    printed = captured_output.output_to_stream(sys.stdout, setup.actor.step_us)
    with printed.during(setup.actor.first_step):
        return replace(program.actor_process(setup, folder), prints=printed)


def main(argv: Sequence[str]) -> int:
    """Run one robot until a halt message; return the exit code."""
    parent, threads = os.getppid(), threading.enumerate()
    enable_stack_dumps()
    try:
        parser = setup_parser("actors.robot", "Run one robot.")
        parser.add_argument(
            "--preflight", type=float, metavar="S", help="create the robot within S s and exit"
        )
        options = parser.parse_args(argv)
        setup, folder = program.load_setup(options.setup), options.setup.parent
        process, step_us = setup.process, setup.actor.step_us
        assembly.kernels()
        kind = LossyRecorder if process.spares_record else Recorder
        recorder = kind(folder / process.record, step_us, RECORDING if process.isolate else None)
        failure.hold_reserve(own_folder(folder) if process.isolate else folder)
        if process.with_parent and not process.isolate:  # otherwise the sandbox ends the process
            die_with_parent(parent)
        debugger.answer_breakpoints(process.debugger, setup.actor.id)
        if process.limits is not None:
            enforce_limits(process.limits, isolated=process.isolate)
        if options.preflight is not None:
            return preflight(lambda: program.actor_process(setup, folder), recorder, options.preflight)
        config = client_config(folder / process.credentials, process.endpoint(folder))
        try:
            robot = _robot(setup, folder)
        except AcrcError:
            raise
        except BaseException as error:
            with recorder:
                report_failure(recorder, setup.actor.id, setup.actor.first_step, error)
            return 1
        return run_actor(robot, recorder, config, threads=threads, patience_s=process.patience_s)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    exit_now(main(sys.argv[1:]))
